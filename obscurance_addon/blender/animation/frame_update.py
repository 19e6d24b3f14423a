"""Keeps the values of some objects equal to those of a full bake while the scene changes.

    updater = FrameUpdater(context, objects, settings, output, ceiling_bytes)
    updater.start()                                       # the full bake
    report = updater.update(context, depsgraph)           # after every change

Nothing is evaluated but in the constructor without a depsgraph, so that frame handlers may do all of it. In a window,
`begin` starts the full bake in a child process, and `take` takes it over once its run is done.

What a full bake derives from the whole scene (recentring, the automatic distance) stays as it was at the start.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

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
    OutputSettings,
    Run,
    Target,
    make_follower,
)
from ...core.settings import BakeSettings
from ...core.updates import UpdateMode
from ..jobs import check_destination, writable_objects
from ..reading import snapshot_scene
from ..writing import refresh_values, shared_meshes, write_values
from .followed_objects import likely_movers
from .scene_changes import SceneChanges

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
    shared : list of str
        Names of objects that show the mean of several, as they share a mesh.
    """

    patches: int
    all_patches: int
    rays: int
    cached_rays: int
    seconds: float
    full: str
    objects: list[str]
    shared: list[str] = field(default_factory=list)


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
    depsgraph : bpy.types.Depsgraph, optional
        As for `snapshot_scene`.

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
        depsgraph: bpy.types.Depsgraph | None = None,
    ) -> None:
        if output.target is Target.LIGHTMAP:
            raise ObscuranceError("a lightmap cannot follow the scene: choose another target for Live Preview")
        self._settings, self._output, self._ceiling, self._mode = settings, output, ceiling_bytes, mode
        refused = Notes()
        writable = writable_objects(context, objects, refused, depsgraph)
        self.notes = refused.lines()
        check_destination(writable, output, None)
        self.wanted = {ob.session_uid for ob in writable}
        self._in_child = in_child
        self._follower: Follower | None = None
        self._last: Followed | None = None
        self._shared: dict[Hashable, frozenset[Hashable]] = {}
        objects = [ob for ob in context.view_layer.objects if ob.session_uid in self.wanted]
        layers, needs_rest = output.layer_names(), output.needs_rest
        snapshot = snapshot_scene(context, objects, needs_rest, layers, depsgraph=depsgraph)
        self._note(snapshot.notes)
        self.changes = SceneChanges(snapshot, self.wanted, layers, needs_rest)
        self._movers = likely_movers(context) & self.changes.known.keys()

    def _note(self, notes: list[str]) -> None:
        self.notes = list(dict.fromkeys([*self.notes, *notes]))

    def begin(self) -> Run:
        """Start the full bake of what was read."""
        if self._follower is None:
            self._follower = make_follower(self._in_child)
        order = FollowOrder(self.changes.known, self._settings, self._output, self._movers, self._ceiling, self._mode)
        return self._follower.begin(order, JobMonitor(Quantity.OBSCURANCE))

    def take(self, run: Run) -> None:
        """Write the values of a full bake that is done; main thread."""
        self._note(run.notes)
        self._last = run.result
        baked = self._baked()
        values = [self._values(key) for key in baked]
        write_values(list(baked.values()), values, self._output, STORED)
        self._shared = shared_meshes(baked, self._output)

    def end(self) -> None:
        """Let go of everything that is not the scene's."""
        if self._follower is not None:
            self._follower.end()
        self._follower = None

    def start(self) -> FrameReport:
        """The full bake, written at once; main thread."""
        began = time.perf_counter()
        run = self.begin()
        while not run.step(_LOOK_S):
            continue
        self.take(run)
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

    def evaluate_written(self, context: bpy.types.Context) -> None:
        """Leave it to the next evaluation, which is heard of and compared."""

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph, rewrite: bool = False) -> FrameReport:
        """Follow what changed in the scene since the last time, and write the new values.

        Parameters
        ----------
        context : bpy.types.Context
        depsgraph : bpy.types.Depsgraph
            Evaluated.
        rewrite : bool
            Write all values, changed or not, as after an undo.
        """
        began = time.perf_counter()
        changed = self.changes.find(context, depsgraph)
        self._note(self.changes.notes)
        self._last = self._follower.update(self.changes.known, changed, rewrite)
        update, baked = self._last.update, self._baked()
        chosen = set(baked) if rewrite else (update.keys | changed.keys()) & baked.keys()
        written = refresh_values(baked, chosen, self._values, self._output, STORED, self._shared)
        return FrameReport(
            patches=update.patches,
            all_patches=self._last.patches,
            rays=update.rays,
            cached_rays=update.cached,
            seconds=time.perf_counter() - began,
            full=update.reason or "",
            objects=[baked[key].snapshot.name for key in written],
            shared=[baked[key].snapshot.name for key in self._shared],
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
