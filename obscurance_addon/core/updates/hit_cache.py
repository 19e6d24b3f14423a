"""First hits of rays among what stands still, kept from one update to the next: 8 bytes a ray.

Behind the rays of each cell there is room for what they add up to, so that a cell none of whose rays meets a mover need
not be weighed again. These sums come from one pass over the rays in single precision, which holds them exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RAY_BYTES = 8
SUMS = 6  # numbers that a cell adds up to; each takes the room of a ray
NO_SLOT = -1
# Instead of a slot: rays of the cell pass doubled or transparent faces, and what they meet behind depends on movers.
NEVER = -2
_UNKNOWN = -3  # negative codes below that of a miss
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
        self._known = _UNKNOWN - 1  # code behind the rays of cells whose sums are those of the present colours

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
        counts = counts + SUMS
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

    def forget_sums(self) -> None:
        """What stands still has other colours."""
        self._known -= 1

    def write(self, slots: np.ndarray, hits: KeptHits) -> None:
        """Keep the hits of cells with slots (m,), of the same number of rays each."""
        n = len(hits.distance) // len(slots)
        at = _places(slots, n)
        self._distance[at] = hits.distance
        self._code[at] = 2 * hits.triangle + hits.inside
        self._code[slots + n] = _UNKNOWN

    def read(self, slots: np.ndarray, n: int) -> KeptHits:
        """What was kept for cells with slots (m,) and n rays each."""
        at = _places(slots, n)
        code = self._code[at]
        return KeptHits(self._distance[at], code >> 1, (code & 1).astype(bool))

    def distances(self, slots: np.ndarray, n: int) -> np.ndarray:
        """Only the distances of `read`."""
        return self._distance[_places(slots, n)]

    def write_sums(self, slots: np.ndarray, n: int, sums: np.ndarray) -> None:
        """Keep the sums (SUMS, m) of cells with slots (m,) and n rays each, with the present colours."""
        self._distance[_places(slots + n, SUMS)] = sums.T.ravel()
        self._code[slots + n] = self._known

    def read_sums(self, slots: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Which cells with slots (m,) have sums, (m,) bool, and the sums (SUMS, m) of all, void for the others."""
        return self._code[slots + n] == self._known, self._distance[_places(slots + n, SUMS)].reshape(-1, SUMS).T

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
