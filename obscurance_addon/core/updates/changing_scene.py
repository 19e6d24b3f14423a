"""The objects of an incremental bake: who stands still, who moves, and what a change touches."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..falloff import Falloff
from ..sampling import allocate_rays
from ..scene import SceneObject
from ..settings import BakeSettings
from ..tracing import Held, boxes_in_reach, needs_palette
from .hit_cache import HitCache
from .moving_scene import IntersectorMaker, MovingScene
from .object_state import ObjectState, ObjectTable


@dataclass
class Change:
    """What is different after objects changed.

    Attributes
    ----------
    boxes : list of ndarray (2, 3) float64
        Around what changed, before and after, normalised.
    rows : set of int
        Of objects that rays meet elsewhere than before, or no more.
    reshaped : set of int
        Rows of objects all of whose patches are new, or in other rooms.
    recoloured : set of int
        Rows of objects that changed nothing but colours.
    """

    boxes: list[np.ndarray] = field(default_factory=list)
    rows: set[int] = field(default_factory=set)
    reshaped: set[int] = field(default_factory=set)
    recoloured: set[int] = field(default_factory=set)

    def add(self, state: ObjectState) -> None:
        """Rays meet the object no more, or they do from now on."""
        self.rows.add(state.row)
        self.boxes.append(state.box)


class ChangingScene:
    """All objects, the layers in which they are traced, and the cache of hits among those that stand still.

    Parameters
    ----------
    objects, movers, settings, held, intersector, ceiling_bytes
        As for `IncrementalBake`.

    Attributes
    ----------
    states : dict from hashable to ObjectState
    table : ObjectTable
    layers : MovingScene
    cache : HitCache
    has_own_rays : bool
        Whether patches differ in their number of rays.
    """

    def __init__(
        self,
        objects: Mapping[Hashable, SceneObject],
        movers: Collection[Hashable],
        settings: BakeSettings,
        held: Held,
        intersector: IntersectorMaker,
        ceiling_bytes: int,
    ) -> None:
        self._settings, self._held = settings, held
        self.has_own_rays = held.rays is not None or settings.ray_budget is not None
        self.table = ObjectTable()
        self.layers = MovingScene(held.normalisation, held.d_max, settings, intersector)
        self.cache = HitCache(ceiling_bytes)
        self.states: dict[Hashable, ObjectState] = {}
        self._static: dict[int, ObjectState] = {}  # by row, those that are traced
        self._movers: dict[int, ObjectState] = {}
        self._hollow: set[tuple[int, int]] = set()  # as of `MovingScene`
        for key, source in objects.items():
            self._enter(key, source, None)
        self.share_rays(held.rays)
        self._change_presence(Change())
        self._static = {row: state for row, state in self._movers.items() if state.key not in movers}
        self._movers = {row: state for row, state in self._movers.items() if state.key in movers}
        self.layers.set_static(list(self._static.values()))
        self.layers.set_movers(list(self._movers.values()), [])
        self._settle_rooms(Change())

    def share_rays(self, rays: np.ndarray | None = None) -> None:
        """Give all patches their numbers of rays (p,), those of the settings by default."""
        states = list(self.states.values())
        if rays is None:
            rays = allocate_rays(np.concatenate([np.zeros(0), *(s.cells.area for s in states)]), self._settings)
        end = np.cumsum([0, *(len(state.source.patches) for state in states)])
        for i, state in enumerate(states):
            state.share_rays(rays[end[i] : end[i + 1]])

    def patch_counts(self) -> dict[Hashable, int]:
        """Number of patches of each object."""
        return {key: len(state.source.patches) for key, state in self.states.items()}

    def is_mover(self, row: int) -> bool:
        """Whether the object in a row is traced among those that move."""
        return row in self._movers

    def forget_hits(self) -> None:
        """Empty the cache."""
        for state in self.states.values():
            state.forget_hits()
        self.cache.clear()

    def apply(self, changes: Mapping[Hashable, SceneObject | None]) -> Change:
        """Replace, add and remove objects, and build the layers that this changes."""
        change, static = Change(), dict(self._static)
        for key, source in changes.items():
            state = self.states.get(key)
            if state is None or source is None or not source.has_shape_of(state.source):
                self._replace(key, state, source, change)
            elif not source.has_colours_of(state.source):
                self._recolour(state, source, change)
        self._change_presence(change)
        if promoted := [state for row, state in static.items() if row not in self._static]:
            self._promote(promoted)
        resting = [state for row, state in self._movers.items() if row not in change.rows]
        self.layers.set_movers(resting, [state for row, state in self._movers.items() if row in change.rows])
        self._settle_rooms(change)
        return change

    def _settle_rooms(self, change: Change) -> None:
        """Add to a change the objects that are in other rooms now, and bodies that became solid or hollow."""
        for state in self.states.values():
            rooms, before = self.layers.rooms_of(state) if state.first >= 0 else None, state.rooms
            if (rooms is None) != (before is None) or not (rooms is None or np.array_equal(rooms, before)):
                change.reshaped.add(state.row)
                self.cache.waste(state.forget_hits())
            state.rooms = rooms
        if toggled := self.layers.hollow ^ self._hollow:
            rows = {row for row, _ in toggled}
            change.boxes += [state.box for state in self.states.values() if state.row in rows]
            self.forget_hits()
        self._hollow = self.layers.hollow

    def _enter(self, key: Hashable, source: SceneObject, before: ObjectState | None) -> ObjectState:
        """Make the state of an object, in the row of what it replaces."""
        state = ObjectState(source, key, self.table.add() if before is None else before.row, self._held.normalisation)
        n = len(source.patches)
        keeps_rays = self.has_own_rays and before is not None and len(before.rays) == n
        state.share_rays(before.rays if keeps_rays else np.full(n, self._settings.rays, np.int64))
        self.states[key] = state
        self.table.put(state)
        return state

    def _replace(self, key: Hashable, state: ObjectState | None, source: SceneObject | None, change: Change) -> None:
        if state is not None:
            self.cache.waste(state.forget_hits())
            if self.table.present[state.row]:
                self._leave(state, change)
        if source is not None:
            change.reshaped.add(self._enter(key, source, state).row)
        elif state is not None:
            del self.states[key]
            self.table.remove(state.row)

    def _recolour(self, state: ObjectState, source: SceneObject, change: Change) -> None:
        state.recolour(source)
        self.table.refresh(state)
        if self.table.present[state.row]:
            self.layers.recolour(state)
            if state.row in self._static:
                self.cache.forget_sums()
            if needs_palette(self._settings):
                change.recoloured.add(state.row)
                change.boxes.append(state.box)

    def _change_presence(self, change: Change) -> None:
        """Let objects enter and leave that are in reach of a patch now or no more, as `build_scene` has it."""
        wanted = boxes_in_reach(self.table.traced, self.table.corner_box(), self._held.d_max)
        wanted &= np.isfinite(self.table.traced[0]).all(-1)  # even where d_max is infinite
        for row in np.flatnonzero(wanted != self.table.present):
            state = self.table.states[row]
            if self.table.present[row]:
                self._leave(state, change)
            else:
                self.table.present[row], self._movers[state.row] = True, state
                change.add(state)

    def _leave(self, state: ObjectState, change: Change) -> None:
        """An object is no longer traced where it is."""
        self.table.present[state.row] = False
        self._static.pop(state.row, None)
        self._movers.pop(state.row, None)
        change.add(state)

    def _promote(self, states: list[ObjectState]) -> None:
        """Objects that stood still do so no more: what the cache knows of them is void."""
        self.layers.set_static(list(self._static.values()))
        if self._settings.falloff is Falloff.STEP:  # then it may not know what is hit
            self.forget_hits()
            return
        places = np.sort(np.concatenate([self.cache.places_of(*state.numbers()) for state in states]))
        for state in self.states.values():
            self.cache.waste(state.forget_hits(places))
