"""First hits of rays among what stands still, kept from one update to the next: 8 bytes a ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RAY_BYTES = 8
NO_SLOT = -1
NEVER = -2  # instead of a slot: rays of the cell pass through doubled faces, what they meet behind depends on movers
_FIRST_RAYS = 1 << 16  # room made at first; it doubles whenever it is used up
_WASTE = 0.25  # share of a full pool that must be of no more use before all of it is given up


@dataclass(frozen=True)
class KeptHits:
    """What n rays meet first among what stands still.

    Attributes
    ----------
    distance : ndarray, (n,) float32
        Distance of the hit, or the ray's limit.
    triangle : ndarray, (n,) int32
        Negative for none.
    inside : ndarray, (n,) bool
        Rays that start inside of a solid. It is kept because normals are not: Embree's depend on the ray in their last
        bits.
    """

    distance: np.ndarray
    triangle: np.ndarray
    inside: np.ndarray


class HitCache:
    """A pool of rays in which each cell that is kept has a slot: the place of its first ray.

    Parameters
    ----------
    ceiling_bytes : int
        What the pool may hold; beyond, nothing more is kept.
    """

    def __init__(self, ceiling_bytes: int) -> None:
        self._ceiling = max(ceiling_bytes, 0) // RAY_BYTES
        self.clear()

    def clear(self) -> None:
        """Forget all; slots are void."""
        self._distance, self._code = np.empty(0, np.float32), np.empty(0, np.int32)
        self._used = self._wasted = 0
        self.is_full = False

    @property
    def bytes(self) -> int:
        """Bytes of the rays kept, those of no more use included."""
        return self._used * RAY_BYTES

    @property
    def is_clogged(self) -> bool:
        """Whether the pool is full and much of it of no more use."""
        return self.is_full and self._wasted > _WASTE * self._used

    def reserve(self, counts: np.ndarray) -> np.ndarray:
        """Slots (m,) int64 for cells with so many rays each, (m,) int; NO_SLOT for those that no room is left for."""
        end = self._used + np.cumsum(counts)
        fits = end <= self._ceiling
        self.is_full |= not fits.all()
        self._used = int(end[fits][-1]) if fits.any() else self._used
        if self._used > len(self._code):
            room = min(max(2 * len(self._code), self._used, _FIRST_RAYS), self._ceiling)
            self._distance, self._code = (_grown(a, room) for a in (self._distance, self._code))
        return np.where(fits, end - counts, NO_SLOT)

    def waste(self, rays: int) -> None:
        """That many of the rays kept are of no more use."""
        self._wasted += rays

    def write(self, slots: np.ndarray, hits: KeptHits) -> None:
        """Keep the hits of cells with slots (m,), of the same number of rays each."""
        at = _places(slots, len(hits.distance) // len(slots))
        self._distance[at] = hits.distance
        self._code[at] = 2 * hits.triangle + hits.inside

    def read(self, slots: np.ndarray, n: int) -> KeptHits:
        """What was kept for cells with slots (m,) and n rays each."""
        at = _places(slots, n)
        code = self._code[at]
        return KeptHits(self._distance[at], code >> 1, (code & 1).astype(bool))

    def places_of(self, first: int, end: int) -> np.ndarray:
        """Places (k,) int, ascending, of all rays that hit one of the triangles `first` .. `end` - 1."""
        code = self._code[: self._used]
        return np.flatnonzero((code >= 2 * first) & (code < 2 * end))


def _grown(array: np.ndarray, size: int) -> np.ndarray:
    larger = np.empty(size, array.dtype)
    larger[: len(array)] = array
    return larger


def _places(slots: np.ndarray, n: int) -> np.ndarray:
    return (slots[:, None] + np.arange(n)).ravel()
