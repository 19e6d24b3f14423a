"""Several ray tracers that answer as one over all their triangles: the nearest hit of all is the first one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .ray_casting import MISS, Hits, Intersector

_MARGIN = 1e-5  # share of coordinates and distances by which boxes grow: a hundred times the rounding of float32


@dataclass(frozen=True)
class Layer:
    """Some of the triangles of a scene.

    Attributes
    ----------
    intersector : Intersector
    ids : ndarray, (t,) int32
        Number in the whole scene of each of its triangles.
    boxes : list of ndarray (2, 3) float64, or None
        Around all its triangles: only rays towards one of these are traced. None traces all.
    """

    intersector: Intersector
    ids: np.ndarray
    boxes: list[np.ndarray] | None = None

    def nearer(self, origins: np.ndarray, directions: np.ndarray, hits: Hits) -> np.ndarray:
        """Overwrite `hits` where rays meet something nearer in this layer; returns the indices (k,) of these rays."""
        towards = self._towards(origins, directions, hits.distance)
        found = self.intersector.intersect(origins[towards], directions[towards], hits.distance[towards])
        met = np.flatnonzero(found.triangle >= 0)
        rays = met if self.boxes is None else towards[met]
        hits.distance[rays] = found.distance[met]
        hits.triangle[rays] = self.ids[found.triangle[met]]
        hits.normal[rays] = found.normal[met]
        return rays

    def block(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray, blocked: np.ndarray) -> None:
        """Enter in `blocked` (n,) bool the rays that meet anything in this layer nearer than their limits (n,)."""
        towards = self._towards(origins, directions, limits)
        blocked[towards] |= self.intersector.occluded(origins[towards], directions[towards], np.array(limits[towards]))

    def _towards(self, origins: np.ndarray, directions: np.ndarray, distance: np.ndarray) -> np.ndarray | slice:
        """Rays that may meet something in this layer."""
        if self.boxes is None:
            return slice(None)
        return np.flatnonzero(np.any([may_meet(box, origins, directions, distance) for box in self.boxes], axis=0))


def may_meet(box: np.ndarray, origins: np.ndarray, directions: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(n,) bool: rays that come into a box (2, 3), grown by more than float32 can be off, within a distance (n,)."""
    extent = max(float(np.abs(box).max()), float(origins.max()), -float(origins.min()))
    low, high = (box + _MARGIN * extent * np.array([[-1.0], [1.0]])).astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):  # what is not a number along an axis counts as met
        inverse = np.float32(1.0) / directions
        one, other = (low - origins) * inverse, (high - origins) * inverse
        enter, leave = np.minimum(one, other).T, np.maximum(one, other).T
        enter, leave = np.maximum(np.maximum(*enter[:2]), enter[2]), np.minimum(np.minimum(*leave[:2]), leave[2])
        return ~((enter > leave) | (leave < 0.0) | (enter > distance * np.float32(1.0 + _MARGIN)))


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
            layer.nearer(origins, directions, hits)
        return hits

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        blocked = np.zeros(len(origins), bool)
        for layer in self.layers:
            layer.block(origins, directions, limits, blocked)
        return blocked


def nothing(limits: np.ndarray) -> Hits:
    """The hits of rays that reach their limits (n,) float32, which are not copied."""
    return Hits(limits, np.full(len(limits), MISS, np.int32), np.zeros((len(limits), 3), np.float32))
