"""A bake into a lightmap: what is computed from a snapshot, and what is written of it."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from ...core.light import LightSettings
from ...core.lightmap import Lightmap, LightmapSettings, bake_light_map, bake_lightmap
from ...core.monitor import Monitor
from ...core.order import (
    ObjectRange,
    OutputSettings,
    Scale,
    SceneSnapshot,
    Target,
    TexelMaterials,
    lay_out,
    prepare_arrays,
)
from ...core.settings import BakeSettings
from ...core.tracing import IntersectorCache
from ..writing import what_is_stored, write_lightmap
from .report import BakeReport, LightmapReport, ambient_report

_PROGRESS_STEPS = 1000  # of unwrapping
_OVERLAPS_TOLD = 6


class LightmapBake:
    """What a bake job does for a lightmap.

    Parameters
    ----------
    snapshot : SceneSnapshot
    settings : BakeSettings
    light : LightSettings
    output : OutputSettings
    lightmap : LightmapSettings
    metres_per_unit : float
    """

    def __init__(
        self,
        snapshot: SceneSnapshot,
        settings: BakeSettings,
        light: LightSettings,
        output: OutputSettings,
        lightmap: LightmapSettings,
        metres_per_unit: float,
    ) -> None:
        self._snapshot, self._settings, self._light, self._output = snapshot, settings, light, output
        self._lightmap, self._metres_per_unit = lightmap, metres_per_unit

    def compute(self, monitor: Monitor, intersector: IntersectorCache) -> None:
        """Everything between reading and writing, without bpy; any thread."""
        began = time.perf_counter()
        self._arrays = arrays = prepare_arrays(self._snapshot, Target.FACE, self._light.needs_light)
        self._extract_seconds = time.perf_counter() - began
        monitor.phase("unwrap", _PROGRESS_STEPS)
        done = 0

        def progress(share: float) -> None:
            nonlocal done
            monitor.advance(int(share * _PROGRESS_STEPS) - done)
            done = int(share * _PROGRESS_STEPS)

        self._laid_out = lay_out(
            self._snapshot,
            arrays.ranges,
            self._lightmap,
            self._metres_per_unit,
            lambda: monitor.advance(0),
            progress,
        )
        layout = self._laid_out.layout
        common = {"monitor": monitor, "intersector": intersector}
        if self._light.needs_light:
            self._result: Lightmap = bake_light_map(
                arrays.surfaces,
                arrays.patches,
                arrays.others,
                arrays.materials,
                self._snapshot.sources,
                layout,
                self._settings,
                self._light,
                self._lightmap,
                factor=2.0**self._output.exposure,
                materials_at=TexelMaterials(
                    [baked.snapshot for baked in self._snapshot.baked], layout, arrays, self._lightmap.size
                ),
                **common,
            )
        else:
            self._result = bake_lightmap(
                arrays.surfaces,
                arrays.patches,
                layout,
                self._settings,
                self._lightmap,
                white=self._output.scale is Scale.WHITE,
                patch_reflectance=arrays.materials.reflectance,
                **common,
            )

    def write(self) -> BakeReport:
        """Write the result into the scene and to the disk, whole or not at all; main thread."""
        began = time.perf_counter()
        result, laid_out = self._result, self._laid_out
        written = write_lightmap(
            self._snapshot.baked, result.pages, laid_out.uv, self._output, what_is_stored(self._light)
        )
        return BakeReport(
            objects=[baked.snapshot.name for baked in self._snapshot.baked],
            patches=result.counts.texels,
            triangles=len(self._arrays.surfaces.triangles),
            rays=result.rays + result.error_rays,
            seconds={
                "extract": self._extract_seconds,
                "unwrap": laid_out.seconds,
                **result.seconds,
                "write": time.perf_counter() - began,
            },
            r_ave=tuple(float(x) for x in result.r_ave),
            rmse=tuple(float(x) for x in result.rmse),
            d_max=result.d_max,
            quantity=self._light.quantity,
            **ambient_report(result),
            lightmap=LightmapReport(
                image=written.image,
                files=written.files,
                size=self._lightmap.size,
                pages=len(result.pages),
                use=result.use,
                traced_texels=result.traced,
                texels_per_metre=laid_out.texels_per_metre,
            ),
            warnings=self._arrays.warnings
            + laid_out.notes
            + result.warnings
            + self._hidden_inside()
            + self._overlaps()
            + written.notes,
        )

    def _hidden_inside(self) -> list[str]:
        """Warnings for objects most of which has no value of its own."""
        warnings, counts = [], self._result.counts
        for baked, part in zip(self._snapshot.baked, self._arrays.ranges, strict=True):
            area, hidden = (float(of[part.first : part.end].sum()) for of in (counts.area, counts.hidden))
            if 2.0 * hidden > area:
                warnings.append(
                    f"object '{baked.snapshot.name}': {hidden / area:.0%} of its surface lies inside of a closed "
                    "solid, so it took its neighbours' value, or that of an open face; if the solid is a room, flip "
                    "its normals (Mesh > Normals > Flip)"
                )
        return warnings

    def _overlaps(self) -> list[str]:
        """A warning that names objects whose faces share texels."""
        pairs: Counter[tuple[str, str]] = Counter()
        for faces, texels in self._result.counts.overlap.items():
            one, other = (self._object_of(face) for face in faces)
            pairs[one, other] += texels
        if not pairs:
            return []
        named = [
            f"'{one}' with itself in {texels:,} texels" if one == other else f"'{one}' with '{other}' in {texels:,}"
            for (one, other), texels in pairs.most_common(_OVERLAPS_TOLD)
        ]
        more = f" and {len(pairs) - _OVERLAPS_TOLD} more pairs" if len(pairs) > _OVERLAPS_TOLD else ""
        return [
            f"faces overlap in the UV map, so they share texels: {', '.join(named)}{more}; let the bake unwrap, or "
            "move them apart"
        ]

    def _object_of(self, face: int) -> str:
        ranges: list[ObjectRange] = self._arrays.ranges
        index = int(np.searchsorted([part.end for part in ranges], face, side="right"))
        return self._snapshot.baked[index].snapshot.name
