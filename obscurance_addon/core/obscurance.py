"""The estimator: casts the rays of every patch and turns what they meet into obscurances.

W(i) = 1/N_i sum_j rho_j R_j over N_i cosine-distributed rays (eq. 6), where rays that meet nothing nearer than d_max
count as R_ave. Hit sums and miss counts are kept apart, so that a new R_ave or a new colour needs no new ray.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .falloff import apply_falloff
from .first_hits import pass_doubled_faces, starts_inside
from .ray_allocation import allocate_rays, split_rays
from .sampling import SCRAMBLES, ray_table
from .settings import BakeSettings, Sampler
from .sobol import hash32
from .traced_scene import FAR, TracedScene

BLOCK_RAYS = 32768  # per task: smaller ones pay Python's overhead, larger ones gain nothing and use more memory
TABLE_ROWS = 1024  # rays of a sequence held at a time, so that memory does not grow with the number of rays

_MISS, _DROPPED = 4, 5  # columns of the cell sums behind rho R_red, rho R_green, rho R_blue, rho

Progress = Callable[[int], None]


@dataclass(frozen=True)
class ObscuranceSums:
    """What the rays of each patch met, as shares of all rays of the patch, cells weighed by area.

    Attributes
    ----------
    hit : ndarray, (p, 4) float64
        Mean of rho R per RGB channel and of rho over rays that hit, times their share. Without bleeding the first three
        columns are 0.
    miss : ndarray, (p,) float64
        Share of rays that met nothing nearer than d_max.
    valid : ndarray, (p,) float64
        Share of rays that did not start inside of a solid; 0 where a patch has no usable surface or is all inside.
    rays : int
        Number of rays cast, repeated ones included.
    """

    hit: np.ndarray
    miss: np.ndarray
    valid: np.ndarray
    rays: int

    def grey(self) -> np.ndarray:
        """Obscurances without colour (eq. 2), (p,) float64 in 0 .. 1; NaN for invalid patches."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return (self.hit[:, 3] + self.miss) / self.valid

    def coloured(self, r_ave: np.ndarray) -> np.ndarray:
        """Obscurances with colour bleeding (eqs. 5, 6) for the mean reflectance (3,); (p, 3), NaN if invalid."""
        with np.errstate(invalid="ignore", divide="ignore"):
            # In this order a patch whose rays all miss is R_ave to the last bit.
            return self.hit[:, :3] / self.valid[:, None] + (self.miss / self.valid)[:, None] * r_ave


def gather_obscurances(
    scene: TracedScene,
    ids: np.ndarray,
    settings: BakeSettings,
    *,
    replicate: int = 0,
    progress: Progress | None = None,
    block_rays: int = BLOCK_RAYS,
) -> ObscuranceSums:
    """Cast the rays of all patches that have cells, and sum what they meet.

    Parameters
    ----------
    scene : TracedScene
    ids : ndarray, (p,) uint32
        Stable identity of each patch.
    settings : BakeSettings
    replicate : int
        0 for the bake; other numbers give independent scramblings, for error estimates.
    progress : callable, optional
        Called from any thread with the number of rays just cast; may raise `BakeCancelledError`.
    block_rays : int
        Rays per task; the result does not depend on it.

    Returns
    -------
    ObscuranceSums
        Bit for bit the same for any number of threads and any block size.
    """
    caster = _Caster(scene, ids, settings, replicate, progress or _ignore, block_rays)
    caster.cast(np.arange(len(scene.cells.patch)))
    if scene.solid is not None:
        caster.recast_patches_inside_solids()
    return caster.patch_sums()


def _ignore(_rays: int) -> None:
    return None


class _Caster:
    """Sums per cell, filled block by block; every block writes its own cells, so threads need no lock."""

    def __init__(
        self,
        scene: TracedScene,
        ids: np.ndarray,
        settings: BakeSettings,
        replicate: int,
        progress: Progress,
        block_rays: int,
    ) -> None:
        self.scene = scene
        self.sampler: Sampler = settings.sampler
        self.seed = int(hash32(np.uint32(settings.seed) ^ hash32(np.uint32(replicate))))
        self.threads = settings.thread_count()
        self.progress = progress
        self.block_rays = block_rays
        self.rays = 0
        cells = scene.cells
        self.start, self.count = split_rays(cells.patch, cells.weight, allocate_rays(cells.area, settings))
        self.scramble = (hash32(ids.astype(np.uint32) ^ np.uint32(self.seed)) % np.uint32(SCRAMBLES)).astype(np.int64)
        self.sums = np.zeros((6, len(cells.patch)))
        self.scratch = _Scratch()

    def cast(self, cells: np.ndarray, unbounded: bool = False) -> None:
        """Add all rays of the cells (m,) int to their sums, in passes over the ray sequence."""
        if not len(cells):
            return
        start, end = self.start[cells], self.start[cells] + self.count[cells]
        sets, row_of_set = self._point_sets(cells)
        with ThreadPoolExecutor(self.threads) as pool:
            for first in range(0, int(end.max()), TABLE_ROWS):
                low, high = np.maximum(start, first), np.minimum(end, first + TABLE_ROWS)
                rows = min(TABLE_ROWS, int(end.max()) - first)
                table = ray_table(self.sampler, self.seed, sets, first, rows).reshape(-1, 6)
                tasks = []
                n_rays = np.maximum(high - low, 0)
                for n in np.flatnonzero(np.bincount(n_rays)[1:]) + 1:  # cells with the same number of rays go together
                    group = np.flatnonzero(n_rays == n)
                    base = row_of_set[group] * rows + low[group] - first
                    per_block = max(1, self.block_rays // int(n))
                    for at in range(0, len(group), per_block):
                        block = slice(at, at + per_block)
                        tasks.append((cells[group[block]], base[block], int(n)))
                self.rays += sum(len(block) * n for block, _, n in tasks)
                for _ in pool.map(lambda task, table=table: self._cast_block(table, *task, unbounded), tasks):
                    pass

    def _point_sets(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The point sets that the cells (m,) use, ascending, and for each cell the position of its set among them."""
        scramble = self.scramble[self.scene.cells.patch[cells]]
        used = np.bincount(scramble, minlength=SCRAMBLES) > 0
        return np.flatnonzero(used), (np.cumsum(used) - 1)[scramble]

    def _cast_block(self, table: np.ndarray, cells: np.ndarray, base: np.ndarray, n: int, unbounded: bool) -> None:
        """Cast rays `base` .. `base + n - 1` of the table from each cell and add what they meet to its sums."""
        scene = self.scene
        origins, directions = self._make_rays(cells, table, base, n)
        limit = FAR if unbounded else scene.limit
        limits = self.scratch.array("limits", (len(origins),))
        limits.fill(limit)
        if scene.needs_only_occlusion:
            blocked = scene.intersector.occluded(origins, directions, limits).reshape(-1, n)
            self.sums[_MISS, cells] += n - np.count_nonzero(blocked, axis=1)
            self.progress(len(origins))
            return
        hits = scene.intersector.intersect(origins, directions, limits)
        pass_doubled_faces(scene, cells, n, origins, directions, limit, hits)
        dropped = None
        if scene.solid is not None:
            dropped = starts_inside(scene, directions, hits)
            if unbounded:
                hits.triangle[(hits.distance >= scene.limit) & ~dropped] = -1
                np.minimum(hits.distance, scene.limit, out=hits.distance)
        self._weigh(cells, n, hits.distance, hits.triangle, dropped)
        self.progress(len(origins))

    def _make_rays(self, cells: np.ndarray, table: np.ndarray, base: np.ndarray, n: int) -> tuple:
        """Origins and directions, each (m n, 3) float32, of n table rows from `base` (m,) on, in the cells' frames."""
        m, frames = len(cells), self.scene.cells.frames[cells]
        rows = self.scratch.array("rows", (m, n * 6))
        if len(table) % n == 0 and not (base % n).any():  # whole groups of rows are copied at once
            np.take(table.reshape(-1, n * 6), base // n, axis=0, mode="clip", out=rows)
        else:
            index = (base[:, None] + np.arange(n)).ravel()
            np.take(table, index, axis=0, mode="clip", out=rows.reshape(-1, 6))
        rows = rows.reshape(m, n, 6)
        origins = np.matmul(rows[..., :3], frames[..., :3], out=self.scratch.array("origins", (m, n, 3)))
        directions = np.matmul(rows[..., 3:], frames[..., 3:], out=self.scratch.array("directions", (m, n, 3)))
        return origins.reshape(-1, 3), directions.reshape(-1, 3)

    def _weigh(
        self, cells: np.ndarray, n: int, distance: np.ndarray, triangle: np.ndarray, dropped: np.ndarray | None
    ) -> None:
        """Add what the rays met, by distance and colour, to the sums of their cells."""
        scene, sums = self.scene, self.sums
        met = triangle >= 0
        distance *= scene.scale
        rho = apply_falloff(scene.falloff, distance)
        if dropped is not None:
            rho[dropped] = 0.0
            sums[_DROPPED, cells] += np.count_nonzero(dropped.reshape(-1, n), axis=1)
        if scene.palette is not None:
            colours = self.scratch.array("colours", (len(triangle), 4))
            np.take(scene.palette, np.add(triangle, 1, dtype=np.intp), axis=0, mode="clip", out=colours)
            sums[:4, cells] += np.matmul(rho.reshape(-1, 1, n), colours.reshape(-1, n, 4))[:, 0].T
        else:
            rho *= met
            sums[3, cells] += rho.reshape(-1, n).sum(1)
        sums[_MISS, cells] += n - np.count_nonzero(met.reshape(-1, n), axis=1)

    def recast_patches_inside_solids(self) -> None:
        """Cast without limit the rays of patches that may start inside of a solid farther than d_max from its walls.

        Suspect are patches with a ray that was dropped, and patches some of whose rays met nothing but of which one
        unlimited ray meets the inside of a solid.
        """
        if self.scene.limit == FAR:  # they had no limit
            return
        patch, n_patches = self.scene.cells.patch, len(self.scene.cells.area)
        suspect = np.bincount(patch, self.sums[_DROPPED], n_patches) > 0.0
        has_misses = np.bincount(patch, self.sums[_MISS], n_patches) > 0.0
        first_cell = np.unique(patch, return_index=True)[1]
        first_cell = first_cell[has_misses[patch[first_cell]] & ~suspect[patch[first_cell]]]
        for at in range(0, len(first_cell), self.block_rays):
            probes = first_cell[at : at + self.block_rays]
            suspect[patch[probes[self._probe(probes)]]] = True
        again = np.flatnonzero(suspect[patch])
        self.sums[:, again] = 0.0
        self.cast(again, unbounded=True)

    def _probe(self, cells: np.ndarray) -> np.ndarray:
        """(m,) bool: whether the first ray of each cell starts inside of a solid."""
        sets, row = self._point_sets(cells)
        table = ray_table(self.sampler, self.seed, sets, 0, 1).reshape(-1, 6)
        origins, directions = self._make_rays(cells, table, row, 1)
        hits = self.scene.intersector.intersect(origins, directions, np.full(len(origins), FAR, np.float32))
        self.rays += len(origins)
        return starts_inside(self.scene, directions, hits)

    def patch_sums(self) -> ObscuranceSums:
        """Cells weighed by area into patches."""
        cells = self.scene.cells
        columns = [
            np.bincount(cells.patch, column / self.count * cells.weight, len(cells.area))  # a whole share is exact
            for column in self.sums
        ]
        valid = np.bincount(cells.patch, cells.weight, len(cells.area)) - columns[_DROPPED]
        valid[valid < 1e-9] = 0.0  # rounding left by weights whose rays were all dropped
        return ObscuranceSums(np.stack(columns[:4], -1), columns[_MISS], valid, self.rays)


class _Scratch(threading.local):
    """Arrays that each thread uses again for every block: fresh memory costs more than the work done in it."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An uninitialised float32 array, C-contiguous; the one of the same name from before is overwritten."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size, np.float32)
        return self._arrays[name][:size].reshape(shape)
