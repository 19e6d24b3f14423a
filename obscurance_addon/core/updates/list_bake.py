"""The list of influenced patches of the 2003 paper (section 5), to compare with: cheaper, and it misses patches.

On the list of an object are the patches whose rays met it, and those that rays of its own patches met. When it moves,
its patches are baked again, which adds what their rays meet now; then the patches on the list, which stay on it only
while a ray of theirs meets the object. A patch that no ray joined to the object keeps a value that is out of date.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from ..monitor import Monitor
from ..scene import Cells
from ..tracing import Hits
from .caster import LayeredCaster
from .changing_scene import Change
from .incremental import IncrementalBake, parts
from .object_state import ObjectState, join_cells_of
from .results import Update

_PATCH_BITS = 32  # a pair of patch and triangle is one int64


class _NotingCaster(LayeredCaster):
    """A caster that notes what each patch met nearer than d_max.

    Attributes
    ----------
    noted : list of ndarray (k,) int64
        Pairs of patch and triangle.
    """

    uses_kept_sums = False  # every hit is noted

    def __init__(self, *args: object) -> None:
        super().__init__(*args)
        self.noted: list[np.ndarray] = []
        if self.scene.needs_only_occlusion:
            self._may_keep[:] = False

    def blocked(self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        hits = self.scene.intersector.intersect(origins, directions, limits)  # by whom, not only whether
        self._note(cells, hits)
        return hits.triangle >= 0

    def first_hits(
        self, cells: np.ndarray, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray
    ) -> tuple[Hits, np.ndarray | None]:
        hits, dropped = super().first_hits(cells, origins, directions, limits)
        self._note(cells, hits)
        return hits, dropped

    def _note(self, cells: np.ndarray, hits: Hits) -> None:
        rays = np.flatnonzero((hits.triangle >= 0) & (hits.distance <= self.scene.limit))
        patch = self.scene.cells.patch[cells[rays // (len(hits.triangle) // len(cells))]]
        self.noted.append(np.unique((patch << _PATCH_BITS) + hits.triangle[rays]))


class ListBake(IncrementalBake):
    """An `IncrementalBake` that bakes the patches on the paper's list instead of all within reach.

    Parameters, results and rays are the same. Patches that an update bakes have the values that `IncrementalBake`
    gives them; others keep their sums. Objects that were not named as `movers` have no list until they have changed
    once. `Surfaces.patch` must tell the patch of each triangle; triangles without one are on no list.
    """

    _caster_type = _NotingCaster

    def __init__(self, *args: object, **kw: object) -> None:
        # By row of a mover, then by row of another object: which of the patches of the latter meet the former by a ray,
        # or are met by one.
        self._meets: dict[int, dict[int, np.ndarray]] = {}
        self._is_met: dict[int, dict[int, np.ndarray]] = {}
        super().__init__(*args, **kw)

    def listed(self, row: int) -> dict[int, np.ndarray]:
        """The list of the object in a row: which patches (p,) bool of the objects in other rows are on it."""
        listed = {other: patches.copy() for other, patches in self._meets.get(row, {}).items()}
        for other, patches in self._is_met.get(row, {}).items():
            listed[other] = patches | listed.get(other, False)
        return listed

    def _bake_influenced(self, change: Change, monitor: Monitor) -> Update:
        touched = change.rows | change.recoloured
        listed = [self.listed(row) for row in touched]
        for row in change.rows:
            self._meets.pop(row, None)
            self._is_met.pop(row, None)
        for lists in (*self._meets.values(), *self._is_met.values()):
            for row in change.reshaped | change.rows:
                lists.pop(row, None)
        own = self._bake_patches(dict.fromkeys(change.reshaped, np.True_), change, monitor)
        listed += [self.listed(row) for row in touched]
        chosen: dict[int, np.ndarray] = {}
        for row, patches in itertools.chain.from_iterable(lists.items() for lists in listed):
            if row not in change.reshaped and self._scene.table.states[row] is not None:
                chosen[row] = patches | chosen.get(row, False)
        rest = self._bake_patches(chosen, change, monitor)
        return dataclasses.replace(
            rest,
            keys=own.keys | rest.keys,
            patches=own.patches + rest.patches,
            rays=own.rays + rest.rays,
            cached=own.cached + rest.cached,
        )

    def _bake_patches(self, chosen: dict[int, np.ndarray], change: Change, monitor: Monitor) -> Update:
        """Bake some patches (p,) bool of the objects in some rows."""
        states = [self._scene.table.states[row] for row in chosen]
        masks = [np.broadcast_to(chosen[state.row], len(state.rays)) for state in states]
        chosen_of_all = np.concatenate([np.zeros(0, bool), *masks])
        return self._bake(states, join_cells_of(states), chosen_of_all, change.reshaped, monitor)

    def _take(self, states: list[ObjectState], cells: Cells, chosen: np.ndarray, caster: LayeredCaster) -> None:
        super()._take(states, cells, chosen, caster)
        pairs = np.unique(np.concatenate([np.zeros(0, np.int64), *caster.noted]))
        patch, triangle = pairs >> _PATCH_BITS, pairs & ((1 << _PATCH_BITS) - 1)
        met_row = self._scene.layers.rows_of(triangle)
        for state, own in parts(states):
            mine = slice(*np.searchsorted(patch, [own.start, own.stop]))
            for lists in self._meets.values():
                if state.row in lists:
                    lists[state.row][chosen[own]] = False
            for row in np.unique(met_row[mine]).tolist():
                to_it = mine.start + np.flatnonzero(met_row[mine] == row)
                if self._scene.is_mover(row):
                    _mark(self._meets, row, state, patch[to_it] - own.start)
                if self._scene.is_mover(state.row):
                    met = self._scene.table.states[row]
                    if met.source.surfaces.patch is not None:
                        met_patch = met.source.surfaces.patch[triangle[to_it] - met.first]
                        _mark(self._is_met, state.row, met, met_patch[met_patch >= 0])


def _mark(lists: dict[int, dict[int, np.ndarray]], row: int, other: ObjectState, patches: np.ndarray) -> None:
    """Enter patches (k,) int of another object in the list of the object in a row."""
    lists.setdefault(row, {}).setdefault(other.row, np.zeros(len(other.rays), bool))[patches] = True
