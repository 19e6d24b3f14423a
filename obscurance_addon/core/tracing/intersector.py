"""Casting rays: the one protocol that the estimator needs, and a brute-force reference that answers it.

The production intersector is `core.tracing.embree.EmbreeIntersector`; both give the same answers to the same tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

MISS = -1  # any negative triangle index means that the ray hit nothing


@dataclass(frozen=True)
class Hits:
    """First hits of a block of n rays.

    Attributes
    ----------
    distance : ndarray, (n,) float32
        Distance along the ray, or the ray's limit where nothing was hit.
    triangle : ndarray, (n,) int32
        Index of the triangle hit, negative where nothing was hit.
    normal : ndarray, (n, 3) float32
        Normal of the triangle hit by the order of its corners (right-handed), of any length; undefined for a miss.
    """

    distance: np.ndarray
    triangle: np.ndarray
    normal: np.ndarray


class Intersector(Protocol):
    """What the estimator asks of a ray tracer. Calls may come from several threads at once."""

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        """First hits nearer than each ray's limit; `limits` may be overwritten.

        Parameters
        ----------
        origins, directions : ndarray, (n, 3) float32
            Directions are unit vectors.
        limits : ndarray, (n,) float32
            Lengths beyond which nothing counts.
        """
        ...

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        """(n,) bool: whether anything at all is hit nearer than each ray's limit; parameters as in `intersect`."""
        ...


class BruteForceIntersector:
    """Every ray against every triangle in float64: slow, simple, the reference of the tests.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float
    triangles : ndarray, (t, 3) int
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._corner, second, third = np.asarray(vertices, np.float64)[triangles].transpose(1, 0, 2)
        self._edge1, self._edge2 = second - self._corner, third - self._corner
        self._normal = np.append(np.cross(self._edge1, self._edge2), np.zeros((1, 3)), axis=0)  # the last for MISS

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        distance = limits.astype(np.float64)
        triangle = np.full(len(origins), MISS, np.int32)
        for i, (corner, edge1, edge2) in enumerate(zip(self._corner, self._edge1, self._edge2, strict=True)):
            t = _moller_trumbore(origins.astype(np.float64), directions.astype(np.float64), corner, edge1, edge2)
            nearer = (t >= 0.0) & (t < distance)
            distance[nearer], triangle[nearer] = t[nearer], i
        return Hits(distance.astype(np.float32), triangle, self._normal[triangle].astype(np.float32))

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        return self.intersect(origins, directions, limits).triangle >= 0


def _moller_trumbore(
    origins: np.ndarray, directions: np.ndarray, corner: np.ndarray, edge1: np.ndarray, edge2: np.ndarray
) -> np.ndarray:
    """Distances (n,) to one triangle, infinite for a miss; Moller and Trumbore, "Fast, Minimum Storage..." (1997)."""
    across = np.cross(directions, edge2)
    determinant = across @ edge1
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = origins - corner
        u = np.einsum("ij,ij->i", offset, across) / determinant
        along = np.cross(offset, edge1)
        v = np.einsum("ij,ij->i", directions, along) / determinant
        t = along @ edge2 / determinant
        return np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0), t, np.inf)
