"""Packs the charts of all meshes on square pages: at a given density, or at the greatest that one page holds."""

from __future__ import annotations

import faulthandler
import itertools
from collections.abc import Callable

import numpy as np

from .charts import Cut, Unplaceable
from .planar import twice_areas
from .retired import retire

ORPHANED = 2.0  # times its patience, no parent has ended this process: it ends itself, whatever the system
NONE = 0xFFFFFFFF  # what xatlas has for no chart
NUDGE = 0.02  # texel, the width given to triangles that xatlas would not see
SNAP = 2.0**-10  # texel; corners are either equal or so far apart that xatlas sees a triangle between them
SEEN = 1.0e-6  # square texels, well over the area below which it does not see them (1.2e-7)
CHARTS_PER_GROUP = 256  # equal coordinates in a group are compared each with each
FIRST_GUESS, STEP, PRECISION, TRIES = 0.8, 0.85, 1.01, 40  # search for the greatest density
ROUGHLY = 1.1  # how far the search goes that only finds out how charts lie best
BRUTE_FORCE, GAIN = 10**8, 1.08  # charts times texels; 0.3 s for each of 4 tries, which gained up to 3.5 %


class Packer:
    """Places charts on square pages at any density; the cutting is done."""

    def __init__(
        self, xatlas: object, triangles: np.ndarray, chart: np.ndarray, job: dict, say: Callable[[tuple], None]
    ) -> None:
        order = np.argsort(chart, kind="stable")
        self.xatlas, self.say, self.triangles, self.chart = xatlas, say, triangles[order], chart[order]
        self.size, self.padding, self.seconds = int(job["size"]), int(job["padding"]), float(job["pack_seconds"])
        self.count = int(self.chart[-1]) + 1
        self.turned = np.zeros(self.count, bool)  # which charts stand a quarter turn from how they were cut
        self.area = 0.5 * float(np.abs(twice_areas(self.triangles)).sum())
        self.tries, self.brute_force, self.may_swap = 0, False, False
        self._measure()

    def _measure(self) -> None:
        """Find the extent of each chart and the corners that reach farthest."""
        points, of = self.triangles.reshape(-1, 2), np.repeat(self.chart, 3)
        after = np.searchsorted(of, np.arange(1, self.count + 1))
        self.right, self.top = (np.lexsort((points[:, axis], of))[after - 1] for axis in (0, 1))
        self.left = np.lexsort((-points[:, 0], of))[after - 1]
        self.extent = np.stack([points[self.right, 0], points[self.top, 1]], 1)

    def turn(self, wanted: np.ndarray) -> None:
        """Turn charts so that those `wanted` (n,) stand a quarter turn from how they were cut, the others as cut."""
        now = self.turned != wanted
        back = self.turned & now
        for which, turn in ((now & ~back, quarter_turn), (back, quarter_turn_back)):
            of = which[self.chart]
            shape = self.triangles[of]
            self.triangles[of] = turn(shape, self.extent[self.chart[of], None])
        self.turned = wanted
        self._measure()

    def pack(self, density: float) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Number of pages; page (n,) int, corner (n, 2) in texels and whether x and y are exchanged, of each chart.

        Only where `may_swap` is set are x and y exchanged: that mirrors a chart, so it serves to find out how charts
        lie best.
        """
        faulthandler.dump_traceback_later(ORPHANED * self.seconds, exit=True)
        self.say(("pack", self.tries))
        self.tries += 1
        shapes, chart = self._shapes(density)
        options = self.xatlas.PackOptions()
        # xatlas widens every chart by its padding, so that two of them are twice as far apart.
        options.resolution, options.padding, options.texels_per_unit = self.size, (self.padding + 1) // 2, 1.0
        options.rotate_charts_to_axis, options.bruteForce = False, self.brute_force
        options.rotate_charts = self.may_swap
        atlas, groups = self.xatlas.Atlas(), []
        cuts = np.searchsorted(chart, np.arange(0, self.count + CHARTS_PER_GROUP, CHARTS_PER_GROUP))
        for first, last in itertools.pairwise(cuts):
            uv = np.ascontiguousarray(shapes[first:last].reshape(-1, 2), np.float32)
            index = np.arange(len(uv), dtype=np.uint32).reshape(-1, 3)
            # Kept alive: xatlas takes arrays at the same address for the same mesh.
            groups.append((uv, index, np.ascontiguousarray(chart[first:last, None], np.uint32)))
            atlas.add_uv_mesh(*groups[-1])
        atlas.generate(pack_options=options)
        retire(atlas)
        uv = np.concatenate([atlas.get_mesh(i)[2] for i in range(len(groups))])
        page, part = np.concatenate([atlas.get_mesh_vertex_assignment(i) for i in range(len(groups))], 1)
        anchor = 3 * np.searchsorted(chart, np.arange(self.count))  # the first triangle of each chart
        a, b = (uv[anchor + i].astype(np.float64) * self.size for i in (0, 1))
        of = np.repeat(chart, 3)[part != NONE]
        if (part[anchor][of] != part[part != NONE]).any():
            raise RuntimeError("a chart fell apart while it was packed")
        swapped = (b - a)[:, 1] > (b - a)[:, 0]
        before = shapes.reshape(-1, 2)[anchor]
        before[swapped] = before[swapped][:, ::-1]
        corner = np.floor(a - before) + 0.5  # xatlas puts lowest corners on centres of texels
        return atlas.atlas_count, page[anchor].astype(np.int64), corner, swapped

    def _shapes(self, density: float) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (n, 3, 2) in texels that show xatlas where charts are, and their charts, ascending.

        Each chart begins with a small triangle at its left to find it again. Two reach out to whole texels, else
        xatlas would stretch the chart. Triangles too small for xatlas to see are replaced by wider ones.
        """
        triangles = np.round(self.triangles * (density / SNAP)) * SNAP
        points, every = triangles.reshape(-1, 2), np.arange(self.count)
        whole = np.maximum(np.ceil(self.extent * density), 1.0)
        left, right, top = points[self.left], points[self.right], points[self.top]
        x, y = np.eye(2) * NUDGE
        up = np.where(left[:, 1:] + NUDGE < whole[:, 1:], y, -y)
        anchor = np.stack([left, left + x, left + x + up], 1)
        end = np.stack([whole[:, 0], right[:, 1]], 1)
        right = np.stack([right, end, end + np.where(right[:, 1:] + NUDGE < whole[:, 1:], y, -y)], 1)
        end = np.stack([top[:, 0], whole[:, 1]], 1)
        top = np.stack([top, end, end + np.where(top[:, :1] + NUDGE < whole[:, :1], x, -x)], 1)
        unseen = np.abs(twice_areas(triangles)) < 2.0 * SEEN
        a, b = triangles[unseen][:, [0, 1]].reshape(-1, 2), triangles[unseen][:, [1, 2]].reshape(-1, 2)
        of = np.repeat(self.chart[unseen], 2)
        along = b - a
        across = np.stack([-along[:, 1], along[:, 0]], 1) / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
        across[np.einsum("ij,ij->i", across, 0.5 * whole[of] - a) < 0.0] *= -1.0
        wider = np.stack([a, b, np.clip(a + NUDGE * across, 0.0, whole[of])], 1)
        shapes = np.concatenate([anchor, right, top, triangles[~unseen], wider])
        chart = np.concatenate([every, every, every, self.chart[~unseen], of])
        order = np.argsort(chart, kind="stable")
        return shapes[order], chart[order]

    def densest(self) -> tuple[float, tuple]:
        """The greatest density at which one page holds all charts, and the placing there."""
        self.may_swap = True
        low, placed = self._search(FIRST_GUESS * self._most(), ROUGHLY)
        wide, self.may_swap = self.extent[:, 1] > self.extent[:, 0], False
        self.turn(placed[3])
        low, placed = self._search(low, PRECISION)
        turned = self.turned
        if (wide != turned).any():
            self.turn(wide)
            better = self.pack(PRECISION * low)
            if better[0] == 1:
                return self._refined(*self._between(PRECISION * low, min(GAIN * low, self._most()), better, PRECISION))
            self.turn(turned)
        return self._refined(low, placed)

    def at(self, density: float) -> tuple:
        """The placing on as many pages as this density takes."""
        self.may_swap = True
        placed = self.pack(density)
        self.may_swap = False
        self.turn(placed[3])
        return self.pack(density)

    def _most(self) -> float:
        """A density that no page can exceed."""
        return min(self.size / max(self.area, 1e-300) ** 0.5, (self.size - 1) / float(self.extent.max()))

    def _search(self, low: float, precision: float) -> tuple[float, tuple]:
        most = self._most()
        for _ in range(TRIES):
            placed = self.pack(low)
            if placed[0] == 1:
                return self._between(low, most, placed, precision)
            most, low = low, low * STEP
        raise Unplaceable("crowded", int(self.count))

    def _refined(self, low: float, placed: tuple) -> tuple[float, tuple]:
        """What trying every place gains, where that is quick."""
        if self.count * self.size**2 > BRUTE_FORCE:
            return low, placed
        self.brute_force = True
        return self._between(low, min(GAIN * low, self._most()), placed, PRECISION)

    def _between(self, low: float, most: float, placed: tuple, precision: float) -> tuple[float, tuple]:
        while most > precision * low:
            middle = (low * most) ** 0.5
            result = self.pack(middle)
            if result[0] == 1:
                low, placed = middle, result
            else:
                most = middle
        return low, placed


def quarter_turn(points: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Points (..., 2) of charts that reach from 0 to `extent` (..., 2), turned anticlockwise; from 0 again."""
    return np.stack([extent[..., 1] - points[..., 1], points[..., 0]], -1)


def quarter_turn_back(points: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """As `quarter_turn`, but clockwise."""
    return np.stack([points[..., 1], extent[..., 0] - points[..., 0]], -1)


def pack_cuts(xatlas: object, cuts: list[Cut], job: dict, say: Callable[[tuple], None]) -> dict[str, np.ndarray]:
    """Places the charts of all meshes; the arrays of the answer. `say` is told each try."""
    first = 0
    for cut in cuts:
        placed = np.flatnonzero(cut.chart >= 0)
        cut.chart[placed] = first + np.unique(cut.chart[placed], return_inverse=True)[1].reshape(-1)
        first = max(first, int(cut.chart.max(initial=-1)) + 1)
    triangles = np.concatenate([cut.uv[cut.corners] for cut in cuts])
    packer = Packer(xatlas, triangles, np.concatenate([cut.chart[cut.face] for cut in cuts]), job, say)
    density = float(job["density"])
    density, (pages, page, corner, _) = (density, packer.at(density)) if density else packer.densest()
    if pages > int(job["most_pages"]):
        raise Unplaceable("pages", int(pages))
    result = {"density": np.array(density), "pages": np.array(pages)}
    for i, cut in enumerate(cuts):
        of = np.repeat(cut.chart, np.diff(cut.face_start))
        placed = of >= 0
        of = of[placed]
        uv = cut.uv[placed]
        turned = packer.turned[of]
        uv[turned] = quarter_turn(uv[turned], packer.extent[of[turned], ::-1])
        uv *= density
        result[f"uv{i}"] = np.zeros((len(cut.uv), 2), np.float32)
        result[f"uv{i}"][placed] = (uv + corner[of]) / packer.size
        result[f"chart{i}"] = cut.chart.astype(np.int32)
        result[f"page{i}"] = np.where(cut.chart >= 0, page[cut.chart], -1).astype(np.int32)
        result[f"folded{i}"] = np.array([len(cut.folded), cut.unchecked])
    return result
