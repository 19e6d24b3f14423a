"""Means of expressions over triangles and faces, from points spread over them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .expressions import Expression, walk
from .points import TrianglePoints
from .surfaces import SurfaceArrays

# Points on one mesh and material; more triangles than can share them get fewer parts each.
POINT_BUDGET = 1 << 23
# Points evaluated at once: the temporaries of one block stay in the processor's cache.
BLOCK = 1 << 15


def face_means(
    expressions: Sequence[Expression], surface: SurfaceArrays, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean of each expression over each face, weighted by triangle area.

    Parameters
    ----------
    expressions : sequence of Expression, length e
    surface : SurfaceArrays
    triangles : ndarray, (t,) int
        All triangles of the faces to evaluate.

    Returns
    -------
    faces : ndarray, (f,) int
        The faces that these triangles make up, ascending.
    means : ndarray, (f, e, 3) float64
    """
    values = _triangle_means(expressions, surface, triangles).reshape(-1, 3 * len(expressions))
    faces, row = np.unique(surface.triangle_face[triangles], return_inverse=True)
    area = np.nan_to_num(surface.triangle_area[triangles].astype(np.float64), posinf=0.0, neginf=0.0)
    # A face without area shows nothing; equal weights keep its values those of its texture.
    flat = np.bincount(row, area, minlength=len(faces)) <= 0.0
    area[flat[row]] = 1.0
    total = np.bincount(row, area, minlength=len(faces))
    sums = [np.bincount(row, area * column, minlength=len(faces)) for column in values.T]
    return faces, (np.stack(sums, axis=1) / total[:, None]).reshape(-1, len(expressions), 3)


def _triangle_means(expressions: Sequence[Expression], surface: SurfaceArrays, triangles: np.ndarray) -> np.ndarray:
    """(t, e, 3) float32 mean of each expression over each triangle."""
    means = np.empty((len(triangles), len(expressions), 3), np.float32)
    parts = _parts_within_budget(expressions, surface, triangles)
    for n in np.unique(parts):
        chosen = np.flatnonzero(parts == n)
        step = max(1, BLOCK // int(n) ** 2)
        for start in range(0, len(chosen), step):
            rows = chosen[start : start + step]
            points = TrianglePoints(surface, triangles[rows], int(n))
            for e, expression in enumerate(expressions):
                means[rows, e] = _mean_over_points(expression.at(points))
    return means


def _mean_over_points(values: np.ndarray) -> np.ndarray:
    """(t, n * n or 1, c) -> (t, c)."""
    count = math.isqrt(values.shape[1])
    if count == 1:
        return values[:, 0]
    # Matrix products are several times faster than numpy's mean; two short sums keep float32 exact where one long one
    # does not.
    weights = np.full((1, count), 1.0 / count, np.float32)
    rows = np.matmul(weights, values.reshape(len(values), count, count, -1))
    return np.matmul(weights, rows[:, :, 0])[:, 0]


def _parts_within_budget(
    expressions: Sequence[Expression], surface: SurfaceArrays, triangles: np.ndarray
) -> np.ndarray:
    """Parts along the edge of each triangle, a power of two: as many as wanted, coarser if there are many triangles."""
    parts = np.ones(len(triangles), np.int64)
    for expression in walk(*expressions):
        # In blocks as well: a million triangles' coordinates are large.
        for start in range(0, len(triangles), BLOCK):
            block = slice(start, start + BLOCK)
            np.maximum(parts[block], expression.parts(surface, triangles[block]), out=parts[block])
    while parts.max(initial=1) > 1 and np.square(parts).sum() > POINT_BUDGET:
        np.minimum(parts, parts.max() // 2, out=parts)
    return parts
