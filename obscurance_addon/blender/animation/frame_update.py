"""Keeps the values of some objects equal to those of a full bake while the scene changes.

    updater = FrameUpdater(context, objects, settings, output, ceiling_bytes)
    updater.start()                                       # the full bake
    report = updater.update(context, depsgraph)           # after every change

In a window, `begin` starts the full bake in a child process, and `take` takes it over once its run is done.

What a full bake derives from the whole scene (recentring, the automatic distance) stays as it was at the start.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.light import Quantity
from ...core.notes import Notes
from ...core.order import (
    BakedObject,
    Followed,
    Follower,
    FollowOrder,
    JobMonitor,
    MeshArrays,
    OutputSettings,
    Run,
    Target,
    make_follower,
)
from ...core.settings import BakeSettings
from ...core.tracing import Held
from ...core.updates import UpdateMode
from ..jobs import check_destination, writable_objects
from ..reading import snapshot_scene
from ..writing import refresh_values, write_values
from .followed_objects import likely_movers
from .scene_changes import NotUpdatableError, SceneChanges

STORED = "OBSCURANCE"
_LOOK_S = 0.1


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
    in_child : bool
        Have a child process compute, as in windows.

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
        in_child: bool = False,
    ) -> None:
        if output.target is Target.LIGHTMAP:
            raise ObscuranceError("a lightmap cannot follow the scene: choose another target for Live Preview")
        self._settings, self._output, self._ceiling, self._mode = settings, output, ceiling_bytes, mode
        refused = Notes()
        writable = writable_objects(context, objects, refused)
        self.notes = refused.lines()
        check_destination(writable, output, None)
        self.wanted = {ob.session_uid for ob in writable}
        self._held: Held | None = None
        self._in_child = in_child
        self._follower: Follower | None = None
        self._last: Followed | None = None
        self._movers: set[Hashable] = set()
        self._untied: dict[Hashable, MeshArrays] = {}
        self._read_all(context)

    def _read_all(self, context: bpy.types.Context) -> None:
        """Read the whole scene; main thread."""
        objects = [ob for ob in context.view_layer.objects if ob.session_uid in self.wanted]
        layers = self._output.layer_names()
        snapshot = snapshot_scene(context, objects, needs_rest=self._output.needs_rest, baked_layers=layers)
        self.notes = list(dict.fromkeys([*self.notes, *snapshot.notes]))
        self.changes = SceneChanges(snapshot, self.wanted, layers, self._untied)
        self._movers |= likely_movers(context) & self.changes.known.keys()

    def begin(self) -> Run:
        """Start the full bake of what was read."""
        if self._follower is None:
            self._follower = make_follower(self._in_child)
        order = FollowOrder(
            self.changes.known, self._settings, self._output, self._movers, self._ceiling, self._mode, self._held
        )
        return self._follower.begin(order, JobMonitor(Quantity.OBSCURANCE))

    def take(self, run: Run) -> None:
        """Write the values of a full bake that is done; main thread."""
        self._take(run)
        baked = self._baked()
        values = [self._values(key) for key in baked]
        write_values(list(baked.values()), values, self._output, STORED)

    def _take(self, run: Run) -> None:
        self.notes = list(dict.fromkeys([*self.notes, *run.notes]))
        self._last, self._held = run.result, run.result.held

    def _compute(self) -> Run:
        run = self.begin()
        while not run.step(_LOOK_S):
            continue
        return run

    def end(self) -> None:
        """Let go of everything that is not the scene's."""
        if self._follower is not None:
            self._follower.end()
        self._follower = None

    def start(self) -> FrameReport:
        """The full bake, written at once; main thread."""
        began = time.perf_counter()
        self.take(self._compute())
        names = [baked.snapshot.name for baked in self._baked().values()]
        first = self._last.update
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
            self._take(self._compute())
            changed, full, rewrite = {}, str(error), True
        else:
            self._last = self._follower.update(self.changes.known, changed, rewrite)
            full = self._last.update.reason or ""
        update = self._last.update
        baked = self._baked()
        chosen = set(baked) if rewrite else (update.keys | changed.keys()) & baked.keys()
        written = refresh_values(baked, chosen, self._values, self._output, STORED)
        return FrameReport(
            patches=update.patches,
            all_patches=self._last.patches,
            rays=update.rays,
            cached_rays=update.cached,
            seconds=time.perf_counter() - began,
            full=full,
            objects=[baked[key].snapshot.name for key in written],
        )

    @property
    def cache_is_full(self) -> bool:
        """Whether there was no room to cache the hits of some rays."""
        return self._last.update.cache_is_full

    def _baked(self) -> dict[Hashable, BakedObject]:
        known = self.changes.known
        return {key: change.baked for key, change in known.items() if change.baked is not None}

    def _values(self, key: Hashable) -> np.ndarray:
        """What to write on an object, (n, 3) float64."""
        values = self._last.values.get(key)
        return self._follower.values(key) if values is None else values
