"""Choosing entries by their share: cells of a patch by area, parts of a reflector by light, emitters by power.

The entries of all owners stand in one ascending list of numbers: an owner's range goes from its index to the next, and
each entry has its share of it. One binary search then chooses for any number of owners at once.
"""

from __future__ import annotations

import numpy as np


def ascending_ends(owner: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Where the range of each entry ends.

    Parameters
    ----------
    owner : ndarray, (n,) int, ascending
    share : ndarray, (n,) float64
        Not negative; those of an owner add up to 1, up to rounding.

    Returns
    -------
    ndarray, (n,) float64
        Ascending; the last entry of owner k ends at k + 1 exactly.
    """
    if not len(owner):
        return np.zeros(0)
    changes = owner[1:] != owner[:-1]
    running = np.cumsum(share)
    before = np.maximum.accumulate(np.where(np.r_[True, changes], running - share, 0.0))
    ends = np.clip(running - before, 0.0, 1.0) + owner
    last = np.r_[changes, True]
    ends[last] = owner[last] + 1
    return ends


def pick(ends: np.ndarray, owner: np.ndarray | int, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose an entry of each owner by a number.

    Parameters
    ----------
    ends : ndarray, (n,) float64
        From `ascending_ends`.
    owner : ndarray, (q,) int, or int
        Each has entries.
    u : ndarray, (q,) float
        From 0 to below 1.

    Returns
    -------
    entry : ndarray, (q,) int64
    rest : ndarray, (q,) float32
        What is left of u, stretched to 0 .. 1: as good a random number as u was.
    """
    place = owner + u.astype(np.float64)
    entry = np.searchsorted(ends, place, side="right")
    start = np.maximum(np.where(entry > 0, ends[entry - 1], 0.0), owner)  # owners before may have no entries
    rest = np.clip((place - start) / np.maximum(ends[entry] - start, 1e-12), 0.0, 1.0)
    return entry, rest.astype(np.float32)
