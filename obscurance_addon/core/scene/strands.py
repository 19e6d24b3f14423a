"""Triangles for what renderers draw without any: hairs, and points as balls.

They cover as much of a view as what they stand for does in the mean over all directions: by Cauchy's formula a convex
body does so if it has the same surface.
"""

from __future__ import annotations

import numpy as np

_SIDES = 3
_TUBE = 2.0 * np.pi / (2.0 * _SIDES * np.sin(np.pi / _SIDES))  # circumradius of a triangle around as long as a circle
_GOLDEN = 0.5 * (1.0 + 5.0**0.5)
_BALL_CORNERS = np.array(
    [(a, b * _GOLDEN, 0.0) for a in (-1, 1) for b in (-1, 1)]
    + [(0.0, a, b * _GOLDEN) for a in (-1, 1) for b in (-1, 1)]
    + [(b * _GOLDEN, 0.0, a) for a in (-1, 1) for b in (-1, 1)]
)  # an icosahedron of edges 2
_BALL = np.sqrt(4.0 * np.pi / (5.0 * 3.0**0.5)) / 2.0  # scale at which its surface is that of a ball of radius 1


def _ball_triangles() -> np.ndarray:
    """(20, 3) the triples of corners that are one edge apart, seen from outside counter-clockwise."""
    corners = _BALL_CORNERS
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 2.1
    a, b, c = np.nonzero(near[:, :, None] & near[:, None, :] & near[None, :, :])
    found = np.stack([a, b, c], 1)[(a < b) & (b < c)]
    outwards = np.einsum("ij,ij->i", np.cross(corners[found[:, 0]], corners[found[:, 1]]), corners[found[:, 2]]) > 0.0
    found[~outwards] = found[~outwards][:, ::-1]
    return found.astype(np.int32)


def thinned(count: int, most: int) -> int:
    """Keep one of this many of `count`, so that no more than `most` are left."""
    return max(1, -(-count // max(most, 1)))


def tubes(points: np.ndarray, radius: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Open tubes of three sides along strands.

    Parameters
    ----------
    points : ndarray, (n, 3) float
    radius : ndarray, (n,) float
        Same unit.
    start : ndarray, (s + 1,) int
        First point of each strand, and n; strands of one point are left out.

    Returns
    -------
    vertices : ndarray, (3 n, 3) float64
    triangles : ndarray, (t, 3) int32
    """
    points, n = np.asarray(points, np.float64), len(points)
    strand = np.repeat(np.arange(len(start) - 1), np.diff(start))
    first, last = start[:-1][strand], start[1:][strand] - 1
    index = np.arange(n)
    along = points[np.minimum(index + 1, last)] - points[np.maximum(index - 1, first)]
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-30)[:, None]
    whole = np.abs(points[last] - points[first])  # the axis that a strand keeps away from most is never along it
    axis = np.eye(3)[np.argmin(whole, axis=1)]
    side = np.cross(along, axis)
    side /= np.maximum(np.linalg.norm(side, axis=1), 1e-30)[:, None]
    other = np.cross(along, side)
    turn = 2.0 * np.pi / _SIDES * np.arange(_SIDES)
    ring = np.cos(turn)[:, None] * side[:, None] + np.sin(turn)[:, None] * other[:, None]
    vertices = points[:, None] + (_TUBE * np.asarray(radius, np.float64))[:, None, None] * ring
    begins = np.flatnonzero(index < last)[:, None] * _SIDES
    here, there = begins + np.arange(_SIDES), begins + (np.arange(_SIDES) + 1) % _SIDES
    quads = np.stack([here, there, there + _SIDES, here + _SIDES], -1).reshape(-1, 4)
    return vertices.reshape(-1, 3), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)


def balls(points: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Icosahedra around points.

    Parameters
    ----------
    points : ndarray, (n, 3) float
    radius : ndarray, (n,) float

    Returns
    -------
    vertices : ndarray, (12 n, 3) float64
    triangles : ndarray, (20 n, 3) int32
    """
    scale = _BALL * np.asarray(radius, np.float64)[:, None, None]
    vertices = np.asarray(points, np.float64)[:, None] + scale * _BALL_CORNERS
    first = len(_BALL_CORNERS) * np.arange(len(points), dtype=np.int32)
    return vertices.reshape(-1, 3), (first[:, None, None] + _ball_triangles()).reshape(-1, 3)
