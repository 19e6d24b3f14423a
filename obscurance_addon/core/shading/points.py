"""Points spread evenly over triangles.

A triangle is cut into n x n congruent parts, of which the centres are taken. These average to the centre of the
triangle, so anything linear over it comes out exact for every n.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .surfaces import SurfaceArrays


@dataclass(frozen=True, eq=False)
class TrianglePoints:
    """Centres of the n x n parts of each of some triangles; `values` remembers expressions already evaluated there."""

    surface: SurfaceArrays
    triangles: np.ndarray
    parts: int
    values: dict[int, np.ndarray] = field(default_factory=dict)

    def on_corners(self, per_corner: np.ndarray) -> np.ndarray:
        """(t, 3, c) values at the corners of the triangles -> (t, n * n, c) at the points."""
        return np.matmul(part_centres(self.parts), per_corner)


def part_centres(parts: int) -> np.ndarray:
    """Barycentric coordinates of the centres of the parts x parts congruent parts of a triangle.

    Returns
    -------
    ndarray, (parts * parts, 3) float32
        Rows sum to one; their mean is one third each.
    """
    i, j = np.divmod(np.arange(parts * parts), parts)
    upright = i + j < parts
    # The cells of the unit square beyond its diagonal hold, mirrored, the parts that stand on their heads.
    u = np.where(upright, i + 1.0 / 3.0, parts - 1.0 - i + 2.0 / 3.0) / parts
    v = np.where(upright, j + 1.0 / 3.0, parts - 1.0 - j + 2.0 / 3.0) / parts
    return np.stack([1.0 - u - v, u, v], axis=1).astype(np.float32)
