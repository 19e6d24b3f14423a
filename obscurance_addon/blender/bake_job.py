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
from collections.abc import Callable, Iterable

import bpy
import numpy as np

from ..core.bake import Obscurances, bake_obscurances
from ..core.errors import GeometryError, ObscuranceError, SettingsError
from ..core.intersector_cache import IntersectorCache
from ..core.light_bake import bake_light
from ..core.light_records import BakedLight
from ..core.light_settings import LightSettings, Quantity
from ..core.settings import BakeSettings
from . import color_attribute
from .bake_arrays import BakeArrays, prepare_arrays
from .bake_report import BakeReport
from .baked_record import what_is_stored
from .job_monitor import JobMonitor
from .output_settings import OutputSettings, Scale, Target
from .result_writer import write_values
from .scene_geometry import snapshot_scene
from .stored_preferences import cache_ceiling_bytes

_NAMES_IN_ERRORS = 8

TRACERS = IntersectorCache()  # while a user tries settings, the geometry stays


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

    Raises
    ------
    ObscuranceError
        When nothing can be baked, or the attribute name cannot be used; the message names object and cure.
    """

    def __init__(
        self,
        context: bpy.types.Context,
        objects: Iterable[bpy.types.Object],
        settings: BakeSettings,
        output: OutputSettings,
        light: LightSettings | None = None,
    ) -> None:
        began = time.perf_counter()
        light = light or LightSettings()
        if light.quantity is Quantity.RADIOSITY and output.target is not Target.FACE:
            raise SettingsError("radiosity is computed for whole faces: use target FACE, or bake COMBINED")
        self._output = output
        self._light = light
        self._settings = settings
        self._warnings: list[str] = []
        writable = _writable(objects, self._warnings)
        for ob in writable:
            for name, _domain in reversed(output.layers()):  # the name that the user chose comes last
                color_attribute.check_name(ob, name)
        self._snapshot = snapshot_scene(
            context,
            writable,
            needs_rest=output.target is not Target.FACE,
            baked_layers=[name for name, _domain in output.layers()],
            needs_light=light.needs_light,
        )
        self._metres_per_unit = context.scene.unit_settings.scale_length
        self._warnings += self._snapshot.notes
        self._extract_seconds = time.perf_counter() - began
        self._monitor = JobMonitor(light.quantity)
        TRACERS.ceiling_bytes = cache_ceiling_bytes()
        self._arrays: BakeArrays | None = None
        self._result: Obscurances | BakedLight | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._compute, name="obscurance-bake", daemon=True)
        self._thread.start()

    def _compute(self) -> None:
        """Everything between reading and writing, without bpy; runs in its own thread."""
        try:
            began = time.perf_counter()
            self._arrays = prepare_arrays(self._snapshot, self._output.target, self._light.needs_light)
            self._monitor.check()
            self._extract_seconds += time.perf_counter() - began
            self._result = self._bake_light() if self._light.needs_light else self._bake_obscurances()
        except GeometryError as error:
            names = ", ".join(f"'{baked.snapshot.name}'" for baked in self._snapshot.baked[:_NAMES_IN_ERRORS])
            self._error = GeometryError(f"{names}: {error}")
        except BaseException as error:  # handed to the thread that steps the job
            self._error = error

    def _bake_obscurances(self) -> Obscurances:
        arrays = self._arrays
        return bake_obscurances(
            arrays.surfaces,
            arrays.patches,
            self._settings,
            neighbours=arrays.neighbours,
            patch_reflectance=arrays.materials.reflectance,
            monitor=self._monitor,
            intersector=TRACERS,
        )

    def _bake_light(self) -> BakedLight:
        arrays = self._arrays
        return bake_light(
            arrays.surfaces,
            arrays.patches,
            arrays.others,
            arrays.materials,
            self._snapshot.sources,
            self._settings,
            self._light,
            neighbours=arrays.neighbours,
            monitor=self._monitor,
            intersector=TRACERS,
        )

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
        return 1.0 if self._result is not None else self._monitor.progress

    @property
    def remaining(self) -> float | None:
        """Estimated seconds left, None while there is nothing to estimate from."""
        return self._monitor.remaining

    def cancel(self, wait: bool = True) -> None:
        """Stop computing; nothing has been written. Waits for the threads to end, unless told not to."""
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
        began = time.perf_counter()
        result, arrays = self._result, self._arrays
        values, rmse = self._values()
        per_object = [values[r.first : r.end][r.element_patch] for r in arrays.ranges]
        notes = write_values(self._snapshot.baked, per_object, self._output, what_is_stored(self._light))
        seconds = {"extract": self._extract_seconds, **result.seconds, "write": time.perf_counter() - began}
        return BakeReport(
            objects=[baked.snapshot.name for baked in self._snapshot.baked],
            patches=len(arrays.patches),
            triangles=len(arrays.surfaces.triangles),
            rays=result.rays + result.error_rays,
            seconds=seconds,
            r_ave=tuple(float(x) for x in result.r_ave),
            rmse=tuple(float(x) for x in rmse),
            d_max=result.d_max * self._metres_per_unit,
            quantity=self._light.quantity,
            **_ambient_report(result),
            warnings=self._warnings + arrays.warnings + result.warnings + self._hidden_inside() + notes,
        )

    def _values(self) -> tuple[np.ndarray, np.ndarray]:
        """What to write (p, 3), and its estimated error (3,)."""
        result = self._result
        if isinstance(result, BakedLight):
            factor = 2.0**self._output.exposure
            return result.radiance * factor, result.rmse * factor
        if self._output.scale is Scale.WHITE:
            return result.white(), result.white_rmse()
        return result.coloured, result.rmse

    def _hidden_inside(self) -> list[str]:
        """Warnings for objects most of which has no value of its own."""
        warnings = []
        for baked, part in zip(self._snapshot.baked, self._arrays.ranges, strict=True):
            valid = self._result.valid[part.first : part.end]
            hidden = np.count_nonzero(~valid)
            if 2 * hidden > len(valid):
                warnings.append(
                    f"object '{baked.snapshot.name}': {hidden:,} of {len(valid):,} patches lie inside of a closed "
                    "solid or have no area, so they took their neighbours' value, or that of an open face; if the "
                    "solid is a room, flip its normals (Mesh > Normals > Flip)"
                )
        return warnings


def _ambient_report(result: Obscurances | BakedLight) -> dict[str, object]:
    """What a report says of the ambient light, where there is any."""
    if not isinstance(result, BakedLight) or result.ambient is None:
        return {}
    return {
        "ambient_light": tuple(float(x) for x in result.ambient.intensity()),
        "openness": result.ambient.openness,
        "reflectors": result.reflectors,
        "reflected_share": result.reflected_share,
    }


def _writable(objects: Iterable[bpy.types.Object], warnings: list[str]) -> list[bpy.types.Object]:
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
