"""Keeps the values of some objects equal to those of a full bake while the scene changes.

    updater = FrameUpdater(context, objects, settings, output, ceiling_bytes)
    updater.compute()                         # the full bake; any thread
    updater.write()
    report = updater.update(context)          # after every change

What a full bake derives from the whole scene (recentring, the automatic distance) stays as it was at the start.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.monitor import Monitor
from ...core.order import BakedObject, MeshArrays, ObjectArrays, OutputSettings, Scale, Target
from ...core.scene import SceneObject
from ...core.settings import BakeSettings
from ...core.tracing import Held
from ...core.updates import IncrementalBake, ListBake, UpdateMode
from ..jobs import check_destination, writable_objects
from ..reading import snapshot_scene
from ..writing import refresh_values, write_values
from .followed_objects import likely_movers
from .scene_changes import Change, NotUpdatableError, SceneChanges

STORED = "OBSCURANCE"
_BAKES = {UpdateMode.EXACT: IncrementalBake, UpdateMode.LIST: ListBake}


@dataclass(frozen=True)
class FrameReport:
    """What one update did.

    Attributes
    ----------
    patches, all_patches : int
        Patches that were baked again, of all there are.
    rays, cached_rays : int
        Rays that were cast, and rays whose static hits were known.
    seconds : float
        All of it, reading and writing included.
    full : str
        Why everything was baked, '' where that was not needed.
    objects : list of str
        Names of the objects that have new values.
    """

    patches: int
    all_patches: int
    rays: int
    cached_rays: int
    seconds: float
    full: str
    objects: list[str]


NOTHING_DONE = FrameReport(0, 0, 0, 0, 0.0, "", [])


class FrameUpdater:
    """Bakes some objects and follows the scene from then on.

    Parameters
    ----------
    context : bpy.types.Context
    objects : iterable of bpy.types.Object
        Mesh objects to bake, as for `BakeJob`; those that are hidden now may appear later.
    settings : BakeSettings
    output : OutputSettings
        With a target of the mesh.
    ceiling_bytes : int
        Memory for cached hits at most.
    mode : UpdateMode

    Attributes
    ----------
    wanted : set of int
        Session uids of the objects that receive values whenever they are visible.
    notes : list of str
        What the user should know.

    Raises
    ------
    ObscuranceError
        When there is nothing to bake.
    """

    def __init__(
        self,
        context: bpy.types.Context,
        objects: Iterable[bpy.types.Object],
        settings: BakeSettings,
        output: OutputSettings,
        ceiling_bytes: int,
        mode: UpdateMode = UpdateMode.EXACT,
    ) -> None:
        if output.target is Target.LIGHTMAP:
            raise ObscuranceError("a lightmap cannot follow the scene: choose another target for Live Preview")
        self._settings, self._output, self._ceiling, self._mode = settings, output, ceiling_bytes, mode
        self.notes: list[str] = []
        writable = writable_objects(objects, self.notes)
        check_destination(writable, output, None)
        self.wanted = {ob.session_uid for ob in writable}
        self._held: Held | None = None
        self._bake: IncrementalBake | None = None
        self._movers: set[Hashable] = set()
        self._untied: dict[Hashable, MeshArrays] = {}
        self._read_all(context)

    def _read_all(self, context: bpy.types.Context) -> None:
        """Read the whole scene; main thread."""
        objects = [ob for ob in context.view_layer.objects if ob.session_uid in self.wanted]
        layers = [name for name, _domain in self._output.layers()]
        snapshot = snapshot_scene(
            context, objects, needs_rest=self._output.target in {Target.CORNER, Target.POINT}, baked_layers=layers
        )
        self.notes = list(dict.fromkeys([*self.notes, *snapshot.notes]))
        self.changes = SceneChanges(snapshot, self.wanted, layers, self._untied)
        self._movers |= likely_movers(context) & self.changes.known.keys()

    def compute(self, monitor: Monitor | None = None) -> None:
        """The full bake of what was read; any thread, without bpy."""
        self._objects = ObjectArrays(self._output.target)
        self._elements: dict[Hashable, np.ndarray] = {}
        objects = {key: self._object(key, change) for key, change in self.changes.known.items()}
        self._bake = _BAKES[self._mode](
            objects,
            self._settings,
            movers=self._movers,
            ceiling_bytes=self._ceiling,
            held=self._held,
            monitor=monitor,
        )
        self._held = replace(self._bake.held, rays=None)  # their number is found anew with the patches

    def write(self) -> None:
        """Write all values, for the first time; main thread."""
        baked = self._baked()
        values = [self._values(key) for key in baked]
        write_values(list(baked.values()), values, self._output, STORED)

    def start(self) -> FrameReport:
        """The full bake, written at once; main thread."""
        began = time.perf_counter()
        self.compute()
        self.write()
        names = [baked.snapshot.name for baked in self._baked().values()]
        first = self._bake.last
        return FrameReport(
            first.patches, first.patches, first.rays, 0, time.perf_counter() - began, "the first frame", names
        )

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Remember what the depsgraph evaluated anew; called for every evaluation between two updates."""
        self.changes.note(depsgraph)

    def distrust(self) -> None:
        """Compare everything next time."""
        self.changes.distrust()

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph, rewrite: bool = False) -> FrameReport:
        """Follow what changed in the scene since the last time, and write the new values.

        Parameters
        ----------
        context : bpy.types.Context
        depsgraph : bpy.types.Depsgraph
            Evaluated; of the viewport.
        rewrite : bool
            Write all values, changed or not, as after an undo.
        """
        began = time.perf_counter()
        try:
            changed = self.changes.find(context, depsgraph)
        except NotUpdatableError as error:
            self._read_all(context)
            self.compute()
            changed, update, full, rewrite = {}, self._bake.last, str(error), True
        else:
            update = self._bake.update({key: change and self._object(key, change) for key, change in changed.items()})
            full = update.reason or ""
            for key in self._elements.keys() - self.changes.known.keys():
                del self._elements[key]
            self._objects.keep(change.snapshot.mesh for change in self.changes.known.values())
        baked = self._baked()
        chosen = set(baked) if rewrite else (update.keys | changed.keys()) & baked.keys()
        written = refresh_values(baked, chosen, self._values, self._output, STORED)
        return FrameReport(
            patches=update.patches,
            all_patches=self._bake.patches,
            rays=update.rays,
            cached_rays=update.cached,
            seconds=time.perf_counter() - began,
            full=full,
            objects=[baked[key].snapshot.name for key in written],
        )

    @property
    def cache_is_full(self) -> bool:
        """Whether there was no room to cache the hits of some rays."""
        return self._bake.last.cache_is_full

    def _object(self, key: Hashable, change: Change) -> SceneObject:
        if change.baked is None:
            return self._objects.occluder(change.snapshot)
        found, self._elements[key] = self._objects.baked(change.baked)
        return found

    def _baked(self) -> dict[Hashable, BakedObject]:
        known = self.changes.known
        return {key: change.baked for key, change in known.items() if change.baked is not None}

    def _values(self, key: Hashable) -> np.ndarray:
        """What to write on an object, (n, 3) float64."""
        is_white = self._output.scale is Scale.WHITE
        colours = self._bake.white(key) if is_white else self._bake.values(key).coloured
        return colours[self._elements[key]]
