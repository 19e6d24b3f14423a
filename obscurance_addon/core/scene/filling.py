"""Values for patches that have none of their own."""

from __future__ import annotations

import numpy as np


def fill_invalid(
    values: np.ndarray, valid: np.ndarray, fallback: np.ndarray, neighbours: tuple[np.ndarray, np.ndarray] | None
) -> None:
    """Give invalid patches the mean of their valid neighbours, ring by ring inwards; the fallback where none is near.

    Parameters
    ----------
    values : ndarray, (p, k) float64
        Overwritten where `valid` is False.
    valid : ndarray, (p,) bool
    fallback : ndarray, (k,) float64
    neighbours : tuple of two ndarray (m,) int, or None
        Pairs (patch, node).
    """
    known = valid.copy()
    values[~valid] = fallback
    if neighbours is None or valid.all():
        return
    patch, node = neighbours
    near = np.zeros(int(node.max(initial=0)) + 1, bool)
    while not known.all():
        near[:] = False
        near[node[~known[patch]]] = True  # only nodes that an unknown patch touches matter
        touching = near[node] & known[patch]
        if not touching.any():
            return
        source, at = patch[touching], node[touching]
        count = np.bincount(at, minlength=len(near))
        mean = np.stack([np.bincount(at, v, len(near)) for v in values[source].T], -1) / np.maximum(count, 1)[:, None]
        taking = ~known[patch] & (count[node] > 0)
        target, at = patch[taking], node[taking]
        ring, target = np.unique(target, return_inverse=True)
        share = np.bincount(target)
        values[ring] = np.stack([np.bincount(target, v) for v in mean[at].T], -1) / share[:, None]
        known[ring] = True
