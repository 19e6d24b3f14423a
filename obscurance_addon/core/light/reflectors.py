"""Which surfaces are the most important secondary reflectors.

A reflector is a patch, or several small ones side by side, so that the choice does not depend on how fine meshes are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..sampling import ascending_ends, hash32
from ..scene import LUMINANCE, Cells

MAX_AUTOMATIC = 64  # reflectors
ENOUGH_LIGHT = 0.8  # share of the scattered direct light after which more reflectors gain little
TOO_LITTLE_LIGHT = 0.4  # when the most that may be taken hold less than this, light is spread out and ambient serves it
REFLECTOR_SIZE = 1.0 / 32.0  # of the diagonal of what is baked: patches within a cube of that size go together


@dataclass(frozen=True)
class Reflectors:
    """The chosen reflectors, as lists of cells.

    Attributes
    ----------
    start : ndarray, (k + 1,) int64
        Range of each reflector in `cell`.
    cell : ndarray, (m,) int64
    end_share : ndarray, (m,) float64
        To choose a cell by its share (`shares.pick`); the owners are the reflectors' indices.
    share : ndarray, (m,) float64
        Of the cell itself.
    is_chosen : ndarray, (p,) bool
        Patches of the reflectors.
    light_share : float
        Share 0 .. 1 of the direct light scattered in the scene that they hold, by luminance.
    """

    start: np.ndarray
    cell: np.ndarray
    end_share: np.ndarray
    share: np.ndarray
    is_chosen: np.ndarray
    light_share: float

    def __len__(self) -> int:
        return len(self.start) - 1


def choose_reflectors(
    cells: Cells, exitance: np.ndarray, area: np.ndarray, reflectance: np.ndarray, number: int | None
) -> Reflectors | None:
    """The reflectors that scatter most direct light.

    Parameters
    ----------
    cells : Cells
        Of all patches.
    exitance : ndarray, (p, 3) float64
        U = R H of each patch, W/m^2.
    area : ndarray, (p,) float64
        Outside of solids, any unit.
    reflectance : ndarray, (p, 3) float64
    number : int or None
        How many to take; None takes as many as hold 80 % of the light but at most 64, and none where these hold less
        than 40 %.

    Returns
    -------
    Reflectors or None
        None when there is nothing to gain, or no light.
    """
    light = area * (exitance @ LUMINANCE)
    total = light.sum()
    if not total > 0.0 or number == 0:
        return None
    group = _neighbourhoods(cells, reflectance)
    group_light = np.bincount(group, light)
    order = np.argsort(-group_light, kind="stable")
    held = np.cumsum(group_light[order]) / total
    if number is None:
        number = min(int(np.searchsorted(held, ENOUGH_LIGHT)) + 1, MAX_AUTOMATIC, len(order))
        if held[number - 1] < TOO_LITTLE_LIGHT:
            return None
    number = min(number, int(np.count_nonzero(group_light)))
    rank = np.full(len(order), -1)
    rank[order[:number]] = np.arange(number)
    cell_light = cells.weight * light[cells.patch]
    of_cell = np.where(cell_light > 0.0, rank[group[cells.patch]], -1)
    cell = np.flatnonzero(of_cell >= 0)
    cell = cell[np.argsort(of_cell[cell], kind="stable")]
    start = np.searchsorted(of_cell[cell], np.arange(number + 1))
    share = cell_light[cell] / np.add.reduceat(cell_light[cell], start[:-1])[of_cell[cell]]
    is_chosen = np.zeros(len(light), bool)
    is_chosen[cells.patch[cell]] = True
    return Reflectors(start, cell, ascending_ends(of_cell[cell], share), share, is_chosen, float(held[number - 1]))


def _neighbourhoods(cells: Cells, reflectance: np.ndarray) -> np.ndarray:
    """Group (p,) int of each patch: those with the like normal and reflectance whose centres share a small cube."""
    corner, normal = cells.frames[:, 2, :3], cells.frames[:, 2, 3:]
    centre = corner + (cells.frames[:, 0, :3] + cells.frames[:, 1, :3]) / 3.0
    n_patches = len(cells.area)
    size = 2.0 * REFLECTOR_SIZE  # the half diagonal is 1
    traits = np.concatenate([centre / size, 2.0 * normal + 0.5], 1)
    traits = np.stack([np.bincount(cells.patch, cells.weight * column, n_patches) for column in traits.T], 1)
    traits = np.concatenate([traits, 16.0 * reflectance], 1)
    key = np.zeros(n_patches, np.uint32)
    for column in np.floor(traits).T:
        key = hash32(key ^ hash32(np.clip(column, -(2.0**30), 2.0**30).astype(np.int64).astype(np.uint32)))
    return np.unique(key, return_inverse=True)[1]
