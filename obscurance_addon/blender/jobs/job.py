"""One bake of some objects of a scene, driven alike by the operator, the command line and scripts.

    job = BakeJob(context, objects, settings, output)
    while not job.step(0.1):
        show(job.progress, job.remaining)
    report = job.commit()

The constructor reads the scene, a thread of its own computes, `commit` writes. Until then nothing of the user's
changes.
"""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Iterable
from dataclasses import replace

import bpy

from ...core.errors import GeometryError, ObscuranceError, SettingsError
from ...core.light import LightSettings, Quantity
from ...core.lightmap import LightmapSettings, UvMode
from ...core.order import OutputSettings, Target
from ...core.settings import BakeSettings
from ...core.tracing import IntersectorCache
from ..reading import snapshot_scene
from ..stored_preferences import cache_ceiling_bytes
from ..writing import check_path, color_attribute, uv_layer
from .attribute_bake import AttributeBake
from .lightmap_bake import LightmapBake
from .monitor import JobMonitor
from .report import BakeReport

_NAMES_IN_ERRORS = 8

TRACERS = IntersectorCache()  # while a user tries settings, the geometry stays
_OPEN: weakref.WeakSet[BakeJob] = weakref.WeakSet()  # jobs that still may write
_committed = 0


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
    ) -> None:
        began = time.perf_counter()
        light = light or LightSettings()
        to_lightmap = output.target is Target.LIGHTMAP
        lightmap = (lightmap or LightmapSettings()) if to_lightmap else None
        if light.quantity is Quantity.RADIOSITY and output.target not in {Target.FACE, Target.LIGHTMAP}:
            raise SettingsError("radiosity is computed for whole faces: use target FACE, or bake COMBINED")
        self._warnings: list[str] = []
        writable = writable_objects(objects, self._warnings)
        check_destination(writable, output, lightmap)
        self.snapshot = snapshot = snapshot_scene(
            context,
            writable,
            needs_rest=output.target in {Target.CORNER, Target.POINT},
            baked_layers=[name for name, _domain in output.layers()],
            needs_light=light.needs_light,
            lightmap=lightmap,
        )
        self._metres_per_unit = context.scene.unit_settings.scale_length
        self._warnings += snapshot.notes
        if lightmap is None:
            self._bake = AttributeBake(snapshot, settings, light, output)
        else:
            self._bake = LightmapBake(snapshot, settings, light, output, lightmap, self._metres_per_unit)
        self._extract_seconds = time.perf_counter() - began
        self._monitor = JobMonitor(light.quantity, to_lightmap)
        TRACERS.ceiling_bytes = cache_ceiling_bytes()
        self._done = False
        self.is_open = True
        _OPEN.add(self)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._compute, name="obscurance-bake", daemon=True)
        self._thread.start()

    def _compute(self) -> None:
        """Everything between reading and writing, without bpy; runs in its own thread."""
        try:
            self._bake.compute(self._monitor, TRACERS)
            self._done = True
        except GeometryError as error:
            names = ", ".join(f"'{baked.snapshot.name}'" for baked in self.snapshot.baked[:_NAMES_IN_ERRORS])
            self._error = GeometryError(f"{names}: {error}")
        except BaseException as error:  # handed to the thread that steps the job
            self._error = error

    def step(self, budget_s: float) -> bool:
        """Wait for at most `budget_s` seconds; True once the result is ready to commit.

        Raises
        ------
        ObscuranceError
            What stopped the bake; `BakeCancelledError` after `cancel`.
        """
        self._thread.join(budget_s)
        if self._thread.is_alive():
            return False
        if self._error is not None:
            self.is_open = False
            raise self._error
        return True

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
        return 1.0 if self._done else self._monitor.progress

    @property
    def remaining(self) -> float | None:
        """Estimated seconds left, None while there is nothing to estimate from."""
        return self._monitor.remaining

    def cancel(self, wait: bool = True) -> None:
        """Stop computing; nothing has been written. Waits for the threads to end, unless told not to."""
        self.is_open = False
        self._monitor.cancelled.set()
        if wait:
            self._thread.join()

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
            report = self._bake.write()
            _committed += 1
        finally:
            self.is_open = False
        return replace(
            report,
            seconds={**report.seconds, "extract": report.seconds["extract"] + self._extract_seconds},
            d_max=report.d_max * self._metres_per_unit,
            warnings=self._warnings + report.warnings,
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


def writable_objects(objects: Iterable[bpy.types.Object], warnings: list[str]) -> list[bpy.types.Object]:
    """Mesh objects whose mesh can be written; the others are named in a warning."""
    objects = list(objects)
    others = [ob.name for ob in objects if ob.type != "MESH"]
    if others:
        warnings.append(f"not a mesh, so nothing was baked onto: {', '.join(map(repr, others))}")
    meshes = [ob for ob in objects if ob.type == "MESH"]
    edited = [ob.name for ob in meshes if ob.data.is_editmode]
    if edited:
        raise ObscuranceError(f"in Edit Mode, where a mesh cannot be read: {', '.join(map(repr, edited))}; leave it")
    linked = [ob.name for ob in meshes if not color_attribute.keeps_what_is_written(ob.data)]
    if linked:
        warnings.append(
            f"linked from a library, so their mesh cannot be written: {', '.join(map(repr, linked))}; make the mesh "
            "local (Object > Relations > Make Local) to bake onto it"
        )
    writable = [ob for ob in meshes if color_attribute.keeps_what_is_written(ob.data)]
    empty = [ob.name for ob in writable if not len(ob.data.polygons)]
    if empty:
        warnings.append(f"without faces, so nothing was baked onto: {', '.join(map(repr, empty))}")
    writable = [ob for ob in writable if len(ob.data.polygons)]
    if not writable:
        raise ObscuranceError("; ".join(["there is nothing to bake: no mesh object with faces", *warnings]))
    return writable
