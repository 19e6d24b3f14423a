"""Several ray tracers that answer as one over all their triangles: the nearest hit of all is the first one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .ray_casting import MISS, Hits, Intersector


@dataclass(frozen=True)
class Layer:
    """Some of the triangles of a scene.

    Attributes
    ----------
    intersector : Intersector
    ids : ndarray, (t,) int32
        Number in the whole scene of each of its triangles.
    """

    intersector: Intersector
    ids: np.ndarray

    def nearer(self, origins: np.ndarray, directions: np.ndarray, hits: Hits) -> Hits:
        """`hits` where they are nearer than those in this layer, else these; `hits` is overwritten."""
        found = self.intersector.intersect(origins, directions, hits.distance)
        met = np.flatnonzero(found.triangle >= 0)
        hits.triangle[met] = self.ids[found.triangle[met]]
        hits.normal[met] = found.normal[met]
        return Hits(found.distance, hits.triangle, hits.normal)


class LayeredIntersector:
    """An `Intersector` over the triangles of all layers.

    It gives the distance, bit for bit, that one ray tracer over all of them would give, for a hit depends on nothing
    but the ray and the triangle. Where two triangles are met at exactly the same distance either may be told, as with
    one ray tracer.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        self.layers = layers

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        hits = nothing(limits)
        for layer in self.layers:
            hits = layer.nearer(origins, directions, hits)
        return hits

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        blocked = np.zeros(len(origins), bool)
        for layer in self.layers:
            blocked |= layer.intersector.occluded(origins, directions, limits.copy())
        return blocked


def nothing(limits: np.ndarray) -> Hits:
    """The hits of rays that reach their limits (n,) float32, which are not copied."""
    return Hits(limits, np.full(len(limits), MISS, np.int32), np.zeros((len(limits), 3), np.float32))
