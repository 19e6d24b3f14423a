"""The estimator: casts the rays of every patch and turns what they meet into obscurances.

W(i) = 1/N_i sum_j rho_j R_j over N_i cosine-distributed rays (eq. 6), where rays that meet nothing nearer than d_max
count as R_ave. Hit sums and miss counts are kept apart, so that a new R_ave or a new colour needs no new ray.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..falloff import Falloff, apply_falloff
from ..sampling import allocate_rays
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, FAR, NEAR, Hits, PatchSamples, TracedScene, pass_doubled_faces
from ..workers import workers
from .layers import Layered, sum_layers

MOST_TIMES = 16  # more rays for patches that are partly hidden, at most
_OTHER_POINTS = 1 << 16  # replicates from here on are those of such rays
_MISS, _DROPPED, _NEARNESS = 4, 5, 6  # columns of the cell sums behind rho R_red, rho R_green, rho R_blue, rho
_TINT = slice(-3, None)  # the last ones, where something is transparent

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
        Share of rays that met nothing nearer than d_max, or of their light, without colour.
    valid : ndarray, (p,) float64
        Share of rays that did not start inside of a solid; 0 where a patch has no usable surface or is all inside.
    rays : int
        Number of rays cast, repeated ones included.
    nearness : ndarray, (p,) float64, or None
        Mean of 1 / distance over the rays, those that miss taken to d_max: the reciprocal of the harmonic mean
        distance, in normalised units. Known where it was asked for, as is
    nearest : ndarray, (p,) float64, or None
        the shortest distance.
    tint : ndarray, (p, 3) float64, or None
        What coloured transparent surfaces add to `miss` per RGB channel; None where nothing is transparent.
    """

    hit: np.ndarray
    miss: np.ndarray
    valid: np.ndarray
    rays: int
    nearness: np.ndarray | None = None
    nearest: np.ndarray | None = None
    tint: np.ndarray | None = None

    def grey(self) -> np.ndarray:
        """Obscurances without colour (eq. 2), (p,) float64 in 0 .. 1; NaN for invalid patches."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return (self.hit[:, 3] + self.miss) / self.valid

    def coloured(self, r_ave: np.ndarray) -> np.ndarray:
        """Obscurances with colour bleeding (eqs. 5, 6) for the mean reflectance (3,); (p, 3), NaN if invalid."""
        with np.errstate(invalid="ignore", divide="ignore"):
            # In this order a patch whose rays all miss is R_ave to the last bit.
            return self.hit[:, :3] / self.valid[:, None] + self.missed() / self.valid[:, None] * r_ave

    def missed(self) -> np.ndarray:
        """Share of the light that met nothing nearer than d_max, (p, 1) float64, or (p, 3) where it may be coloured."""
        return self.miss[:, None] if self.tint is None else self.miss[:, None] + self.tint


def gather_obscurances(
    scene: TracedScene,
    ids: np.ndarray,
    settings: BakeSettings,
    *,
    replicate: int = 0,
    progress: Progress | None = None,
    block_rays: int = BLOCK_RAYS,
    with_distances: bool = False,
    rays: np.ndarray | None = None,
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
    with_distances : bool
        Ask how far the surroundings are as well.
    rays : ndarray, (p,) int, optional
        Rays of each patch, instead of what the settings say.

    Returns
    -------
    ObscuranceSums
        Bit for bit the same for any number of threads and any block size.
    """
    caster = Caster(scene, ids, settings, replicate, progress or _ignore, block_rays, with_distances, rays)
    caster.cast_all()
    return caster.patch_sums()


def _ignore(_rays: int) -> None:
    return None


class Caster:
    """Sums per cell, filled block by block; every block writes its own cells, so threads need no lock.

    Parameters as for `gather_obscurances`. Where the answers to the rays come from, subclasses may decide, and how
    samples are made, as of `PatchSamples`.
    """

    keeps_tables = False
    favours_directions = False

    def __init__(
        self,
        scene: TracedScene,
        ids: np.ndarray,
        settings: BakeSettings,
        replicate: int = 0,
        progress: Progress = _ignore,
        block_rays: int = BLOCK_RAYS,
        with_distances: bool = False,
        rays: np.ndarray | None = None,
    ) -> None:
        self.scene = scene
        self.progress = progress
        self.block_rays = block_rays
        self.rays = 0
        self._per_patch = allocate_rays(scene.cells.area, settings) if rays is None else rays
        self._ids, self._settings, self._replicate = ids, settings, replicate
        self.samples = self._make_samples(self._per_patch, replicate)
        columns = 6 + with_distances + 3 * (scene.transparency is not None)
        self.sums = np.zeros((columns, len(scene.cells.patch)))
        self.nearest = np.full(len(scene.cells.patch), FAR, np.float64) if with_distances else None
        self._is_afresh = False
        self._asked = np.zeros(len(scene.cells.patch), np.int64)  # rays that asked bodies, by the first cell of a block

    def _make_samples(self, per_patch: np.ndarray, replicate: int) -> PatchSamples:
        how = {"keeps_tables": self.keeps_tables, "favours_directions": self.favours_directions}
        return PatchSamples(self.scene.cells, self._ids, per_patch, self._settings, replicate, self.block_rays, **how)

    def cast(self, cells: np.ndarray, thorough: bool = False) -> None:
        """Add all rays of the cells (m,) int to their sums, in passes over the ray sequence.

        Whether a ray starts inside of a solid, its first hit tells, or where that is `thorough`, each body.
        """
        self.rays += self.samples.run(cells, lambda block, samples: self._cast_block(block, samples, thorough))

    def _cast_block(self, cells: np.ndarray, samples: np.ndarray, thorough: bool) -> None:
        """Cast the rays of samples (5, m, n) from cells (m,) and add what they meet to the sums."""
        scene, n = self.scene, samples.shape[2]
        origins, directions = self.samples.origins(cells, samples), self.samples.directions(cells, samples)
        limits = self.samples.scratch.array("limits", (len(origins),))
        limits.fill(scene.limit)
        if scene.needs_only_occlusion and self.nearest is None:
            blocked = self.blocked(cells, origins, directions, limits).reshape(-1, n)
            self.sums[_MISS, cells] += n - np.count_nonzero(blocked, axis=1)
            self.progress(len(origins))
            return
        inside = self._start_inside(cells, origins, directions) if thorough else None
        if self._is_afresh:  # what starts inside need not be traced
            limits[inside] = 0.0
            self._asked[cells[0]] -= np.count_nonzero(inside)
        hits, dropped = self.first_hits(cells, origins, directions, limits)
        layered = self.layered(cells, origins, directions, hits, dropped, inside)
        if inside is not None:
            dropped = inside
            hits.distance[inside] = scene.limit
        self._weigh(cells, n, hits.distance, hits.triangle, dropped, layered)
        self.progress(len(origins))

    def _start_inside(self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(m n,) bool: which rays of the cells (m,), n of each, start inside of a solid."""
        inside, cast = self.scene.bodies.start_inside(
            origins, directions, self.scene.rooms_of(cells, len(origins) // len(cells))
        )
        self._asked[cells[0]] += cast
        return inside

    def blocked(self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        """(m n,) bool: which rays of the cells (m,), n of each, meet anything nearer than their limit."""
        return self.scene.intersector.occluded(origins, directions, limits)

    def first_hits(
        self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray
    ) -> tuple[Hits, np.ndarray | None]:
        """What the rays of the cells (m,), n of each, meet nearer than d_max, of which `limits` (m n,) is full.

        Returns
        -------
        hits : Hits
            Of m n rays, doubled faces passed.
        dropped : ndarray, (m n,) bool, or None
            Rays that meet the inside of a solid first; None where there is no solid.
        """
        hits = self.scene.intersector.intersect(origins, directions, limits)
        pass_doubled_faces(self.scene, cells, len(origins) // len(cells), origins, directions, self.scene.limit, hits)
        if self.scene.bodies is None:
            return hits, None
        return hits, self.scene.meets_inside(directions, hits, self.scene.rooms_of(cells, len(origins) // len(cells)))

    def layered(
        self,
        cells: np.ndarray,
        origins: np.ndarray,
        directions: np.ndarray,
        hits: Hits,
        dropped: np.ndarray | None,
        inside: np.ndarray | None = None,
    ) -> Layered | None:
        """What rays of the cells (m,) meet one after the other whose first hit is transparent; None where nothing is.

        Enters in `dropped` those that turn out to meet the inside of a solid first; `inside` as for `sum_layers`.
        """
        if self.scene.transparency is None:
            return None
        rooms = self.scene.rooms_of(cells, len(origins) // len(cells))
        layered = sum_layers(self.scene, origins, directions, hits, rooms, inside)
        if dropped is not None:
            dropped[layered.rays] = layered.inside
        return layered

    def _weigh(
        self,
        cells: np.ndarray,
        n: int,
        distance: np.ndarray,
        triangle: np.ndarray,
        dropped: np.ndarray | None,
        layered: Layered | None,
    ) -> None:
        """Add what the rays met, by distance and colour, to the sums of their cells."""
        scene, sums = self.scene, self.sums
        no_miss = triangle >= 0
        if layered is not None:
            no_miss[layered.rays] = True
            self._add_layers(cells, n, layered)
        if self.nearest is not None:
            of_cell = np.maximum(distance, NEAR).reshape(-1, n)
            sums[_NEARNESS, cells] += (1.0 / of_cell).sum(1)
            self.nearest[cells] = np.minimum(self.nearest[cells], of_cell.min(1))
        if dropped is not None:
            sums[_DROPPED, cells] += np.count_nonzero(dropped.reshape(-1, n), axis=1)
            no_miss |= dropped
        if scene.falloff is not Falloff.STEP:  # of which a hit adds nothing
            distance *= scene.scale
            rho = apply_falloff(scene.falloff, distance)
            if dropped is not None:
                rho[dropped] = 0.0
            if layered is not None:
                rho[layered.rays] = 0.0
            self._add_hits(cells, n, rho, triangle)
        sums[_MISS, cells] += n - np.count_nonzero(no_miss.reshape(-1, n), axis=1)

    def _add_hits(self, cells: np.ndarray, n: int, rho: np.ndarray, triangle: np.ndarray) -> None:
        """Add rho (m n,), times the colours of the triangles hit, to the sums."""
        if self.scene.palette is not None:
            colours = self.samples.scratch.array("colours", (len(triangle), 4))
            np.take(self.scene.palette, np.add(triangle, 1, dtype=np.intp), axis=0, mode="clip", out=colours)
            self.sums[:4, cells] += np.matmul(rho.reshape(-1, 1, n), colours.reshape(-1, n, 4))[:, 0].T
        else:
            rho *= triangle >= 0
            self.sums[3, cells] += rho.reshape(-1, n).sum(1)

    def _add_layers(self, cells: np.ndarray, n: int, layered: Layered) -> None:
        """Add what rays found that passed transparent surfaces; ray by ray, so that blocks make no difference."""
        of = layered.rays // n
        tint = layered.miss[:, :3] - layered.miss[:, 3:]
        columns = np.column_stack([layered.hit, layered.miss[:, 3], tint]).T
        added = np.stack([np.bincount(of, column, len(cells)) for column in columns])
        self.sums[: _MISS + 1, cells] += added[: _MISS + 1]
        self.sums[_TINT, cells] += added[_MISS + 1 :]

    def cast_all(self) -> None:
        """Add all rays of all cells to their sums.

        The bodies are asked about every ray of patches of which some meet the inside of a solid first, or the first one
        starts inside of a body; where all meet the inside of a solid there is nothing to ask.
        """
        patch = self.scene.cells.patch
        cells = np.arange(len(patch))
        if self.scene.bodies is None:
            self.cast(cells)
            return
        self.cast(cells)
        total = len(self.scene.cells.area)
        dropped, count = (np.bincount(patch, of_cell, total) for of_cell in (self.sums[_DROPPED], self.samples.count))
        is_hidden = dropped == count
        first_cells = np.flatnonzero(np.diff(patch, prepend=-1))
        suspect = self._first_rays_inside(first_cells[(dropped == 0.0)[patch[first_cells]]])
        suspect |= (dropped > 0.0) & ~is_hidden
        again = np.flatnonzero(suspect[patch])
        self.sums[:, again] = 0.0
        if self.nearest is not None:
            self.nearest[again] = FAR
        self.cast(again, thorough=True)
        self._cast_more(again)
        self.rays += int(self._asked.sum())

    def _cast_more(self, cells: np.ndarray) -> None:
        """Cast anew, with more rays, those of the cells (m,) int whose patch is partly hidden.

        Few of their rays count. The points are others, so that what the first ones met, which decides on the number,
        is no part of the value.
        """
        scene, patch = self.scene, self.scene.cells.patch
        dropped = self.sums[_DROPPED, cells] / self.samples.count[cells] * scene.cells.weight[cells]
        exposed = np.ones(len(scene.cells.area))
        exposed -= np.bincount(patch[cells], dropped, len(exposed))
        times = self.more_rays(exposed)
        again = cells[times[patch[cells]] > 1]
        if len(again):
            self.samples = self._make_samples(self._per_patch * times, self._replicate + _OTHER_POINTS)
            self.sums[:, again] = 0.0
            if self.nearest is not None:
                self.nearest[again] = FAR
            self.cast_afresh(again)

    @staticmethod
    def more_rays(exposed: np.ndarray) -> np.ndarray:
        """How many times the usual rays patches get of which a share (p,) is outside of solids, (p,) int64."""
        times = 2 ** np.rint(-np.log2(np.clip(exposed, 1.0 / MOST_TIMES, 1.0))).astype(np.int64)
        return np.where(exposed < 1e-9, 1, times)

    def cast_afresh(self, cells: np.ndarray) -> None:
        """Add all rays of the cells (m,) int, which were not cast before, to their sums."""
        self._is_afresh = True
        self.cast(cells, thorough=True)

    def _first_rays_inside(self, cells: np.ndarray) -> np.ndarray:
        """(p,) bool: patches of the cells (m,) int whose first ray starts inside of a body."""
        inside = np.zeros(len(self.scene.cells.area), bool)
        blocks = [cells[at : at + self.block_rays] for at in range(0, len(cells), self.block_rays)]

        def ask(block: np.ndarray) -> np.ndarray:
            samples = self.samples.first(block)
            rays = self.samples.origins(block, samples), self.samples.directions(block, samples)
            return block[self._start_inside(block, *rays)]

        with workers(self.samples.threads if len(blocks) > 1 else 0) as pool:
            for found in pool.map(ask, blocks):
                inside[self.scene.cells.patch[found]] = True
        return inside

    def patch_sums(self) -> ObscuranceSums:
        """Cells weighed by area into patches."""
        cells, count = self.scene.cells, self.samples.count
        columns = [
            np.bincount(cells.patch, column / count * cells.weight, len(cells.area))  # a whole share is exact
            for column in self.sums
        ]
        valid = np.bincount(cells.patch, cells.weight, len(cells.area)) - columns[_DROPPED]
        valid[valid < 1e-9] = 0.0  # rounding left by weights whose rays were all dropped
        nearness = nearest = None
        if self.nearest is not None:
            nearness, nearest = columns[_NEARNESS], np.full(len(cells.area), FAR, np.float64)
            np.minimum.at(nearest, cells.patch, self.nearest)
        tint = None if self.scene.transparency is None else np.stack(columns[_TINT], -1)
        return ObscuranceSums(np.stack(columns[:4], -1), columns[_MISS], valid, self.rays, nearness, nearest, tint)
