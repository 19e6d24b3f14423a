"""A scene in three layers: what stands still, what moved before, and what moves now."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..scene import Cells, Normalisation, Shells, Surfaces, Transmission, join_transmissions
from ..settings import BakeSettings
from ..tracing import (
    MISS,
    Bodies,
    BodyShapes,
    Intersector,
    Layer,
    LayeredIntersector,
    Rooms,
    ShellPoints,
    TracedScene,
    Transparency,
    limit_and_scale,
    make_intersector,
    needs_palette,
    palette_colours,
    settle_rooms,
)
from .object_state import ObjectState

IntersectorMaker = Callable[[np.ndarray, np.ndarray, Callable[[int], None]], Intersector]

_NO_SURFACES = Surfaces(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32), Shells.none(0))


class MovingScene:
    """The layers, and the look-up tables over the triangles of all of them.

    Parameters
    ----------
    normalisation : Normalisation
    d_max : float
        Metres.
    settings : BakeSettings
    intersector : callable
        Builds ray tracers, as for `bake_obscurances`.

    Attributes
    ----------
    static, resting, changed : Layer or None
        What stands still, movers that did not change now, and those that did; None for no triangle.
    limit, scale : float32
        As of `TracedScene`.
    hollow : set of tuple of two int
        Row of the object, and number among its shells, of bodies that are solid for nobody.
    """

    def __init__(
        self, normalisation: Normalisation, d_max: float, settings: BakeSettings, intersector: IntersectorMaker
    ) -> None:
        self._normalisation, self._settings, self._intersector = normalisation, settings, intersector
        self.limit, self.scale = limit_and_scale(d_max, normalisation)
        self.static = self.resting = self.changed = None
        self._static_end = self._end = 0
        self._static: list[ObjectState] = []
        self._resting: list[tuple[ObjectState, int]] = []
        self._palette, self._body = np.zeros((1, 4), np.float32), np.zeros(1, np.int32)
        self._owner = np.full(1, MISS, np.int32)
        self._static_solids = self._resting_solids = _solids([])
        self._bodies: Bodies | None = None
        self._rooms: Rooms | None = None
        self._traced: list[ObjectState] = []

    def set_static(self, states: list[ObjectState]) -> None:
        """Say what stands still. After the first time only some of these may stay, which keep their numbers."""
        if not self._static_end:
            self._static_end = _number(states, 0)
            self._write(states)
        self._static = states
        self.static, self._static_solids = self._layer(states), _solids(states)

    def set_movers(self, resting: list[ObjectState], changed: list[ObjectState]) -> None:
        """Say what moved before and what moves now."""
        before = [state.first for state in resting]
        self._end = _number(resting + changed, self._static_end)
        self._write([state for state, first in zip(resting, before, strict=True) if state.first != first] + changed)
        members = [(state, state.first) for state in resting]
        if members != self._resting:
            self._resting, self.resting, self._resting_solids = members, self._layer(resting), _solids(resting)
        self.changed = self._layer(changed)
        self._traced = states = [*self._static, *resting, *changed]
        solids = self._static_solids, self._resting_solids, _solids(changed)
        shapes = BodyShapes.joined(of_bodies for of_bodies, _ in solids)
        shells = ShellPoints.joined(of_shells for _, of_shells in solids)
        bodies = Bodies(self._body[: self._end + 1], shapes, self._bodies) if len(shapes.numbers) else None
        self._bodies, self._rooms = settle_rooms(shells, bodies)
        self._first_of_row = {state.row: state.first for state in states}
        hollow = np.setdiff1d(bodies.numbers, self._bodies.numbers if self.has_solid else []) if bodies else np.zeros(0)
        self.hollow = {tuple(key) for key in self._keys(hollow.astype(np.int32)).tolist()}

    @property
    def needs_hits(self) -> bool:
        """Whether STEP, too, has to know what rays meet: where there are solids, or something transparent."""
        return self.has_solid or any(state.is_transparent for state in self._traced)

    def recolour(self, state: ObjectState) -> None:
        """Take over the colours of an object that has its numbers already."""
        self._write([state])

    def rooms_of(self, state: ObjectState) -> np.ndarray | None:
        """Rooms of the patches of an object, as of `ObjectState.rooms`."""
        rooms = self._rooms_of([state])
        return None if rooms is None else self._keys(rooms)

    def _rooms_of(self, states: list[ObjectState]) -> np.ndarray | None:
        """Numbers of the rooms of all patches of objects, as of `TracedScene.rooms`."""
        if not len(self._rooms.body) or any(state.source.patches.shell is None for state in states):
            return None
        shells = [state.source.patches.shell for state in states]
        first = [state.first for state in states]
        shells = [np.where(own > 0, own + np.int32(at), 0) for own, at in zip(shells, first, strict=True)]
        return self._rooms.of(np.concatenate([np.zeros(0, np.int32), *shells]))

    def _keys(self, numbers: np.ndarray) -> np.ndarray:
        """Row of the object, and number among its shells, of shells of any shape (..., ) int32: (..., 2) int64."""
        rows = self._owner[numbers]
        firsts = np.array([self._first_of_row.get(row, 0) for row in range(int(rows.max(initial=0)) + 1)])
        return np.stack([rows, np.where(numbers > 0, numbers - firsts[rows], 0)], -1).astype(np.int64)

    @property
    def has_solid(self) -> bool:
        """Whether anything is solid."""
        return self._bodies is not None

    def moving(self) -> list[Layer]:
        """The layers of movers."""
        return [layer for layer in (self.resting, self.changed) if layer is not None]

    def traced(self, cells: Cells, states: list[ObjectState]) -> TracedScene:
        """The scene as rays from the cells meet it, whose patches are those of some objects."""
        layers = [layer for layer in (self.static, self.resting, self.changed) if layer is not None]
        return TracedScene(
            cells,
            _NO_SURFACES,
            LayeredIntersector(layers),
            self._palette[: self._end + 1] if needs_palette(self._settings) else None,
            self._bodies,
            self._rooms_of(states),
            self.limit,
            self.scale,
            self._settings.falloff,
            Transparency.of(self._transmission(), self._normalisation),
        )

    def _transmission(self) -> Transmission | None:
        """What passes all triangles, in the order of their numbers; None if all are opaque."""
        if not any(state.is_transparent for state in self._traced):
            return None
        parts, end = [], 0
        for state in sorted(self._traced, key=lambda state: state.first):
            first, after = state.numbers()
            parts += [(first - end, None), (after - first, state.source.surfaces.transmission)]
            end = after
        return join_transmissions([*parts, (self._end - end, None)])

    def rows_of(self, triangles: np.ndarray) -> np.ndarray:
        """Row of the object of each triangle (m,) int; MISS for MISS."""
        return self._owner[triangles + 1].astype(np.int64)

    def _write(self, states: list[ObjectState]) -> None:
        """Enter the colours of all triangles, and their bodies."""
        size = 1 + max((state.numbers()[1] for state in states), default=0)
        if size > len(self._body):
            more = max(size, 2 * len(self._body)) - len(self._body)
            self._palette = np.concatenate([self._palette, np.ones((more, 4), np.float32)])
            self._body = np.concatenate([self._body, np.zeros(more, np.int32)])
            self._owner = np.concatenate([self._owner, np.full(more, MISS, np.int32)])
        for state in states:
            surfaces = state.source.surfaces
            own = slice(state.first + 1, state.first + 1 + len(surfaces.triangles))
            self._palette[own, :3] = palette_colours(surfaces)
            self._body[own] = surfaces.shells.numbered_from(state.first).body
            self._owner[own] = state.row

    def _layer(self, states: list[ObjectState]) -> Layer | None:
        """A ray tracer over what can be traced of the objects."""
        states = [state for state in states if len(state.usable)]
        if not states:
            return None
        vertices = [self._normalisation.apply(state.source.surfaces.vertices) for state in states]
        start = np.cumsum([0, *map(len, vertices)])
        triangles = np.concatenate(
            [state.source.surfaces.triangles[state.usable] + start[i] for i, state in enumerate(states)]
        )
        finite = np.nan_to_num(np.concatenate(vertices), nan=0.0, posinf=0.0, neginf=0.0)  # no usable one has others
        ids = np.concatenate([state.first + state.usable for state in states]).astype(np.int32)
        slender = np.concatenate([state.slender for state in states])
        tracer = make_intersector(self._intersector, finite, triangles, slender, _ignore)
        return Layer(tracer, ids, [state.box for state in states])


def _solids(states: list[ObjectState]) -> tuple[BodyShapes, ShellPoints]:
    """Bodies and shells of objects that have their numbers."""
    return (
        BodyShapes.joined(state.bodies.numbered_from(state.first) for state in states),
        ShellPoints.joined(state.shells.numbered_from(state.first) for state in states),
    )


def _ignore(_triangles: int) -> None:
    return None


def _number(states: list[ObjectState], first: int) -> int:
    """Number the triangles of the objects from `first` on; returns the number after the last."""
    for state in states:
        state.first = first
        first = state.numbers()[1]
    return first
