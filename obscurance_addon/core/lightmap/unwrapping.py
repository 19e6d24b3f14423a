"""Lays the faces of meshes side by side on square pages, for a texture that holds light.

A child process does the work (`unwrap_worker`), for xatlas stops the whole interpreter while it runs, and either
library may crash or hang on a broken mesh.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import BackendError, GeometryError
from ..native_library import why_missing
from ..notes import Notes, named
from ..process import ChildEndedError, ChildProcess
from ..scene import connected_components
from .settings import LightmapSettings, Unwrapper

SERVER = "lightmap.unwrap_worker.serve"  # module of the core that the child process runs
MOST_PAGES = 100  # UDIM tiles go by tens, and a bake of more than this would fill any memory
FARTHEST = 1.0e15  # metres; xatlas hangs on coordinates near 1e20, and nothing real is as far as this
ROUNDING = 4.0 * np.finfo(float).eps  # of a coordinate; what is no wider may be rounding alone
POLL = 0.05  # seconds
PATIENCE, PATIENCE_PER_TRIANGLE = (
    60.0,
    0.01,
)  # seconds for a mesh; usual ones take 0.0001 a triangle, a fan of 20,000 slivers 0.007
SLOWEST_PAGES = 20.0  # packing on many pages tries each one for each chart
CHARTING = 0.6  # of the work, roughly
USUAL_TRIES = 20
KEEP = "keep an existing UV map for it, or repair it (Mesh > Clean Up)"


class TooManyChartsError(GeometryError):
    """No page of `size` texels holds `charts`; what helps is for those to say who know the settings."""

    def __init__(self, charts: int, size: int) -> None:
        super().__init__(f"the faces make at least {charts:,} charts, more than a page of {size} x {size} texels holds")
        self.charts = charts


@dataclass(frozen=True)
class UnwrapMesh:
    """A mesh of v vertices, c corners of f polygons, and t triangles of these."""

    name: str  # of the object, for messages
    positions: np.ndarray  # (v, 3) float64 world metres
    corner_vertex: np.ndarray  # (c,) int
    face_start: np.ndarray  # (f + 1,) int, face i has the corners face_start[i] .. face_start[i + 1] - 1
    triangle_corners: np.ndarray  # (t, 3) int
    triangle_face: np.ndarray  # (t,) int


@dataclass(frozen=True)
class Atlas:
    """Where the faces of each mesh lie."""

    uv: list[np.ndarray]  # (c, 2) float32 of each corner, 0..1 within its page
    page: list[np.ndarray]  # (f,) int32 from 0, -1 for faces that are not placed
    chart: list[np.ndarray]  # (f,) int32 numbered over all meshes, -1 for faces that are not placed
    pages: int
    size: int  # side of a page in texels
    texels_per_metre: float
    notes: list[str]  # what the user should know, one sentence each without a full stop
    seconds: float


def unwrap(
    meshes: Sequence[UnwrapMesh],
    *,
    size: int,
    padding: int,
    unwrapper: Unwrapper = LightmapSettings.unwrapper,
    texels_per_metre: float | None = None,
    check: Callable[[], None],
    progress: Callable[[float], None] | None = None,
) -> Atlas:
    """Cuts the meshes into flat charts and packs these at one density; equal input gives equal bytes.

    Parameters
    ----------
    meshes : sequence of UnwrapMesh
    size : int
        Side of a page in texels.
    padding : int
        Least number of free texels between two charts, beyond those that linear interpolation touches.
    unwrapper : Unwrapper
    texels_per_metre : float, optional
        Takes as many pages as that needs. Without it, the greatest density (to 1 %) at which one page holds all.
    check : callable
        Called every 50 ms; what it raises ends the child process and passes through.
    progress : callable, optional
        Told the share that is done, 0..1.

    Raises
    ------
    GeometryError
        When no face has an area, or the faces do not fit on the pages; TooManyChartsError where there are too many
        charts for one.
    BackendError
        When the library is missing, or fails or hangs on a mesh.
    """
    begin = time.monotonic()
    if missing := why_missing(unwrapper.library):
        other = next((kind for kind in Unwrapper if not why_missing(kind.library)), None)
        instead = f", or choose the unwrapper {other.library} (--unwrapper {other.value})" if other else ""
        raise BackendError(f"the unwrapper {missing}{instead}")
    usable = [_usable_faces(mesh) for mesh in meshes]
    notes = _dropped_notes(meshes, usable)
    given = [i for i, (kept, _) in enumerate(usable) if kept.any()]
    if not given:
        names = f" ({named(mesh.name for mesh in meshes)})" if meshes else ""
        raise GeometryError(f"no face to unwrap has an area{names}: add faces, scale them up or repair them")
    area = sum(area for _, area in usable)
    if texels_per_metre is not None and area * texels_per_metre**2 > MOST_PAGES * size**2:
        raise _too_many_pages(int(area * texels_per_metre**2 / size**2) + 1, size)
    most = 0 if texels_per_metre else _most_charts(size, padding)
    if most and sum(int(kept.sum()) for kept, _ in usable) > most:  # else there cannot be too many
        pieces = sum(_pieces(mesh, kept) for mesh, (kept, _) in zip(meshes, usable, strict=True))
        if pieces > most:
            raise TooManyChartsError(pieces, size)
    chosen = [(meshes[i], usable[i][0]) for i in given]
    numbers = {"size": size, "padding": padding, "density": texels_per_metre or 0.0, "most_charts": most}
    numbers["unwrapper"] = unwrapper.value
    child = _Child(chosen, numbers, check, progress or (lambda share: None))
    found = child.run()
    notes += child.notes
    return _atlas(meshes, given, found, size, notes, begin)


def _usable_faces(mesh: UnwrapMesh) -> tuple[np.ndarray, float]:
    """Which faces (f,) can be placed, and the area of these in square metres."""
    faces = len(mesh.face_start) - 1
    near = np.isfinite(mesh.positions).all(1) & (np.abs(np.nan_to_num(mesh.positions)) < FARTHEST).all(1)
    of = np.repeat(np.arange(faces), np.diff(mesh.face_start))
    kept = np.bincount(of, ~near[mesh.corner_vertex], faces) == 0
    valid = kept[mesh.triangle_face]
    points = mesh.positions[mesh.corner_vertex[mesh.triangle_corners[valid]]]
    if not len(points):
        return np.zeros(faces, bool), 0.0
    edges = np.roll(points, -1, 1) - points
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    longest = np.linalg.norm(edges, axis=2).max(1)
    rounding = ROUNDING * longest * np.abs(points).max((1, 2))
    area, rounding = (np.bincount(mesh.triangle_face[valid], x, faces) for x in (area, rounding))
    kept &= area > rounding
    return kept, float(area[kept].sum())


def _most_charts(size: int, padding: int) -> int:
    """More charts than this fit no page: each has a texel, and so many free ones to the next."""
    return ((size + padding) // (1 + padding)) ** 2


def _pieces(mesh: UnwrapMesh, kept: np.ndarray) -> int:
    """Pieces of a mesh that no vertex connects, and so at least as many charts; vertices in one place are one."""
    job = _job(mesh, kept, 0)
    if not len(job["corners0"]):
        return 0
    place = np.unique(job["points0"].astype(np.float32), axis=0, return_inverse=True)[1].reshape(-1)
    triangles = place[job["corners0"]]
    links = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    return len(np.unique(connected_components(int(place.max()) + 1, links)[triangles[:, 0]]))


def _dropped_notes(meshes: Sequence[UnwrapMesh], usable: list[tuple[np.ndarray, float]]) -> list[str]:
    names = [mesh.name for mesh, (kept, _) in zip(meshes, usable, strict=True) if not kept.all()]
    cure = "remove these faces, or scale the objects up"
    return [f"faces without area, or far astray, get no texels: {named(names)}; {cure}"] if names else []


def _job(mesh: UnwrapMesh, kept: np.ndarray, number: int) -> dict[str, np.ndarray]:
    """What the child needs of a mesh, recentred while it is still float64."""
    valid = kept[mesh.triangle_face]
    corners = mesh.triangle_corners[valid].astype(np.int64)
    points = mesh.positions[mesh.corner_vertex].astype(np.float64)
    used = points[corners.ravel()]
    return {
        f"face_start{number}": mesh.face_start.astype(np.int64),
        f"corners{number}": corners,
        f"face{number}": mesh.triangle_face[valid].astype(np.int64),
        f"points{number}": points - 0.5 * (used.min(0) + used.max(0)),
    }


class _Child:
    """The process that cuts and packs."""

    def __init__(
        self,
        meshes: list[tuple[UnwrapMesh, np.ndarray]],
        numbers: dict[str, object],
        check: Callable[[], None],
        progress: Callable[[float], None],
    ) -> None:
        self.names, self.check, self.progress = [mesh.name for mesh, _ in meshes], check, progress
        triangles = np.array([len(mesh.triangle_face) for mesh, _ in meshes])
        seconds = PATIENCE + PATIENCE_PER_TRIANGLE * triangles
        pack_seconds = seconds.sum() * (SLOWEST_PAGES if numbers["density"] else 1.0)
        self.data = numbers | {"most_pages": MOST_PAGES, "seconds": seconds, "pack_seconds": pack_seconds}
        for number, (mesh, kept) in enumerate(meshes):
            self.data |= _job(mesh, kept, number)
        self.done = np.concatenate([[0.0], np.cumsum(triangles) / triangles.sum()])
        self.mesh, self.packing, self.together, self.told = None, False, False, 0.0
        self.notes: list[str] = []

    def run(self) -> dict[str, np.ndarray]:
        """The arrays it found; raises as `unwrap` does."""
        try:
            child = ChildProcess(SERVER)
        except ChildEndedError as error:
            raise BackendError(f"the unwrapper does not start: {error}; keep existing UV maps instead") from error
        try:
            child.send(self.data)
            return self._wait(child)
        except ChildEndedError as error:
            raise self._failed(f"failed ({error})") from error
        finally:
            child.end()

    def _wait(self, child: ChildProcess) -> dict[str, np.ndarray]:
        since = time.monotonic()
        while True:
            self.check()
            if child.poll(POLL):
                word, *rest = child.receive()
                if word == "done":
                    self._note(child.printed())
                    return rest[0]
                self._hear(word, *rest)
                since = time.monotonic()
            elif time.monotonic() - since > self._limit():
                raise self._failed("does not come to an end")

    def _note(self, printed: list[str]) -> None:
        """One note of all that the library printed."""
        lines = [line.strip() for line in printed if line.strip()]
        if lines:
            more = f" and {len(lines) - 1:,} more lines" if len(lines) > 1 else ""
            self.notes.append(
                f"the unwrapper went on after a warning of its own ('{lines[0][:80]}'{more}): if the lightmap looks "
                "wrong somewhere, clean up the mesh there, or choose the other unwrapper (Unwrapper, --unwrapper)"
            )

    def _limit(self) -> float:
        if self.packing or self.data["unwrapper"] == Unwrapper.UVUNWRAP:  # which works on all meshes at once
            return float(self.data["pack_seconds"])
        return float(self.data["seconds"][self.mesh or 0])

    def _tell(self, share: float) -> None:
        self.told = max(self.told, share)
        self.progress(self.told)

    def _hear(self, word: str, number: int, metres: float = 0.0) -> None:
        size, density = int(self.data["size"]), float(self.data["density"])
        if word == "mesh":
            self.mesh = number
            self._tell(CHARTING * float(self.done[number]))
        elif word == "cut":
            self.together, self.packing = True, False
            self._tell(CHARTING * number)
        elif word == "pack":
            self.packing = True
            self._tell(CHARTING + (1.0 - CHARTING) * min(number / USUAL_TRIES, 1.0))
        elif word == "oversize":
            raise GeometryError(
                f"a face of object '{self.names[number]}' is {metres:.4g} m wide, {metres * density:.0f} texels, more "
                f"than a page of {size}; lower the texels per metre or raise the size"
            )
        elif word == "pages":
            raise _too_many_pages(number, size)
        elif word == "crowded":
            raise TooManyChartsError(number, size)

    def _failed(self, how: str) -> BackendError:
        if self.packing or self.mesh is None:
            what = "while it cut the meshes" if self.together else "before its first mesh"
            what = "while it packed the charts" if self.packing else what
            return BackendError(f"the unwrapper {how} {what}; keep existing UV maps instead")
        return BackendError(f"the unwrapper {how} on object '{self.names[self.mesh]}'; {KEEP}")


def _too_many_pages(pages: int, size: int) -> GeometryError:
    return GeometryError(
        f"the faces need {pages} pages of {size} x {size} texels, more than {MOST_PAGES}; "
        "lower the texels per metre or raise the size"
    )


def _atlas(
    meshes: Sequence[UnwrapMesh], given: list[int], found: dict, size: int, notes: list[str], begin: float
) -> Atlas:
    uv = [np.zeros((len(mesh.corner_vertex), 2), np.float32) for mesh in meshes]
    page, chart = ([np.full(len(mesh.face_start) - 1, -1, np.int32) for mesh in meshes] for _ in range(2))
    told = Notes()
    for n, i in enumerate(given):
        uv[i], page[i], chart[i] = found[f"uv{n}"], found[f"page{n}"], found[f"chart{n}"]
        folded, unchecked = found[f"folded{n}"]
        if folded:
            told.add("twisted faces overlap themselves when laid flat", meshes[i].name, cure="triangulate them")
        if unchecked:
            told.add("too entangled to be searched for faces that overlap", meshes[i].name, cure="look at the UV map")
    return Atlas(
        uv,
        page,
        chart,
        int(found["pages"]),
        size,
        float(found["density"]),
        notes + told.lines(),
        time.monotonic() - begin,
    )
