"""Several ray tracers that answer as one over all their triangles: the nearest hit of all is the first one."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from .intersector import MISS, Hits, Intersector

_WORTH_HELP = 4096  # rays: fewer are traced before another thread has begun


@dataclass(frozen=True)
class Layer:
    """Some of the triangles of a scene.

    Attributes
    ----------
    intersector : Intersector
    ids : ndarray, (t,) int32
        Number in the whole scene of each of its triangles.
    boxes : list of ndarray (2, 3) float64
        Around its objects.
    """

    intersector: Intersector
    ids: np.ndarray
    boxes: list[np.ndarray]

    def nearer(self, origins: np.ndarray, directions: np.ndarray, hits: Hits, helper: Executor | None = None) -> None:
        """Overwrite `hits` where rays meet something nearer in this layer; a helper traces half of them meanwhile."""
        n = len(origins)
        middle = n if helper is None or n < _WORTH_HELP else n // 2
        parts = [slice(0, middle)] + [slice(middle, n)] * (middle < n)
        rays = [(origins[part], directions[part], hits.distance[part].copy()) for part in parts]
        others = [helper.submit(self.intersector.intersect, *part) for part in rays[1:]]
        self._enter(parts[0], self.intersector.intersect(*rays[0]), hits)
        for part, other in zip(parts[1:], others, strict=True):
            self._enter(part, other.result(), hits)

    def _enter(self, part: slice, found: Hits, hits: Hits) -> None:
        met = np.flatnonzero(found.triangle >= 0)
        rays = met + part.start
        hits.distance[rays] = found.distance[met]
        hits.triangle[rays] = self.ids[found.triangle[met]]
        hits.normal[rays] = found.normal[met]

    def block(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray, blocked: np.ndarray) -> None:
        """Enter in `blocked` (n,) bool the rays that meet anything in this layer nearer than their limits (n,)."""
        blocked |= self.intersector.occluded(origins, directions, limits.copy())


class LayeredIntersector:
    """An `Intersector` over the triangles of all layers.

    It gives the distance, bit for bit, that one ray tracer over all of them would give, for a hit depends on nothing
    but the ray and the triangle. Where two triangles are met at exactly the same distance either may be told, as with
    one ray tracer.

    Attributes
    ----------
    helper : Executor or None
        Traces half of the rays of each call.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        self.layers = layers
        self.helper: Executor | None = None

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        hits = nothing(limits)
        for layer in self.layers:
            layer.nearer(origins, directions, hits, self.helper)
        return hits

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        blocked = np.zeros(len(origins), bool)
        for layer in self.layers:
            layer.block(origins, directions, limits, blocked)
        return blocked


def nothing(limits: np.ndarray) -> Hits:
    """The hits of rays that reach their limits (n,) float32, which are not copied."""
    return Hits(limits, np.full(len(limits), MISS, np.int32), np.zeros((len(limits), 3), np.float32))
