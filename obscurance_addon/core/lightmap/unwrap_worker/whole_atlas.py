"""Has uvunwrap cut and pack all meshes at once.

It promises charts that neither overlap nor show their faces from behind. A face that it tears (twisted so that it
cannot be laid flat without a fold) or leaves without any place gets a rectangle in its stead, which holds it laid flat.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from .charts import Cut, Unplaceable, lay_flat
from .planar import twice_areas

POLL = 0.02  # seconds
PASSES = 4  # at most; the second one has rectangles for all that the first one tore
THINNEST = 1.0e-3  # height of a rectangle over its width: uvunwrap drops what is much thinner
SMALLEST = 1.0e-5  # side of a rectangle over the extent of all meshes
CELL, CUTS = 0.7, 12  # of a page: where a chart is wider than one, no chart leaves a cell, halved at most so often


def make_atlas(uvunwrap: object, cuts: list[Cut], job: dict, say: Callable[[tuple], None]) -> dict[str, np.ndarray]:
    """Places all meshes; the arrays of the answer. `say` is told each step.

    Raises
    ------
    Unplaceable
        As `pack_cuts` and `cut_mesh`.
    """
    size, density = int(job["size"]), float(job["density"])
    apart = (int(job["padding"]) + 3) // 2  # around each chart; a texel on each side is what interpolation touches
    options = {"page_size": size, "padding": apart}
    if density:
        room = (size - 2 * apart - 1) / density
        _refuse_wide(cuts, room)
        options["texels_per_unit"] = density
    say(("cut", 0.0))
    extent = max(float(np.ptp(cut.points[cut.corners].reshape(-1, 3), axis=0).max()) for cut in cuts)
    meshes = [_Mesh(uvunwrap, cut, SMALLEST * extent) for cut in cuts]
    for _ in range(PASSES):
        atlas = _generate(uvunwrap, meshes, options, room if density else None, say)
        if not density and atlas.page_count > 1:
            raise Unplaceable("crowded", int(atlas.chart_count))
        if atlas.page_count > int(job["most_pages"]):
            raise Unplaceable("pages", int(atlas.page_count))
        outputs = iter(atlas.meshes)
        if not sum(mesh.read(outputs) for mesh in meshes):
            break
    result = {"density": np.array(float(atlas.texels_per_unit)), "pages": np.array(int(atlas.page_count))}
    page = np.array([atlas.width, atlas.height]) / size  # a single page is cropped to what is used
    for i, mesh in enumerate(meshes):
        result[f"uv{i}"] = (mesh.cut.uv * page).astype(np.float32)
        result[f"chart{i}"], result[f"page{i}"] = mesh.cut.chart.astype(np.int32), mesh.page.astype(np.int32)
        result[f"folded{i}"] = np.array([len(mesh.cut.folded), False])
    return result


class _Mesh:
    """One mesh for uvunwrap, and a second one of rectangles for the faces that it cannot place as they are."""

    def __init__(self, uvunwrap: object, cut: Cut, smallest: float) -> None:
        self.uvunwrap, self.cut, self.smallest = uvunwrap, cut, smallest
        corner = np.unique(cut.corners)
        points, index = np.unique(cut.points[corner].astype(np.float32), axis=0, return_inverse=True)
        self.points, self.triangles = points, index.reshape(-1)[np.searchsorted(corner, cut.corners)].astype(np.uint32)
        self.alone: list[int] = []  # faces that have rectangles, in order
        self.flat: dict[int, np.ndarray] = {}  # of these, (n, 2) metres from 0
        self.page = np.full(len(cut.chart), -1)

    def inputs(self, cell: float | None) -> list[object]:
        """What uvunwrap gets; where there are cells of so many metres, each is a material: charts keep to one."""
        taken = ~np.isin(self.cut.face, self.alone)
        found = []
        if taken.any():
            polygons = self.cut.face[taken].astype(np.uint32)
            cells = None if cell is None else self._cells(cell)[taken]
            found.append(
                self.uvunwrap.Mesh(self.points, self.triangles[taken], polygons=polygons, face_materials=cells)
            )
        if self.alone:
            found.append(self.uvunwrap.Mesh(*self._rectangles()))
        return found

    def _cells(self, cell: float) -> np.ndarray:
        """Numbers (t,) of the cells that the middles of faces lie in."""
        cut = self.cut
        middle = np.add.reduceat(cut.points, cut.face_start[:-1]) / np.diff(cut.face_start)[:, None]
        place = np.floor((middle - cut.points[cut.corners].min((0, 1))) / cell)[cut.face]
        return np.unique(place, axis=0, return_inverse=True)[1].reshape(-1).astype(np.uint32)

    def _rectangles(self) -> tuple[np.ndarray, np.ndarray]:
        wide, high = self._sizes().T
        x, y = np.stack([0 * wide, wide, wide, 0 * wide], 1), np.stack([0 * high, 0 * high, high, high], 1)
        level = np.repeat(self.smallest * np.arange(len(wide)), 4)  # nothing is welded to another
        points = np.stack([x.ravel(), y.ravel(), level], 1).astype(np.float32)
        quads = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(wide))[:, None, None]
        return points, quads.reshape(-1, 3).astype(np.uint32)

    def _sizes(self) -> np.ndarray:
        """Width and height (r, 2) of the rectangles."""
        sizes = np.array([self.flat[face].max(0) for face in self.alone])
        return np.maximum(sizes, np.maximum(THINNEST * sizes.max(1), self.smallest)[:, None])

    def read(self, outputs: object) -> int:
        """Takes the places from the answer; the number of faces that must have rectangles in the next pass."""
        cut, taken = self.cut, ~np.isin(self.cut.face, self.alone)
        cut.uv[:], cut.chart[:], self.page[:] = 0.0, -1, -1
        torn = np.zeros(0, int)
        if taken.any():
            torn = self._take(next(outputs), taken)
        if self.alone:
            self._take_rectangles(next(outputs))
        self.alone += torn.tolist()
        return len(torn)

    def _take(self, output: object, taken: np.ndarray) -> np.ndarray:
        """Faces (n,) that were torn, or got no place at all."""
        cut, corners, face = self.cut, self.cut.corners[taken], self.cut.face[taken]
        uv = np.array(output.corner_uvs, np.float64).reshape(-1, 3, 2)
        first = np.array(output.indices, np.int64)[::3]
        chart, page = (np.array(values, np.int64)[first] for values in (output.chart, output.page))
        flat = np.abs(twice_areas(uv)) == 0.0
        for part in (flat, ~flat):  # triangles that got a place say where a corner is
            cut.uv[corners[part].ravel()] = uv[part].reshape(-1, 2)
            cut.chart[face[part]], self.page[face[part]] = chart[part], page[part]
        torn = ~flat & ((cut.chart[face] != chart) | (cut.uv[corners] != uv).any((1, 2)))
        torn = np.unique(face[torn | (cut.chart[face] < 0)])
        for one in torn.tolist():
            lay_flat(cut, one, corners[face == one])
            self.flat[one] = cut.uv[cut.loop(one)] - cut.uv[cut.loop(one)].min(0)
            cut.uv[cut.loop(one)] = 0.0
        cut.chart[torn] = self.page[torn] = -1
        return torn

    def _take_rectangles(self, output: object) -> None:
        uv = np.array(output.corner_uvs, np.float64).reshape(-1, 2, 3, 2)
        first = np.array(output.indices, np.int64)[::6]
        chart, page = (np.array(values, np.int64)[first] for values in (output.chart, output.page))
        for k, (face, size) in enumerate(zip(self.alone, self._sizes(), strict=True)):
            origin, right, top = uv[k, 0, 0], uv[k, 0, 1], uv[k, 1, 2]
            share = self.flat[face] / size
            self.cut.uv[self.cut.loop(face)] = origin + share[:, :1] * (right - origin) + share[:, 1:] * (top - origin)
            self.cut.chart[face], self.page[face] = chart[k], page[k]


def _generate(
    uvunwrap: object, meshes: list[_Mesh], options: dict, room: float | None, say: Callable[[tuple], None]
) -> object:
    """The atlas; where pages have room for so many metres only, with charts that are small enough."""
    cell = None
    for _ in range(CUTS):
        try:
            return _finished(uvunwrap.start([one for mesh in meshes for one in mesh.inputs(cell)], **options), say)
        except uvunwrap.UnwrapError as error:
            if room is None or not str(error).startswith("chart of"):
                raise
            cell = CELL * room if cell is None else 0.5 * cell
    raise RuntimeError("a chart stays wider than a page")


def _finished(job: object, say: Callable[[tuple], None]) -> object:
    """Waits for a job; tells each step that is new, so that one that hangs is noticed."""
    told = None
    while not job.done:
        now = job.progress
        step = now and (now.stage, now.done, now.total)
        if step and step != told:
            told = step
            cutting = now.stage in {"segmenting", "parameterizing"}
            before = now.stage == "segmenting"
            say(("cut", 0.0 if before else now.done / max(now.total or 1, 1)) if cutting else ("pack", now.done))
        time.sleep(POLL)
    say(("pack", 1))
    return job.result()


def _refuse_wide(cuts: list[Cut], room: float) -> None:
    """No face may be wider than a page, whose `room` is in metres."""
    for number, cut in enumerate(cuts):
        start = cut.face_start[:-1]
        size = np.maximum.reduceat(cut.points, start) - np.minimum.reduceat(cut.points, start)
        for face in np.flatnonzero((np.linalg.norm(size, axis=1) > room) & np.isin(np.arange(len(start)), cut.face)):
            lay_flat(cut, int(face), cut.corners[cut.face == face])
            width = float(np.ptp(cut.uv[cut.loop(face)], axis=0).max())
            if width > room:
                raise Unplaceable("oversize", number, width)
        cut.folded.clear()
