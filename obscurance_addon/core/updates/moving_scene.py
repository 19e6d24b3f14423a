"""A scene in three layers: what stands still, what moved before, and what moves now."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..scene import Cells, Normalisation, Surfaces, Transmission, join_transmissions
from ..settings import BakeSettings
from ..tracing import (
    MISS,
    Intersector,
    Layer,
    LayeredIntersector,
    TracedScene,
    Transparency,
    limit_and_scale,
    make_intersector,
    needs_palette,
    palette_colours,
)
from .object_state import ObjectState

IntersectorMaker = Callable[[np.ndarray, np.ndarray, Callable[[int], None]], Intersector]

_NO_SURFACES = Surfaces(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32), np.zeros(0, bool))


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
        self._palette, self._solid = np.zeros((1, 4), np.float32), np.zeros(1, bool)
        self._owner = np.full(1, MISS, np.int32)
        self.has_solid = False
        self._traced: list[ObjectState] = []

    def set_static(self, states: list[ObjectState]) -> None:
        """Say what stands still. After the first time only some of these may stay, which keep their numbers."""
        if not self._static_end:
            self._static_end = _number(states, 0)
            self._write(states)
        self._static = states
        self.static = self._layer(states)

    def set_movers(self, resting: list[ObjectState], changed: list[ObjectState]) -> None:
        """Say what moved before and what moves now."""
        before = [state.first for state in resting]
        self._end = _number(resting + changed, self._static_end)
        self._write([state for state, first in zip(resting, before, strict=True) if state.first != first] + changed)
        members = [(state, state.first) for state in resting]
        if members != self._resting:
            self._resting, self.resting = members, self._layer(resting)
        self.changed = self._layer(changed)
        self._traced = [*self._static, *resting, *changed]
        self.has_solid = any(state.is_solid for state in self._traced)

    @property
    def needs_hits(self) -> bool:
        """Whether STEP, too, has to know what rays meet: where there are solids, or something transparent."""
        return self.has_solid or any(state.is_transparent for state in self._traced)

    def recolour(self, state: ObjectState) -> None:
        """Take over the colours of an object that has its numbers already."""
        self._write([state])

    def moving(self) -> list[Layer]:
        """The layers of movers."""
        return [layer for layer in (self.resting, self.changed) if layer is not None]

    def traced(self, cells: Cells) -> TracedScene:
        """The scene as rays from the cells meet it."""
        layers = [layer for layer in (self.static, self.resting, self.changed) if layer is not None]
        return TracedScene(
            cells,
            _NO_SURFACES,
            LayeredIntersector(layers),
            self._palette[: self._end + 1] if needs_palette(self._settings) else None,
            self._solid[: self._end + 1] if self.has_solid else None,
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
        """Enter the colours of all triangles, and whether they are solid."""
        size = 1 + max((state.numbers()[1] for state in states), default=0)
        if size > len(self._solid):
            more = max(size, 2 * len(self._solid)) - len(self._solid)
            self._palette = np.concatenate([self._palette, np.ones((more, 4), np.float32)])
            self._solid = np.concatenate([self._solid, np.zeros(more, bool)])
            self._owner = np.concatenate([self._owner, np.full(more, MISS, np.int32)])
        for state in states:
            surfaces = state.source.surfaces
            own = slice(state.first + 1, state.first + 1 + len(surfaces.triangles))
            self._palette[own, :3], self._solid[own] = palette_colours(surfaces), surfaces.solid
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


def _ignore(_triangles: int) -> None:
    return None


def _number(states: list[ObjectState], first: int) -> int:
    """Number the triangles of the objects from `first` on; returns the number after the last."""
    for state in states:
        state.first = first
        first = state.numbers()[1]
    return first
