"""Exact form factors from points to triangles, by Lambert's contour integral (1760).

F = 1/(2 pi) sum over edges of the angle that the edge spans at the point times the cosine between the normal of the
plane through edge and point and the normal at the point. What lies below the point's horizon is cut off first.
"""

from __future__ import annotations

import numpy as np

_TINY = 1e-30


def triangle_form_factors(points: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Form factors from differential areas to the sides of triangles that face them.

    Parameters
    ----------
    points : ndarray, (n, 3)
    normals : ndarray, (n, 3)
        Unit normals at the points.
    corners : ndarray, (n, 3, 3)
        One triangle for each point, counter-clockwise seen from the side that counts.

    Returns
    -------
    ndarray, (n,) float64
        0 .. 1: the cosine-weighted share of the hemisphere that the triangle covers; 0 where the point is behind it.
    """
    local = np.asarray(corners, np.float64) - np.asarray(points, np.float64)[:, None]
    normals = np.asarray(normals, np.float64)
    a, b, c = local[:, 0], local[:, 1], local[:, 2]
    in_front = np.einsum("ij,ij->i", _cross(b - a, c - a), a) < 0.0
    height = np.einsum("nkj,nj->nk", local, normals)
    above = height > 0.0
    factors = np.zeros(len(local))
    whole = np.flatnonzero(in_front & above.all(1))
    factors[whole] = _contour(local[whole], normals[whole])
    cut = np.flatnonzero(in_front & above.any(1) & ~above.all(1))
    if len(cut):
        factors[cut] = _contour(_above_horizon(local[cut], height[cut]), normals[cut])
    return np.clip(factors, 0.0, 1.0)


def _contour(polygon: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Lambert's sum over polygons (n, k, 3) seen from the origin; (n,)."""
    length = np.sqrt(np.einsum("nkj,nkj->nk", polygon, polygon))
    unit = polygon / np.maximum(length, _TINY)[..., None]
    total = np.zeros(len(polygon))
    for k in range(polygon.shape[1]):
        one, other = unit[:, k], unit[:, (k + 1) % polygon.shape[1]]
        across = _cross(one, other)
        sine = np.sqrt(np.einsum("ij,ij->i", across, across))
        angle = np.arctan2(sine, np.einsum("ij,ij->i", one, other))
        total -= angle * np.einsum("ij,ij->i", across, normals) / np.maximum(sine, _TINY)
    return total / (2.0 * np.pi)


def _above_horizon(local: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Cut triangles (n, 3, 3) that cross the horizon; quadrilaterals (n, 4, 3), with a double corner where one is left.

    `height` (n, 3) are the corners' heights above it, at least one positive and one not.
    """
    n, row = len(local), np.arange(len(local))
    above = height > 0.0
    # Turn the corners so that the lone one of its side comes first.
    lone_above = above.sum(1) == 1
    first = np.where(lone_above, above.argmax(1), (~above).argmax(1))
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = (local[row, order[:, k]] for k in range(3))
    ha, hb, hc = (height[row, order[:, k]] for k in range(3))
    ab = a + (b - a) * (ha / (ha - hb))[:, None]
    ac = a + (c - a) * (ha / (ha - hc))[:, None]
    quad = np.empty((n, 4, 3))
    # One corner above: a, ab, ac. Two above: ab, b, c, ac.
    quad[:, 0] = np.where(lone_above[:, None], a, ab)
    quad[:, 1] = np.where(lone_above[:, None], ab, b)
    quad[:, 2] = np.where(lone_above[:, None], ac, c)
    quad[:, 3] = ac
    return quad


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (n, 3); np.cross is several times slower."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)
