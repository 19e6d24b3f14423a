"""What an incremental bake is asked, and what it tells."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np


class UpdateMode(enum.StrEnum):
    """How the patches that a change has influence on are found."""

    EXACT = "EXACT"  # all that it can reach: `incremental.IncrementalBake`
    LIST = "LIST"  # the list of the 2003 paper: `list_bake.ListBake`


@dataclass(frozen=True)
class Update:
    """What an update did.

    Attributes
    ----------
    keys : frozenset
        Objects with new values.
    patches : int
        Patches that were baked again.
    rays : int
        Rays of these, repeated ones included.
    cached : int
        Those among them whose hit among what stands still was known: they were traced against movers alone.
    cache_is_full : bool
        Hits were not kept for want of room, so that later updates trace more.
    reason : str or None
        Why everything was baked anew, where it was.
    """

    keys: frozenset
    patches: int
    rays: int
    cached: int
    cache_is_full: bool
    reason: str | None = None


@dataclass(frozen=True)
class ObjectValues:
    """Obscurances of the patches of one object, as of `Obscurances`.

    Attributes
    ----------
    coloured : ndarray, (p, 3) float64
    grey : ndarray, (p,) float64
    white : ndarray, (p, 3) float64
    valid : ndarray, (p,) bool
    """

    coloured: np.ndarray
    grey: np.ndarray
    white: np.ndarray
    valid: np.ndarray
