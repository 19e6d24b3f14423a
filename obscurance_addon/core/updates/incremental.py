"""Obscurances of a scene whose objects change: after each change, those of a full bake, bit for bit, for few rays.

The value of a patch depends on nothing farther than d_max from it. So only patches that near to where a changed object
was or is are baked again, and what their rays meet among objects that stand still is known from before. The 2003 paper
(section 5) keeps a list of influenced patches instead, see `list_bake`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Hashable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor

import numpy as np

from ..errors import GeometryError, ObscuranceError
from ..falloff import Falloff
from ..monitor import Monitor
from ..obscurance import open_values, patch_values
from ..scene import Cells, Normalisation, SceneObject, fill_invalid, join_objects, mean_of_sums, scattering_mean
from ..settings import BakeSettings
from ..tracing import EmbreeIntersector, Held, reach_of
from .caster import LayeredCaster, MovingLayer
from .changing_scene import Change, ChangingScene
from .influenced import influenced, is_within, objects_within
from .moving_scene import IntersectorMaker
from .object_state import ObjectState, join_cells_of
from .results import ObjectValues, Update

CEILING_BYTES = 1 << 29  # of kept hits: 67 million rays


class IncrementalBake:
    """Bakes a scene, and then what changes in it.

    Values always equal those that `bake_obscurances` gives for `join_objects(bake.objects.values())` and `bake.held`.
    Where a ray meets two surfaces of different colour at exactly the same distance (faces in one place), either bake
    may take either colour.

    Parameters
    ----------
    objects : mapping from hashable to SceneObject
    settings : BakeSettings
    movers : collection of hashable
        Objects that are expected to change. Others may change as well, but the first time costs a new ray tracer over
        all that stands still.
    ceiling_bytes : int
        Memory for kept hits, 8 bytes a ray. Beyond it updates trace more, and stay exact.
    held : Held, optional
        What would otherwise be derived from the scene as it is at first.
    monitor : Monitor, optional
    intersector : callable
        Builds ray tracers, as for `bake_obscurances`.

    Attributes
    ----------
    r_ave : ndarray, (3,) float64
        Mean reflectance of the scene as it is.
    scattering : ndarray, (3,) float64
        That of the surfaces that scatter light.
    last : Update
        The last one; at first what the whole bake was.

    Raises
    ------
    GeometryError
        When there is nothing to bake.
    BakeCancelledError
        When the monitor says so.
    """

    _caster_type = LayeredCaster

    def __init__(
        self,
        objects: Mapping[Hashable, SceneObject],
        settings: BakeSettings,
        *,
        movers: Collection[Hashable] = frozenset(),
        ceiling_bytes: int = CEILING_BYTES,
        held: Held | None = None,
        monitor: Monitor | None = None,
        intersector: IntersectorMaker = EmbreeIntersector,
    ) -> None:
        if not any(len(o.patches) for o in objects.values()):
            raise GeometryError("there is no face to bake: give objects with faces")
        if held is None:
            joined = join_objects(objects.values())
            normalisation = Normalisation.of(joined.patches.corners)
            held = Held(normalisation, reach_of(joined.surfaces, joined.patches, settings))
        self._settings, self._held = settings, held
        self._scene = ChangingScene(objects, movers, settings, held, intersector, ceiling_bytes)
        self.r_ave = self.scattering = np.zeros(3)
        self.last = self._bake_all(monitor or Monitor())
        self._is_usable = True

    @property
    def objects(self) -> dict[Hashable, SceneObject]:
        """The objects as they are now."""
        return {key: state.source for key, state in self._scene.states.items()}

    @property
    def held(self) -> Held:
        """What is held fixed; with it `bake_obscurances` gives the same values."""
        rays = [state.rays for state in self._scene.states.values()]
        return dataclasses.replace(self._held, rays=np.concatenate(rays) if self._scene.has_own_rays else None)

    @property
    def patches(self) -> int:
        """Number of patches of the objects as they are now."""
        return sum(len(state.rays) for state in self._scene.states.values())

    @property
    def cache_bytes(self) -> int:
        """Memory that kept hits take."""
        return self._scene.cache.bytes

    def values(self, key: Hashable) -> ObjectValues:
        """Obscurances of the patches of one object."""
        self._check()
        state, use_bleeding = self._scene.states[key], self._settings.use_bleeding
        if state.values is None:
            state.values = patch_values(state.sums, self.r_ave, self.scattering, use_bleeding)
            of_open = open_values(self.r_ave, use_bleeding)
            fill_invalid(state.values, state.sums.valid > 0.0, of_open, state.source.neighbours)
        return ObjectValues(state.values[:, :3], state.values[:, 3], state.values[:, 4:], state.sums.valid > 0.0)

    def _check(self) -> None:
        if not self._is_usable:
            raise ObscuranceError("an update was not finished: bake the scene anew")

    def update(self, changes: Mapping[Hashable, SceneObject | None], monitor: Monitor | None = None) -> Update:
        """Bake again what changes have influence on.

        Parameters
        ----------
        changes : mapping from hashable to SceneObject or None
            The objects that are different now, or new; None for those that are gone.
        monitor : Monitor, optional

        Raises
        ------
        BakeCancelledError
            When the monitor says so. After this or any other error from within the object cannot be used any more.
        KeyError
            When an unknown object is said to be gone; nothing has changed then.
        """
        self._check()
        if unknown := [key for key, source in changes.items() if source is None and key not in self._scene.states]:
            raise KeyError(*unknown)
        self._is_usable = False
        self.last = self._update(changes, monitor or Monitor())
        self._is_usable = True
        return self.last

    def _update(self, changes: Mapping[Hashable, SceneObject | None], monitor: Monitor) -> Update:
        scene = self._scene
        patch_counts = scene.patch_counts() if scene.has_own_rays else None
        needed_hits = scene.layers.needs_hits
        change = scene.apply(changes)
        if scene.has_own_rays and scene.patch_counts() != patch_counts:
            scene.share_rays()
            return self._bake_all(monitor, "the number of patches changed, among which rays are shared out")
        if scene.layers.needs_hits != needed_hits and self._settings.falloff is Falloff.STEP:
            return self._bake_all(monitor, "the first solid or transparent surface came, or the last one went")
        if scene.cache.is_clogged:
            scene.forget_hits()
        return self._bake_influenced(change, monitor)

    def _bake_influenced(self, change: Change, monitor: Monitor) -> Update:
        """Bake what a change may have influence on; this is all that sets other ways to choose it apart."""
        return self._bake(*self._influenced(change), change.reshaped, monitor)

    def _influenced(self, change: Change) -> tuple[list[ObjectState], Cells, np.ndarray]:
        """Objects that a change may have influence on, their cells, and which of their patches (p,) bool it has."""
        table, limit = self._scene.table, float(self._scene.layers.limit)
        near = objects_within(table, change.boxes, limit) | change.reshaped
        states = [table.states[row] for row in sorted(near) if table.states[row] is not None]
        cells = join_cells_of(states)
        chosen = influenced(states, cells, change.boxes, limit)
        for state, own in parts(states):
            chosen[own] |= state.row in change.reshaped
        return states, cells, chosen

    def _bake_all(self, monitor: Monitor, reason: str | None = None) -> Update:
        """Bake all patches, and keep no hits: most of them no mover will ever come near."""
        self._scene.forget_hits()
        states = list(self._scene.states.values())
        cells = join_cells_of(states)
        rows = {state.row for state in states}
        return self._bake(states, cells, np.ones(len(cells.area), bool), rows, monitor, reason)

    def _bake(
        self,
        states: list[ObjectState],
        cells: Cells,
        chosen: np.ndarray,
        fresh: set[int],
        monitor: Monitor,
        reason: str | None = None,
    ) -> Update:
        """Bake the chosen (p,) bool of the patches of several objects.

        Hits of those in the rows `fresh` are not kept: who has just moved is likely to move again.
        """
        with ThreadPoolExecutor(1, "obscurance-trace") as helper:  # its thread begins with its first work
            caster = self._caster(states, cells, chosen, fresh, monitor, helper)
            if len(caster.scene.cells.patch):
                caster.cast_all()
        self._take(states, cells, chosen, caster)
        keys = {state.key for state, own in parts(states) if chosen[own].any()}
        of_all, scattering, hidden = self._scene.table.areas.sum(0).reshape(3, 4)
        r_ave, scattering = mean_of_sums(of_all, hidden), scattering_mean(scattering)
        is_same = np.array_equal(r_ave, self.r_ave) and np.array_equal(scattering, self.scattering)
        if self._settings.use_bleeding and not is_same:
            keys = {key for key, state in self._scene.states.items() if len(state.rays)}
        self.r_ave, self.scattering = r_ave, scattering
        for key in keys:
            self._scene.states[key].values = None
        n_chosen, cache = int(np.count_nonzero(chosen)), self._scene.cache
        return Update(frozenset(keys), n_chosen, caster.rays, caster.cached, cache.is_full, reason)

    def _caster(
        self,
        states: list[ObjectState],
        cells: Cells,
        chosen: np.ndarray,
        fresh: set[int],
        monitor: Monitor,
        helper: Executor,
    ) -> LayeredCaster:
        layers = self._scene.layers
        at = chosen[cells.patch]
        rays = np.concatenate([np.zeros(0, np.int64), *(state.rays for state in states)])
        monitor.phase("trace", int(rays[chosen].sum()))
        boxes = np.concatenate([np.zeros((2, 0, 3)), *(state.patch_boxes for state in states)], axis=1)
        reach = np.full(len(rays), float(layers.limit))
        moving = [MovingLayer(layer, is_within(boxes, reach, layer.boxes)) for layer in layers.moving()]
        return self._caster_type(
            layers.traced(cells.of_patches(chosen), states),
            np.concatenate([np.zeros(0, np.uint32), *(state.source.patches.ids for state in states)]),
            self._settings,
            rays,
            monitor.advance,
            layers.static,
            moving,
            self._scene.cache,
            np.concatenate([np.zeros(0, np.int64), *(state.slots for state in states)])[at],
            np.concatenate([np.zeros(0, bool), *(np.full(len(s.count), s.row not in fresh) for s in states)])[at],
            helper,
        )

    def _take(self, states: list[ObjectState], cells: Cells, chosen: np.ndarray, caster: LayeredCaster) -> None:
        """Enter what was found for the chosen patches (p,) bool in the states of their objects."""
        sums = caster.patch_sums()
        slots = np.empty(len(cells.patch), np.int64)
        slots[chosen[cells.patch]] = caster.slots
        first_cell = 0
        for state, own in parts(states):
            end = first_cell + len(state.count)
            mine = chosen[own]
            if mine.any():
                for name in ("hit", "miss", "valid"):
                    getattr(state.sums, name)[mine] = getattr(sums, name)[own][mine]
                state.sums.tint[mine] = 0.0 if sums.tint is None else sums.tint[own][mine]
                at = mine[state.cells.patch]
                state.slots[at] = slots[first_cell:end][at]
                self._scene.table.refresh(state)
            first_cell = end


def parts(states: list[ObjectState]) -> Iterator[tuple[ObjectState, slice]]:
    """Each object, with its part of the patches of all."""
    first = 0
    for state in states:
        yield state, slice(first, first + len(state.rays))
        first += len(state.rays)
