"""The work order of a bake: all that is needed between reading a scene and writing its results, and nothing else.

It can be sent to another process, and is carried out alike wherever it is.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import GeometryError
from ..light import BakedLight, LightSettings, bake_light
from ..lightmap import Lightmap, LightmapSettings, bake_light_map, bake_lightmap
from ..monitor import Monitor
from ..notes import Notes, named
from ..obscurance import Obscurances, bake_obscurances, white_warnings
from ..settings import AUTO_DISTANCE_FRACTION, BakeSettings
from ..tracing import Rooms, scene_size
from .arrays import BakeArrays, ObjectRange, prepare_arrays
from .atlas_layout import LaidOut, lay_out
from .output import OutputSettings, Scale, Target
from .report import BakeReport, LightmapReport, ambient_report, reach_report
from .snapshot import SceneSnapshot
from .solid_meshes import snapshot_with_shells
from .texel_materials import TexelMaterials

_PROGRESS_STEPS = 1000  # of unwrapping
_OVERLAPS_TOLD = 6
_FLIP = "if the solid is a room, flip its normals (in Edit Mode, Mesh > Normals > Flip)"
_OUTSIDE = "if they should be seen from outside, turn them (in Edit Mode, Mesh > Normals > Recalculate Outside)"
_AWAY = "if renders should show the side of the scene, flip them (in Edit Mode, Mesh > Normals > Flip)"
_INSIDE = "to bake the faces of these rooms on the inside, flip them (in Edit Mode, Mesh > Normals > Flip)"


@dataclass(frozen=True)
class BakeResult:
    """What was computed for an order.

    Attributes
    ----------
    report : BakeReport
        Without what writing adds.
    values : list of ndarray, (n, 3) float64
        For each baked object, the values of the elements of its unmodified mesh; empty for a lightmap.
    pages : list of ndarray, (size, size, 4) float32
        Of a lightmap.
    uv : list of ndarray, (c, 2) float32, or None
        The UV map of each object that goes with the pages; None where the objects keep theirs.
    """

    report: BakeReport
    values: list[np.ndarray] = field(default_factory=list)
    pages: list[np.ndarray] = field(default_factory=list)
    uv: list[np.ndarray] | None = None


@dataclass(frozen=True)
class BakeOrder:
    """A bake that someone carries out.

    Attributes
    ----------
    snapshot : SceneSnapshot
    settings : BakeSettings
    light : LightSettings
    output : OutputSettings
    lightmap : LightmapSettings or None
        For target LIGHTMAP.
    metres_per_unit : float
        Of the scene, for the density of texels.
    """

    snapshot: SceneSnapshot
    settings: BakeSettings
    light: LightSettings
    output: OutputSettings
    lightmap: LightmapSettings | None = None
    metres_per_unit: float = 1.0

    def carry_out(self, monitor: Monitor, intersector: Callable) -> BakeResult:
        """Compute what is asked for; any thread of any process.

        Parameters
        ----------
        monitor : Monitor
            Hears how far it is, and may stop it.
        intersector : callable
            Builds the ray tracer, as for `bake_obscurances`.

        Raises
        ------
        ObscuranceError
            When it cannot be done; the message names objects and cure. `BakeCancelledError` when the monitor says so.
        """
        began = time.perf_counter()
        try:
            order = replace(self, snapshot=snapshot_with_shells(self.snapshot))
            arrays = prepare_arrays(
                order.snapshot, Target.FACE if self.lightmap else self.output.target, self.light.needs_light
            )
            monitor.advance(0)
            extract = time.perf_counter() - began
            order, reach_from = order._with_distance(arrays)
            carry_out = order._attributes if self.lightmap is None else order._lightmap
            result = carry_out(arrays, extract, monitor, intersector)
            return replace(result, report=replace(result.report, reach_from=reach_from))
        except GeometryError as error:
            raise GeometryError(f"{named(self._names())}: {error}") from error

    def _with_distance(self, arrays: BakeArrays) -> tuple[BakeOrder, str]:
        """This order with a distance in metres, and what an automatic one came from."""
        if self.settings.distance is not None:
            return self, ""
        size = scene_size(arrays.surfaces, arrays.patches)
        distance = AUTO_DISTANCE_FRACTION * size.diagonal
        if not 0.0 < distance < np.inf:
            return self, ""  # which the bake refuses
        names = [ob.name for ob in self.snapshot.objects()]
        return replace(self, settings=replace(self.settings, distance=distance)), reach_report(size, names)

    def _attributes(self, arrays: BakeArrays, extract: float, monitor: Monitor, intersector: Callable) -> BakeResult:
        common = {"neighbours": arrays.neighbours, "monitor": monitor, "intersector": intersector}
        if self.light.needs_light:
            result: Obscurances | BakedLight = bake_light(
                arrays.surfaces,
                arrays.patches,
                arrays.others,
                arrays.materials,
                self.snapshot.sources,
                self.settings,
                self.light,
                **common,
            )
        else:
            result = bake_obscurances(
                arrays.surfaces,
                arrays.patches,
                self.settings,
                patch_reflectance=arrays.materials.seen_reflectance(),
                patch_opacity=arrays.materials.opacity,
                **common,
            )
        values, rmse = self._scaled(result)
        report = BakeReport(
            objects=self._names(),
            patches=len(arrays.patches),
            triangles=len(arrays.surfaces.triangles),
            rays=result.rays + result.error_rays,
            seconds={"extract": extract, **result.seconds},
            r_ave=tuple(float(x) for x in result.r_ave),
            rmse=tuple(float(x) for x in rmse),
            d_max=result.d_max,
            quantity=self.light.quantity,
            **(ambient_report(result) if isinstance(result, BakedLight) else {}),
            warnings=arrays.warnings
            + result.warnings
            + self._white_warnings(result)
            + self._rooms(arrays, result.rooms)
            + self._hidden_patches(arrays.ranges, result.exposed),
        )
        return BakeResult(report, [values[part.first : part.end][part.element_patch] for part in arrays.ranges])

    def _scaled(self, result: Obscurances | BakedLight) -> tuple[np.ndarray, np.ndarray]:
        """What to write (p, 3), and its estimated error (3,)."""
        if isinstance(result, BakedLight):
            factor = 2.0**self.output.exposure
            return result.radiance * factor, result.rmse * factor
        if self.output.scale is Scale.WHITE:
            return result.white, result.white_rmse
        return result.coloured, result.rmse

    def _white_warnings(self, result: Obscurances | BakedLight) -> list[str]:
        """What a white layer cannot show of the colours of this scene."""
        is_white = isinstance(result, Obscurances) and self.output.scale is Scale.WHITE
        return white_warnings(result.scattering) if is_white and self.settings.use_bleeding else []

    def _lightmap(self, arrays: BakeArrays, extract: float, monitor: Monitor, intersector: Callable) -> BakeResult:
        laid_out = self._laid_out(arrays, monitor)
        layout, common = laid_out.layout, {"monitor": monitor, "intersector": intersector}
        if self.light.needs_light:
            result: Lightmap = bake_light_map(
                arrays.surfaces,
                arrays.patches,
                arrays.others,
                arrays.materials,
                self.snapshot.sources,
                layout,
                self.settings,
                self.light,
                self.lightmap,
                factor=2.0**self.output.exposure,
                materials_at=TexelMaterials(
                    [baked.snapshot for baked in self.snapshot.baked], layout, arrays, self.lightmap.size
                ),
                **common,
            )
        else:
            result = bake_lightmap(
                arrays.surfaces,
                arrays.patches,
                layout,
                self.settings,
                self.lightmap,
                white=self.output.scale is Scale.WHITE,
                patch_reflectance=arrays.materials.seen_reflectance(),
                patch_opacity=arrays.materials.opacity,
                **common,
            )
        report = BakeReport(
            objects=self._names(),
            patches=result.counts.texels,
            triangles=len(arrays.surfaces.triangles),
            rays=result.rays + result.error_rays,
            seconds={"extract": extract, "unwrap": laid_out.seconds, **result.seconds},
            r_ave=tuple(float(x) for x in result.r_ave),
            rmse=tuple(float(x) for x in result.rmse),
            d_max=result.d_max,
            quantity=self.light.quantity,
            **ambient_report(result),
            lightmap=LightmapReport(
                image="",
                files=[],
                size=self.lightmap.size,
                pages=len(result.pages),
                use=result.use,
                traced_texels=result.traced,
                texels_per_metre=laid_out.texels_per_metre,
            ),
            warnings=arrays.warnings
            + laid_out.notes
            + result.warnings
            + self._rooms(arrays, result.rooms)
            + self._hidden_texels(arrays.ranges, result)
            + self._overlaps(arrays.ranges, result),
        )
        return BakeResult(report, pages=result.pages, uv=laid_out.uv)

    def _laid_out(self, arrays: BakeArrays, monitor: Monitor) -> LaidOut:
        monitor.phase("unwrap", _PROGRESS_STEPS)
        done = 0

        def progress(share: float) -> None:
            nonlocal done
            monitor.advance(int(share * _PROGRESS_STEPS) - done)
            done = int(share * _PROGRESS_STEPS)

        return lay_out(
            self.snapshot, arrays.ranges, self.lightmap, self.metres_per_unit, lambda: monitor.advance(0), progress
        )

    def _names(self) -> list[str]:
        return [baked.snapshot.name for baked in self.snapshot.baked]

    def _rooms(self, arrays: BakeArrays, rooms: Rooms) -> list[str]:
        """Notes that name the objects to bake that are rooms, or look the wrong way."""
        notes, names, starts = Notes(), self._names(), arrays.surfaces.object_starts
        for what, numbers, cure in (
            ("closed around other objects, so taken for rooms of these", np.unique(rooms.body), _INSIDE),
            ("closed, with all faces looking inwards, so baked inside", rooms.turned, _OUTSIDE),
            ("looking away from the scene, which lies behind their faces", rooms.away, _AWAY),
        ):
            owners = np.searchsorted(starts, numbers - 1, side="right") - 1
            for owner in np.unique(owners[owners < len(names)]):
                notes.add(what, names[owner], cure=cure)
        return notes.lines()

    def _hidden_patches(self, ranges: list[ObjectRange], exposed: np.ndarray) -> list[str]:
        """Warnings for objects most of whose surface, each patch counting alike, has no value of its own."""
        notes = Notes()
        for name, part in zip(self._names(), ranges, strict=True):
            if 2.0 * (1.0 - exposed[part.first : part.end]).sum() > part.end - part.first:
                what = "mostly inside of a closed solid, or without area, so taken from neighbors or as open"
                notes.add(what, name, cure=_FLIP)
        return notes.lines()

    def _hidden_texels(self, ranges: list[ObjectRange], result: Lightmap) -> list[str]:
        """Warnings for objects most of whose surface has no value of its own."""
        notes, counts = Notes(), result.counts
        for name, part in zip(self._names(), ranges, strict=True):
            area, hidden = (float(of[part.first : part.end].sum()) for of in (counts.area, counts.hidden))
            if 2.0 * hidden > area:
                notes.add("mostly inside of a closed solid, so taken from neighbors or as open", name, cure=_FLIP)
        return notes.lines()

    def _overlaps(self, ranges: list[ObjectRange], result: Lightmap) -> list[str]:
        """A warning that names objects whose faces share texels."""
        names, ends = self._names(), [part.end for part in ranges]
        pairs: Counter[tuple[str, str]] = Counter()
        for faces, texels in result.counts.overlap.items():
            one, other = (names[int(np.searchsorted(ends, face, side="right"))] for face in faces)
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
