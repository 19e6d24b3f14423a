"""The caster of updates: what stands still answers from a cache, what moves is traced."""

from __future__ import annotations

import enum
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from ..obscurance import Caster, Progress
from ..settings import BakeSettings
from ..tracing import (
    MISS,
    TABLE_ROWS,
    Hits,
    Layer,
    TracedScene,
    meet_doubled_faces,
    nothing,
    pass_doubled_faces,
)
from .hit_cache import NEVER, NO_SLOT, SUMS, HitCache, KeptHits

_BLOCK_RAYS = 16384  # per task
# Of fewer rays, and of those whose static hits are known, most time goes into short steps of numpy, which threads only
# make longer by handing the interpreter lock to and fro.
_ALONE_RAYS = 1 << 16


class _Mode(enum.Enum):
    """Where the answers to the rays of a block come from."""

    CACHED = enum.auto()  # what stands still is known
    TO_KEEP = enum.auto()  # it is traced first, and kept
    IN_FULL = enum.auto()


@dataclass(frozen=True)
class MovingLayer:
    """Triangles that are traced in every update.

    Attributes
    ----------
    layer : Layer
    is_near : ndarray, (p,) bool
        Patches whose rays, as far as d_max, can reach it.
    """

    layer: Layer
    is_near: np.ndarray


class LayeredCaster(Caster):
    """A `Caster` that keeps what rays meet among what stands still, and traces only what moves where that is known.

    Parameters
    ----------
    scene : TracedScene
        Its intersector is over all layers.
    ids : ndarray, (p,) uint32
    settings : BakeSettings
    rays : ndarray, (p,) int
        Rays of each patch.
    static : Layer or None
        What stands still; None for nothing.
    moving : list of MovingLayer
        Everything else.
    cache : HitCache
    slots : ndarray, (c,) int64
        Slot of each cell in the cache, NO_SLOT or NEVER. Filled in where hits are kept.
    may_keep : ndarray, (c,) bool
        Cells whose hits may be kept.
    helper : Executor
        Traces beside this thread, where settings allow more than one, what is too little to begin threads for.

    Attributes
    ----------
    cached : int
        Rays whose hit among what stands still was known.
    """

    keeps_tables = True
    uses_kept_sums = True  # cells that meet no mover are not weighed again, and `first_hits` is not asked for them

    def __init__(
        self,
        scene: TracedScene,
        ids: np.ndarray,
        settings: BakeSettings,
        rays: np.ndarray,
        progress: Progress,
        static: Layer | None,
        moving: list[MovingLayer],
        cache: HitCache,
        slots: np.ndarray,
        may_keep: np.ndarray,
        helper: Executor,
    ) -> None:
        super().__init__(scene, ids, settings, progress=progress, block_rays=_BLOCK_RAYS, rays=rays)
        self.cached = 0
        self._static, self._moving, self._cache = static, moving, cache
        self.slots = slots
        self._may_keep = may_keep
        self._mode = _Mode.IN_FULL
        self._threads = self.samples.threads
        self._helper = helper if self._threads > 1 else None

    def cast(self, cells: np.ndarray, thorough: bool = False) -> None:
        slots, count = self.slots, self.samples.count
        known = slots[cells] >= 0
        to_keep = self._may_keep[cells] & (slots[cells] == NO_SLOT) & self.in_one_pass()[cells]
        keep = cells[to_keep]
        slots[keep] = self._cache.reserve(count[keep])
        to_keep[to_keep] = slots[keep] != NO_SLOT
        self.cached += int(count[cells[known]].sum())
        for mode, group in ((_Mode.CACHED, known), (_Mode.TO_KEEP, to_keep), (_Mode.IN_FULL, ~known & ~to_keep)):
            self._mode = mode
            alone = mode is _Mode.CACHED or count[cells[group]].sum() < _ALONE_RAYS
            self.samples.threads = 0 if alone else self._threads
            self.scene.intersector.helper = self._helper if alone else None
            super().cast(cells[group], thorough)
        self._cache.waste(int(count[keep[slots[keep] == NEVER]].sum()))

    def cast_afresh(self, cells: np.ndarray) -> None:
        self._mode = _Mode.IN_FULL
        self.samples.threads = 0 if self.samples.count[cells].sum() < _ALONE_RAYS else self._threads
        self.scene.intersector.helper = None
        self._is_afresh = True
        super().cast(cells, thorough=True)

    def in_one_pass(self) -> np.ndarray:
        """(c,) bool: cells whose rays are all handed out at once, so that their number tells which they are."""
        start, count = self.samples.start, self.samples.count
        return start // TABLE_ROWS == (start + count - 1) // TABLE_ROWS

    def _cast_block(self, cells: np.ndarray, samples: np.ndarray, thorough: bool) -> None:
        kept_sums = self.uses_kept_sums and self._mode is _Mode.CACHED
        if not kept_sums or thorough or self.scene.needs_only_occlusion:
            super()._cast_block(cells, samples, thorough)
            return
        n, slots = samples.shape[2], self.slots[cells]
        origins, directions = self.samples.origins(cells, samples), self.samples.directions(cells, samples)
        moved = nothing(self._cache.distances(slots, n))
        for layer in self._layers_near(cells):
            layer.nearer(origins, directions, moved, self._helper)
        touched = (moved.triangle >= 0).reshape(-1, n).any(1)
        known, sums = self._cache.read_sums(slots, n)
        still = known & ~touched
        self.sums[:SUMS, cells[still]] = sums[:, still]
        rest = np.flatnonzero(~still)
        if len(rest):
            origins, directions, distance, triangle, normal = (
                _rays_of(rest, n, rays) for rays in (origins, directions, moved.distance, moved.triangle, moved.normal)
            )
            kept = self._cache.read(slots[rest], n)
            hits = Hits(distance, np.where(triangle >= 0, triangle, kept.triangle), normal)
            dropped = self._finish(cells[rest], origins, directions, hits, kept.inside)
            layered = self.layered(cells[rest], origins, directions, hits, dropped)
            self._weigh(cells[rest], n, hits.distance, hits.triangle, dropped, layered)
            new = ~known & ~touched
            self._cache.write_sums(slots[new], n, self.sums[:SUMS, cells[new]])
        self.progress(len(cells) * n)

    def blocked(self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        if self._mode is _Mode.IN_FULL:
            return super().blocked(cells, origins, directions, limits)
        if self._mode is _Mode.CACHED:
            blocked = self._cache.read(self.slots[cells], len(origins) // len(cells)).triangle >= 0
        else:
            blocked = np.zeros(len(origins), bool)
            if self._static is not None:
                self._static.block(origins, directions, limits, blocked)
            kept = KeptHits(limits, np.where(blocked, 0, MISS).astype(np.int32), np.zeros(len(origins), bool))
            self._cache.write(self.slots[cells], kept)
        for layer in self._layers_near(cells):
            layer.block(origins, directions, limits, blocked)
        return blocked

    def first_hits(
        self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray
    ) -> tuple[Hits, np.ndarray | None]:
        if self._mode is _Mode.IN_FULL:
            return super().first_hits(cells, origins, directions, limits)
        n = len(origins) // len(cells)
        if self._mode is _Mode.CACHED:
            kept = self._cache.read(self.slots[cells], n)
            hits, inside = Hits(kept.distance, kept.triangle, np.zeros((len(origins), 3), np.float32)), kept.inside
        else:
            hits, inside = self._keep(cells, origins, directions, limits), None  # their normals tell
        for layer in self._layers_near(cells):
            layer.nearer(origins, directions, hits)
        return hits, self._finish(cells, origins, directions, hits, inside)

    def _finish(
        self,
        cells: np.ndarray,
        origins: np.ndarray,
        directions: np.ndarray,
        hits: Hits,
        inside: np.ndarray | None,
    ) -> np.ndarray | None:
        """Pass doubled faces, and tell which rays are dropped; `inside` (n,) bool is what the cache tells of that.

        Normals of hits from the cache are 0: no face doubles those, and cells that see doubled faces are not kept.
        """
        pass_doubled_faces(self.scene, cells, len(origins) // len(cells), origins, directions, self.scene.limit, hits)
        if self.scene.bodies is None:
            return None
        dropped = self.scene.bodies.left_first(directions, hits)
        if inside is not None:
            rays = np.flatnonzero(inside)
            dropped[rays] |= ~hits.normal[rays].any(1)
        self.scene.bodies.spare_rooms(dropped, hits, self.scene.rooms_of(cells, len(origins) // len(cells)))
        return dropped

    def _keep(self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        """First hits among what stands still, which the cache keeps from now on."""
        hits = nothing(limits)
        if self._static is not None:
            self._static.nearer(origins, directions, hits)
        inside = np.zeros(len(origins), bool)
        if self.scene.bodies is not None:
            inside = self.scene.bodies.left_first(directions, hits)
        self._cache.write(self.slots[cells], KeptHits(hits.distance, hits.triangle, inside))
        n = len(origins) // len(cells)
        self.slots[cells[meet_doubled_faces(self.scene, cells, n, hits) // n]] = NEVER
        if self.scene.transparency is not None:
            through = np.flatnonzero(self.scene.transparency.lets_through(hits.triangle))
            self.slots[cells[through // n]] = NEVER
        return hits

    def _layers_near(self, cells: np.ndarray) -> list[Layer]:
        patch = self.scene.cells.patch[cells]
        return [moving.layer for moving in self._moving if moving.is_near[patch].any()]


def _rays_of(cells: np.ndarray, n: int, rays: np.ndarray) -> np.ndarray:
    """Those of n rays each, (m n, ...), that belong to some of m cells, (k,) int."""
    return rays[(cells[:, None] * n + np.arange(n)).ravel()]
