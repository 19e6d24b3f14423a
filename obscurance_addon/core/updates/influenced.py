"""Which patches a change can reach: never too few, and found without looking at patches of objects far away."""

from __future__ import annotations

import numpy as np

from ..scene import Cells
from .object_state import ObjectState, ObjectTable

_ROUNDING = 1e-6  # share of a distance that float32 directions may be off, ten times over


def objects_within(table: ObjectTable, boxes: list[np.ndarray], limit: float) -> set[int]:
    """Rows of the objects with a patch that may be within reach of one of the boxes.

    Parameters
    ----------
    table : ObjectTable
    boxes : list of ndarray (2, 3) float64
        Normalised.
    limit : float
        d_max, normalised.
    """
    near = is_within(table.patches, np.full(len(table.states), limit), boxes)
    return set(np.flatnonzero(near).tolist())


def influenced(states: list[ObjectState], cells: Cells, boxes: list[np.ndarray], limit: float) -> np.ndarray:
    """Patches of several objects whose value may depend on what was or is in the boxes.

    Parameters
    ----------
    states : list of ObjectState
    cells : Cells
        All of theirs, joined.
    boxes : list of ndarray (2, 3) float64
        Around the changed objects before and after the change, normalised.
    limit : float
        d_max, normalised.

    Returns
    -------
    ndarray, (p,) bool
    """
    if not states:
        return np.zeros(0, bool)
    chosen = np.zeros(len(cells.area), bool)
    reach = np.full(len(chosen), limit)
    patch_boxes = np.concatenate([state.patch_boxes for state in states], axis=1)
    for box in boxes:
        near = is_within(patch_boxes, reach, [box]) & ~chosen
        at = np.flatnonzero(near[cells.patch])
        chosen[cells.patch[at[~is_behind(cells, at, box)]]] = True
    return chosen


def is_within(boxes: np.ndarray, reach: np.ndarray, others: list[np.ndarray]) -> np.ndarray:
    """(m,) bool: whether any of the others (2, 3) is within reach (m,) of each of the boxes (2, m, 3)."""
    near = np.zeros(len(reach), bool)
    for low, high in others:
        gap = np.maximum(np.maximum(boxes[0] - high, low - boxes[1]), 0.0)
        near |= np.einsum("ij,ij->i", gap, gap) <= (reach * (1.0 + _ROUNDING)) ** 2
    return near


def is_behind(cells: Cells, at: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(m,) bool: whether all of the box (2, 3) is below the planes of the cells `at` (m,), where no ray goes."""
    frames = cells.frames[at].astype(np.float64)
    with np.errstate(invalid="ignore"):  # what has no box is behind nothing
        centre, half = 0.5 * (box[0] + box[1]), 0.5 * (box[1] - box[0])
    normal, from_cell = frames[:, 2, 3:], centre - frames[:, 2, :3]
    height = np.einsum("ij,ij->i", normal, from_cell) + np.abs(normal) @ half  # of its highest corner over the origins
    distance = np.abs(from_cell).sum(1) + half.sum()
    return height < -cells.offset[at] - _ROUNDING * distance
