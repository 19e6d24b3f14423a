"""Expressions at single places of triangles, such as those that rays meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .expressions import Expression
from .surfaces import SurfaceArrays


@dataclass(frozen=True, eq=False)
class TrianglePlaces:
    """One place on each of some triangles, as `TrianglePoints`; images are looked up in their finest copy."""

    surface: SurfaceArrays
    triangles: np.ndarray
    places: np.ndarray  # (t, 3) float32 barycentric coordinates
    parts: float = math.inf
    values: dict[int, np.ndarray] = field(default_factory=dict)

    def on_corners(self, per_corner: np.ndarray) -> np.ndarray:
        """(t, 3, c) values at the corners of the triangles -> (t, 1, c) at the places."""
        a, b, c = (self.places[:, corner, None, None] * per_corner[:, corner, None] for corner in range(3))
        return a + b + c


@dataclass(frozen=True, eq=False)
class PlaceLookup:
    """Values of an expression at places on the triangles of one mesh, 0 .. 1."""

    expression: Expression
    surface: SurfaceArrays

    def __call__(self, triangles: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(n, 3) float32 on triangles (n,) int at barycentric coordinates (n, 3) float32."""
        found = self.expression.at(TrianglePlaces(self.surface, triangles, places))
        found = np.clip(np.nan_to_num(found, nan=0.0), 0.0, 1.0)
        return np.broadcast_to(found, (len(triangles), 1, 3))[:, 0].astype(np.float32)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PlaceLookup) and self.expression is other.expression and self.surface is other.surface

    __hash__ = object.__hash__
