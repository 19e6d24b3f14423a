"""Which triangles bound a closed solid, seen from outside.

A closed shell (every edge shared by exactly two triangles that run along it in opposite directions) around a positive
volume is a solid: only its outside can be lit, so a ray that first hits its inside started within it. Open sheets and
shells that enclose their surroundings (rooms modelled with normals inwards, negative volume) are ordinary two-sided
surfaces.
"""

from __future__ import annotations

import numpy as np


def solid_triangles(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Find the triangles of closed shells that enclose a positive volume.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float
    triangles : ndarray, (t, 3) int
        Connected by shared vertex indices.

    Returns
    -------
    ndarray, (t,) bool
        True for triangles of connected shells that are closed, consistently oriented, finite and outward facing.
    """
    if not len(triangles):
        return np.zeros(0, bool)
    links = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    shell = connected_components(len(vertices), links)[triangles[:, 0]]
    is_open = np.zeros(len(vertices), bool)
    is_open[shell[_open_triangles(len(vertices), triangles)]] = True
    closed = np.flatnonzero(~is_open[shell])
    solid = np.zeros(len(triangles), bool)
    if len(closed):
        volume = _shell_volumes(vertices, triangles[closed], shell[closed])
        solid[closed] = (volume[shell[closed]] > 0.0) & np.isfinite(volume[shell[closed]])
    return solid


def _shell_volumes(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Six times the volume enclosed by each closed shell, indexed by shell label."""
    vertices = finite_or_nan(vertices)
    first, second, third = (vertices[triangles[:, k]] - vertices[shell] for k in range(3))  # keeps digits far away
    return np.bincount(shell, np.einsum("ij,ij->i", first, np.cross(second, third)))


def finite_or_nan(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) as float64, wholly NaN where a coordinate is not finite: differences of NaN raise no warning."""
    points = np.array(points, np.float64)
    points[~np.isfinite(points).all(1)] = np.nan
    return points


def connected_components(n: int, links: np.ndarray) -> np.ndarray:
    """Label nodes by the smallest index of their connected component.

    Parameters
    ----------
    n : int
        Number of nodes.
    links : ndarray, (m, 2) int
        Pairs of connected nodes.

    Returns
    -------
    ndarray, (n,) int64
        The smallest node index of each node's component.
    """
    label = np.arange(n)
    a, b = links.T
    while len(a):
        low, high = np.minimum(label[a], label[b]), np.maximum(label[a], label[b])
        differs = low != high
        a, b = a[differs], b[differs]
        np.minimum.at(label, high[differs], low[differs])
        while True:  # pointer jumping: each label moves to its label's label until all point at roots
            shorter = label[label]
            if np.array_equal(shorter, label):
                break
            label = shorter
    return label


def _open_triangles(n_vertices: int, triangles: np.ndarray) -> np.ndarray:
    """Indices of triangles with an edge that is not matched by exactly one opposite edge."""
    tail = triangles.astype(np.int64).ravel()
    head = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    forward = np.minimum(tail, head) * n_vertices + np.maximum(tail, head)
    order = np.argsort(forward, kind="stable")
    edge = forward[order]
    first = np.flatnonzero(np.r_[True, edge[1:] != edge[:-1]])
    count = np.diff(np.r_[first, len(edge)])
    balance = np.add.reduceat(np.where(tail < head, 1, -1)[order], first)
    bad = (count != 2) | (balance != 0)
    return order[np.repeat(bad, count)] // 3
