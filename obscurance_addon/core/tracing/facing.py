"""Sheets that look away from the scene: their front sees nothing, though other things lie behind them."""

from __future__ import annotations

import numpy as np

from ..scene import Cells, Surfaces
from .bodies import FAR
from .intersector import Intersector

_LEAST_AREA = 0.01  # share of the area of all patches below which a sheet is not looked at
_CELLS = 64  # of each sheet, about
_SEEN = 0.01  # share of rays below which a front sees nothing
_BEHIND = 0.05  # share of rays from the back that must meet other shells
_DIRECTIONS = np.float32([(0.36, 0.48, 0.8), (-0.48, 0.36, 0.8), (0.64, -0.48, 0.6), (-0.6, -0.64, 0.48)])


def looking_away(cells: Cells, shell: np.ndarray, surfaces: Surfaces, intersector: Intersector) -> np.ndarray:
    """Numbers of the sheets to bake that see nothing of the scene, while their backs do.

    Parameters
    ----------
    cells : Cells
    shell : ndarray, (p,) int32
        Shell of each patch.
    surfaces : Surfaces
        In the order in which `intersector` numbers triangles.
    intersector : Intersector

    Returns
    -------
    ndarray, (k,) int32
    """
    shells = surfaces.shells
    of_cell, area = shell[cells.patch], cells.weight * cells.area[cells.patch]
    sheets = np.isin(of_cell, shells.shell[~shells.solid & ~shells.inward])
    numbers, which = np.unique(of_cell[sheets], return_inverse=True)
    large = np.bincount(which, area[sheets], len(numbers)) >= _LEAST_AREA * max(float(area.sum()), 1e-300)
    found = []
    for number in numbers[large]:
        own = np.flatnonzero(of_cell == number)
        own = own[:: -(-len(own) // _CELLS)]
        front, back = (_shares_met(cells, own, side, number, shells.shell, intersector) for side in (1.0, -1.0))
        if front[0] <= _SEEN and back[1] >= _BEHIND:
            found.append(number)
    return np.array(found, np.int32)


def _shares_met(
    cells: Cells, own: np.ndarray, side: float, number: int, shell: np.ndarray, intersector: Intersector
) -> tuple[float, float]:
    """Shares of rays from one side of cells (m,) that meet anything, and that meet another shell."""
    frames = cells.frames[own]
    normal = frames[:, 2, 3:]
    origins = frames[:, 2, :3] + (frames[:, 0, :3] + frames[:, 1, :3]) / 3.0
    origins = origins + np.float32(side - 1.0) * cells.offset[own, None] * normal
    local = _DIRECTIONS * np.float32([1.0, 1.0, side])
    directions = np.einsum("dk,mkx->mdx", local, frames[:, :, 3:]).reshape(-1, 3)
    origins = np.repeat(origins, len(local), axis=0)
    hits = intersector.intersect(origins, directions, np.full(len(origins), FAR, np.float32))
    met = hits.triangle >= 0
    return float(met.mean()), float((shell[hits.triangle[met]] != number).sum() / len(met))
