"""A bake into mesh attributes: what is computed from a snapshot, and what is written of it."""

from __future__ import annotations

import time

import numpy as np

from ...core.light import BakedLight, LightSettings, bake_light
from ...core.monitor import Monitor
from ...core.obscurance import Obscurances, bake_obscurances
from ...core.order import OutputSettings, Scale, SceneSnapshot, prepare_arrays
from ...core.settings import BakeSettings
from ...core.tracing import IntersectorCache
from ..writing import what_is_stored, write_values
from .report import BakeReport, ambient_report


class AttributeBake:
    """What a bake job does for faces, corners and vertices.

    Parameters
    ----------
    snapshot : SceneSnapshot
    settings : BakeSettings
    light : LightSettings
    output : OutputSettings
    """

    def __init__(
        self, snapshot: SceneSnapshot, settings: BakeSettings, light: LightSettings, output: OutputSettings
    ) -> None:
        self._snapshot, self._settings, self._light, self._output = snapshot, settings, light, output

    def compute(self, monitor: Monitor, intersector: IntersectorCache) -> None:
        """Everything between reading and writing, without bpy; any thread."""
        began = time.perf_counter()
        self._arrays = arrays = prepare_arrays(self._snapshot, self._output.target, self._light.needs_light)
        monitor.advance(0)
        self._extract_seconds = time.perf_counter() - began
        common = {"neighbours": arrays.neighbours, "monitor": monitor, "intersector": intersector}
        if self._light.needs_light:
            self._result: Obscurances | BakedLight = bake_light(
                arrays.surfaces,
                arrays.patches,
                arrays.others,
                arrays.materials,
                self._snapshot.sources,
                self._settings,
                self._light,
                **common,
            )
        else:
            self._result = bake_obscurances(
                arrays.surfaces,
                arrays.patches,
                self._settings,
                patch_reflectance=arrays.materials.reflectance,
                **common,
            )

    def write(self) -> BakeReport:
        """Write the result into the scene, whole or not at all; main thread."""
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
            d_max=result.d_max,
            quantity=self._light.quantity,
            **(ambient_report(result) if isinstance(result, BakedLight) else {}),
            warnings=arrays.warnings + result.warnings + self._hidden_inside() + notes,
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
