"""One bake of some objects of a scene, driven alike by the operator, the command line and scripts.

    job = BakeJob(context, objects, settings, output)
    while not job.step(0.1):
        show(job.progress, job.remaining)
    report = job.commit()

The constructor reads the scene into a work order, `step` has it carried out, `commit` writes. Until then nothing of the
user's changes.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace

import bpy

from ...core.errors import BakeCancelledError, ObscuranceError, SettingsError
from ...core.light import LightSettings, Quantity
from ...core.lightmap import LightmapSettings, UvMode
from ...core.notes import Notes, named
from ...core.order import (
    BakeOrder,
    BakeReport,
    BakeResult,
    JobMonitor,
    KeptChild,
    OutputSettings,
    Run,
    Target,
    ThreadRun,
)
from ...core.settings import BakeSettings
from ...core.tracing import IntersectorCache
from ..reading import Modifiers, Reason, as_rendered, note_refused, nothing_to_bake, shape_reason, snapshot_scene
from ..stored_preferences import cache_ceiling_bytes
from ..writing import check_path, color_attribute, records, uv_layer, write_lightmap, write_values

TRACERS = IntersectorCache()  # while a user tries settings, the geometry stays
CHILD = KeptChild()  # of all windows: one bake runs at a time
_OPEN: weakref.WeakSet[BakeJob] = weakref.WeakSet()  # jobs that still may write
_committed = 0
_LINKED = Reason(
    "linked from a library", "make the mesh local (Object > Relations > Make Local > Selected Objects and Data)"
)


def commit_count() -> int:
    """Number of bakes whose results were written since Blender began."""
    return _committed


def is_baking() -> bool:
    """Whether a bake is under way, so that nothing else should write values."""
    return any(job.is_open for job in _OPEN)


class BakeJob:
    """A bake that is under way.

    Parameters
    ----------
    context : bpy.types.Context
        Its scene and view layer are baked; must be in object mode.
    objects : iterable of bpy.types.Object
        What to bake; everything else that is visible occludes. Objects whose mesh is linked are skipped with a warning.
    settings : BakeSettings
    output : OutputSettings
    light : LightSettings, optional
        Obscurances by default.
    lightmap : LightmapSettings, optional
        For target LIGHTMAP.
    in_child : bool
        Have a child process carry it out, so that a window answers meanwhile; else a thread of this process does while
        `step` waits.
    depsgraph : bpy.types.Depsgraph, optional
        As for `snapshot_scene`. With it, what is hidden in the viewport does not count.
    modifiers : Modifiers
        Whether to bake modifiers, and levels of subdivision, as in renders; with `depsgraph` they are as it has them.

    Raises
    ------
    ObscuranceError
        When nothing can be baked, or the name or file of the result cannot be used; the message names object and cure.
    """

    def __init__(
        self,
        context: bpy.types.Context,
        objects: Iterable[bpy.types.Object],
        settings: BakeSettings,
        output: OutputSettings,
        light: LightSettings | None = None,
        lightmap: LightmapSettings | None = None,
        in_child: bool = False,
        depsgraph: bpy.types.Depsgraph | None = None,
        modifiers: Modifiers = Modifiers.VIEWPORT,
    ) -> None:
        began = time.perf_counter()
        light = light or LightSettings()
        to_lightmap = output.target is Target.LIGHTMAP
        lightmap = (lightmap or LightmapSettings()) if to_lightmap else None
        if light.quantity is Quantity.RADIOSITY and output.target not in {Target.FACE, Target.LIGHTMAP}:
            raise SettingsError("radiosity is computed for whole faces: use target FACE, or bake COMBINED")
        refused = Notes()
        writable = writable_objects(context, objects, refused, depsgraph)
        check_destination(writable, output, lightmap)
        with as_rendered(context, modifiers) if depsgraph is None else nullcontext():
            self.snapshot = snapshot = snapshot_scene(
                context,
                writable,
                needs_rest=output.needs_rest,
                baked_layers=output.layer_names(),
                needs_light=light.needs_light,
                lightmap=lightmap,
                depsgraph=depsgraph,
            )
        self._metres_per_unit = context.scene.unit_settings.scale_length
        self._warnings = refused.lines() + snapshot.notes
        self.order = BakeOrder(snapshot, settings, light, output, lightmap, self._metres_per_unit)
        self._extract_seconds = time.perf_counter() - began
        self._in_child = in_child
        self._run: Run | None = None
        self.is_open = True
        _OPEN.add(self)

    def _start(self) -> None:
        TRACERS.ceiling_bytes = ceiling = cache_ceiling_bytes()
        monitor = JobMonitor(self.order.light.quantity, self.order.lightmap is not None)
        if self._in_child:
            self._run = CHILD.run(self.order, monitor, TRACERS, ceiling)
        else:
            self._run = ThreadRun(self.order, monitor, TRACERS)

    def step(self, budget_s: float) -> bool:
        """Work, or wait, for at most `budget_s` seconds; True once the result is ready to commit.

        Raises
        ------
        ObscuranceError
            What stopped the bake; `BakeCancelledError` after `cancel`.
        """
        try:
            if self._run is None and not self.is_open:
                raise BakeCancelledError("cancelled")
            if self._run is None:
                self._start()
            return self._run.step(budget_s)
        except BaseException:
            self.is_open = False
            raise

    def run(self, on_step: Callable[[BakeJob], None] | None = None) -> BakeReport:
        """Step to the end and commit, for callers that may block; `on_step` is called several times a second."""
        try:
            while not self.step(0.1):
                if on_step is not None:
                    on_step(self)
        except BaseException:
            self.cancel()
            raise
        return self.commit()

    @property
    def progress(self) -> float:
        """Share of the work done, 0 .. 1."""
        return 0.0 if self._run is None else self._run.progress

    @property
    def remaining(self) -> float | None:
        """Estimated seconds left, None while there is nothing to estimate from."""
        return None if self._run is None else self._run.remaining

    def cancel(self) -> None:
        """Stop computing; nothing has been written, and nothing of the bake goes on."""
        self.is_open = False
        if self._run is not None:
            self._run.cancel()

    def commit(self) -> BakeReport:
        """Write the result into the scene, whole or not at all; main thread, after `step` returned True.

        Raises
        ------
        SceneChangedError
            When an object is gone, has other faces than when the bake began, or is in Edit Mode.
        AttributeNameError
            When an attribute cannot be made.
        """
        global _committed
        try:
            report = self._write(self._run.result)
            _committed += 1
        finally:
            self.is_open = False
        return replace(
            report,
            seconds={**report.seconds, "extract": report.seconds["extract"] + self._extract_seconds},
            d_max=report.d_max * self._metres_per_unit,
            warnings=self._warnings + self._run.notes + report.warnings,
        )

    def _write(self, result: BakeResult) -> BakeReport:
        """Write the result, and tell what writing adds to its report."""
        began, order, report = time.perf_counter(), self.order, result.report
        stored, baked = records.what_is_stored(order.light), self.snapshot.baked
        lightmap = None
        if order.lightmap is None:
            notes = write_values(baked, result.values, order.output, stored)
        else:
            written = write_lightmap(baked, result.pages, result.uv, order.output, stored)
            notes = written.notes
            lightmap = replace(report.lightmap, image=written.image, files=written.files)
        return replace(
            report,
            seconds={**report.seconds, "write": time.perf_counter() - began},
            lightmap=lightmap,
            warnings=report.warnings + notes,
        )


def check_destination(
    objects: list[bpy.types.Object], output: OutputSettings, lightmap: LightmapSettings | None
) -> None:
    """Make sure, as far as one can tell before, that the result can be written; raises ObscuranceError."""
    for ob in objects:
        for name, _domain in reversed(output.layers()):  # the name that the user chose comes last
            color_attribute.check_name(ob, name)
        if lightmap is not None and lightmap.uv_mode is UvMode.UNWRAP:
            uv_layer.check_uv_name(ob, output.attribute_name)
    if lightmap is not None:
        color_attribute.check_text(output.attribute_name)
        check_path(output.image_path, output.image_format)


def writable_objects(
    context: bpy.types.Context,
    objects: Iterable[bpy.types.Object],
    notes: Notes,
    depsgraph: bpy.types.Depsgraph | None = None,
) -> list[bpy.types.Object]:
    """Mesh objects with faces that can be written, seen or not; the others are named in notes.

    Raises
    ------
    ObscuranceError
        When there is none, or one is in Edit Mode.
    """
    objects = list(objects)
    edited = [ob.name for ob in objects if ob.type == "MESH" and ob.data.is_editmode]
    if edited:
        raise ObscuranceError(f"in Edit Mode, where a mesh cannot be read: {named(edited)}; leave it (Tab)")
    reasons = [(ob, _unwritable_reason(ob)) for ob in objects]
    writable = [ob for ob, reason in reasons if reason is None]
    refused = [(ob, reason) for ob, reason in reasons if reason is not None]
    if not writable:
        raise nothing_to_bake(context, refused, depsgraph)
    note_refused(refused, notes)
    return writable


def _unwritable_reason(ob: bpy.types.Object) -> Reason | None:
    """Why no values can be written onto an object, None when they can."""
    if ob.type == "MESH" and not color_attribute.keeps_what_is_written(ob.data):
        return _LINKED
    return shape_reason(ob)
