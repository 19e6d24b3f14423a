"""Bakes everything anew at every change, where one change reaches the whole scene."""

from __future__ import annotations

import time
from collections.abc import Iterable

import bpy

from ...core.light import LightSettings
from ...core.order import OutputSettings
from ...core.settings import BakeSettings
from ..jobs import BakeJob
from ..writing import has_layers
from .frame_update import NOTHING_DONE, FrameReport
from .scene_changes import SceneChanges


class FullUpdater:
    """Bakes everything anew at every update, for quantities in which one change reaches the whole scene.

    Parameters as for `BakeJob`, attributes as of `FrameUpdater`.
    """

    cache_is_full = False

    def __init__(
        self,
        objects: Iterable[bpy.types.Object],
        settings: BakeSettings,
        output: OutputSettings,
        light: LightSettings,
        in_child: bool = False,
    ) -> None:
        self._in_child = in_child
        self.wanted = {ob.session_uid for ob in objects}
        self._settings, self._output, self._light = settings, output, light
        self._changes: SceneChanges | None = None
        self._own: set[int] = set()  # what the last update wrote on
        self._is_changed = True
        self.notes: list[str] = []

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph, rewrite: bool = False) -> FrameReport:
        """Bake and write everything, unless nothing changed; parameters as for `FrameUpdater.update`."""
        began = time.perf_counter()
        if not (self._is_changed or rewrite or self._finds_changes(context, depsgraph)):
            return NOTHING_DONE
        objects = [ob for ob in context.view_layer.objects if ob.session_uid in self.wanted]
        job = BakeJob(
            context, objects, self._settings, self._output, self._light, in_child=self._in_child, depsgraph=depsgraph
        )
        self._changes = SceneChanges(job.snapshot, self.wanted, self._output.layer_names(), self._output.needs_rest)
        report = job.run()
        self.notes = list(dict.fromkeys([*self.notes, *report.warnings]))
        self._own = {uid for ob in objects for uid in (ob.session_uid, ob.data.session_uid)}
        self._is_changed = False
        return FrameReport(
            patches=report.patches,
            all_patches=report.patches,
            rays=report.rays,
            cached_rays=0,
            seconds=time.perf_counter() - began,
            full=f"{self._light.quantity.value.lower()} light reaches the whole scene",
            objects=report.objects,
        )

    def evaluate_written(self, context: bpy.types.Context) -> None:
        """Evaluate what depends on the meshes that were written before anyone listens; not in a frame handler.

        Heard of later, it would seem an edit, and light be baked without end.
        """
        context.view_layer.update()

    def end(self) -> None:
        """There is nothing to let go of."""

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Remember whether anything changed but the meshes on which values were written; these are compared later."""
        self._is_changed |= any(
            update.id.original.session_uid not in self._own
            for update in depsgraph.updates
            if update.is_updated_transform or update.is_updated_geometry or update.is_updated_shading
        )

    def distrust(self) -> None:
        """Bake next time, whatever is found."""
        self._is_changed = True

    def _finds_changes(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> bool:
        self._changes.distrust()
        if self._changes.find(context, depsgraph):
            return True
        baked = {change.baked.session_uid for change in self._changes.known.values() if change.baked is not None}
        return any(
            ob.session_uid in baked and not has_layers(ob.data, self._output) for ob in context.view_layer.objects
        )
