"""How far rays reach when nobody says: a fifth of the size of what is baked and stands by it.

Skies, horizons and objects far astray are as large as they are, or stand where they do, for reasons of their own; what
they are is told by the boxes of objects alone, so that it does not depend on how finely these are cut up.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..scene import Patches, Surfaces, bounding_box

FAR_LARGER = (
    64.0  # times the size of all that is smaller, among what is baked: a sky around a house, not a room around a cup
)
LARGER = 8.0  # times the size of what is baked, for what is not: it only surrounds
ASTRAY = 10.0  # times the size of the rest, empty between the two
BESIDE = 1.0  # times the size of what is baked, empty between it and what is not baked


@dataclass(frozen=True)
class SceneSize:
    """The size of what is baked and stands by it.

    Attributes
    ----------
    diagonal : float
        Of the box around it, metres.
    far_larger, astray : ndarray, (k,) int
        Objects, counted as `Surfaces.object_starts`, that were left out for their size, or for their place.
    """

    diagonal: float
    far_larger: np.ndarray
    astray: np.ndarray


def scene_size(surfaces: Surfaces, patches: Patches) -> SceneSize:
    """The size of a scene, as far as what is baked tells it.

    Objects within the box of all patches count as baked. Of these, those are left out that are far larger than all
    that is smaller together, while they are no more than two or the fewer ones; and those that stand far astray from
    the largest that is left. What is not baked counts if it is not much larger, and stands near.
    """
    low, high = object_boxes(surfaces)
    around = np.stack(bounding_box(patches.corners))
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.linalg.norm(high - low, axis=1)
        is_object = size > 0.0
        is_baked = is_object & (low >= around[0]).all(1) & (high <= around[1]).all(1)
        kept, core = np.flatnonzero(is_baked), around
        order = kept[np.argsort(size[kept], kind="stable")]
        far_larger = _far_larger(low[order], high[order], size[order])
        larger, kept = order[len(order) - far_larger :], np.sort(order[: len(order) - far_larger])
        near = _standing_together(low[kept], high[kept], size[kept])
        astray = kept[~near]
        if len(larger) or len(astray):
            core = np.stack([low[kept[near]].min(0), high[kept[near]].max(0)])
        extent = float(np.linalg.norm(core[1] - core[0]))
        others = np.flatnonzero(is_object & ~is_baked)
        is_larger = size[others] > LARGER * extent
        is_near = _gap(low[others], high[others], core) <= BESIDE * extent
        beside = others[~is_larger & is_near]
        low, high = np.vstack([core[:1], low[beside]]).min(0), np.vstack([core[1:], high[beside]]).max(0)
        return SceneSize(
            float(np.linalg.norm(high - low)),
            np.sort(np.concatenate([larger, others[is_larger]])),
            np.sort(np.concatenate([astray, others[~is_larger & ~is_near]])),
        )


def object_boxes(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corners of the boxes of objects, (o, 3) float64 each; not finite for those without triangles.

    Vertices of an object stand together, so the range of their indices is enough to find its box.
    """
    starts = np.r_[surfaces.object_starts, len(surfaces.triangles)]
    boxes = np.full((2, len(starts) - 1, 3), np.nan)
    for number, (first, end) in enumerate(itertools.pairwise(starts)):
        used = surfaces.triangles[first:end]
        if len(used):
            boxes[:, number] = bounding_box(surfaces.vertices[used.min() : used.max() + 1])
    return boxes[0], boxes[1]


def _far_larger(low: np.ndarray, high: np.ndarray, size: np.ndarray) -> int:
    """How many of the largest objects, ascending by size, are far larger than all others together."""
    n = len(size)
    together = np.linalg.norm(np.maximum.accumulate(high) - np.minimum.accumulate(low), axis=1)
    last = np.arange(1, n)  # cut before each
    may_cut = (size[1:] > FAR_LARGER * together[:-1]) & (together[:-1] > 0.0) & (n - last <= np.maximum(last, 2))
    return n - int(last[may_cut][0]) if may_cut.any() else 0


def _standing_together(low: np.ndarray, high: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(o,) bool: the largest object and those that are no farther away than some times the size of all these."""
    found = np.zeros(len(size), bool)
    if not len(size):
        return found
    found[np.argmax(size)] = True
    while True:
        core = np.stack([low[found].min(0), high[found].max(0)])
        near = _gap(low, high, core) <= ASTRAY * np.linalg.norm(core[1] - core[0])
        if not (near & ~found).any():
            return found
        found |= near


def _gap(low: np.ndarray, high: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Distances (o,) between boxes and another one, 0 where they overlap."""
    return np.linalg.norm(np.maximum(np.maximum(low - box[1], box[0] - high), 0.0), axis=1)
