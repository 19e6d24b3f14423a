"""Obscurances of a scene that changes, from snapshots to the values of elements."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..monitor import Monitor
from ..scene import SceneObject
from ..settings import BakeSettings
from ..tracing import Held
from ..updates import IncrementalBake, ListBake, Update, UpdateMode
from .object_arrays import ObjectArrays
from .output import OutputSettings, Scale
from .snapshot import Change

_BAKES = {UpdateMode.EXACT: IncrementalBake, UpdateMode.LIST: ListBake}


@dataclass(frozen=True)
class FollowOrder:
    """A scene to bake, and to follow from then on.

    Attributes
    ----------
    objects : mapping from hashable to Change
        The objects as they are.
    settings : BakeSettings
    output : OutputSettings
        With a target of the mesh.
    movers : collection of hashable
        Objects that are expected to change.
    ceiling_bytes : int
        Memory for kept hits.
    mode : UpdateMode
    held : Held or None
        What stays as it was at the first bake of all.
    """

    objects: Mapping[Hashable, Change]
    settings: BakeSettings
    output: OutputSettings
    movers: Collection[Hashable]
    ceiling_bytes: int
    mode: UpdateMode
    held: Held | None = None

    def carry_out(self, monitor: Monitor, _intersector: Callable) -> Following:
        """Bake the scene as it is."""
        return Following(self, monitor)


@dataclass(frozen=True)
class Followed:
    """What one update did.

    Attributes
    ----------
    update : Update
    patches : int
        All there are.
    held : Held
        For the next `FollowOrder`.
    values : dict from hashable to ndarray, (n, 3) float64
        Of the objects that were asked for.
    """

    update: Update
    patches: int
    held: Held
    values: dict[Hashable, np.ndarray]


class Following:
    """Bakes a scene and follows its changes; numpy only, in any process.

    Parameters
    ----------
    order : FollowOrder
    monitor : Monitor, optional

    Raises
    ------
    GeometryError
        When there is nothing to bake.
    """

    def __init__(self, order: FollowOrder, monitor: Monitor | None = None) -> None:
        self._is_white = order.output.scale is Scale.WHITE
        self._objects = ObjectArrays(order.output.target)
        self._elements: dict[Hashable, np.ndarray] = {}
        self._known = dict(order.objects)
        objects = {key: self._object(key, change) for key, change in self._known.items()}
        self._bake = _BAKES[order.mode](
            objects,
            order.settings,
            movers=order.movers,
            ceiling_bytes=order.ceiling_bytes,
            held=order.held,
            monitor=monitor,
        )

    def first(self) -> Followed:
        """What the bake of the whole scene did, with all values."""
        return self._followed(self._bake.last, self._elements)

    def update(
        self, changes: Mapping[Hashable, Change | None], rewrite: bool, monitor: Monitor | None = None
    ) -> Followed:
        """Bake again what changes have influence on.

        Parameters
        ----------
        changes : mapping from hashable to Change or None
            Objects that are different now, or new; None for those that are gone.
        rewrite : bool
            All values are asked for, not only new ones.
        monitor : Monitor, optional
        """
        for key, change in changes.items():
            if change is None:
                self._known.pop(key, None)
            else:
                self._known[key] = change
        objects = {key: change and self._object(key, change) for key, change in changes.items()}
        update = self._bake.update(objects, monitor)
        for key in self._elements.keys() - self._known.keys():
            del self._elements[key]
        baked = [change.baked for change in self._known.values() if change.baked is not None]
        beside = [one.beside.mesh for one in baked if one.beside is not None]
        self._objects.keep([change.snapshot.mesh for change in self._known.values()] + beside)
        asked = self._elements if rewrite else (update.keys | changes.keys()) & self._elements.keys()
        return self._followed(update, asked)

    def values(self, key: Hashable) -> np.ndarray:
        """What to write on an object, (n, 3) float64."""
        values = self._bake.values(key)
        return (values.white if self._is_white else values.coloured)[self._elements[key]]

    def _followed(self, update: Update, asked: Collection[Hashable]) -> Followed:
        held = replace(self._bake.held, rays=None)  # their number is found anew with the patches
        return Followed(update, self._bake.patches, held, {key: self.values(key) for key in asked})

    def _object(self, key: Hashable, change: Change) -> SceneObject:
        if change.baked is None:
            self._elements.pop(key, None)
            return self._objects.occluder(change.snapshot)
        found, self._elements[key] = self._objects.baked(change.baked)
        return found
