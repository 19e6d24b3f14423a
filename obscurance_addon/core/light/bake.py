"""One bake of light: direct light, the ambient term with the obscurances, and radiosity to compare with.

Every step is a function of its own elsewhere; here they come in order.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..monitor import Monitor
from ..notes import named
from ..obscurance import error_sample, half_difference, obscurances_in
from ..sampling import allocate_rays
from ..scene import Normalisation, Patches, Surfaces, fill_invalid, prepare_cells, usable_triangles
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, BuiltScene, EmbreeIntersector, Intersector, build_scene
from .direct import LitScene
from .emitters import EmissiveTriangles
from .indirect import IndirectLight, light_by_obscurances, light_by_radiosity
from .lit_patches import LitPatches, light_up
from .radiosity import check_size
from .records import BakedLight, LightSources, PatchMaterials
from .settings import Ambient, LightSettings, Quantity

_WITH_AMBIENT = (Quantity.AMBIENT, Quantity.COMBINED)


def bake_light(
    surfaces: Surfaces,
    patches: Patches,
    others: Patches,
    materials: PatchMaterials,
    sources: LightSources,
    settings: BakeSettings,
    light: LightSettings,
    *,
    neighbours: tuple[np.ndarray, np.ndarray] | None = None,
    monitor: Monitor | None = None,
    intersector: Callable[..., Intersector] = EmbreeIntersector,
    block_rays: int = BLOCK_RAYS,
) -> BakedLight:
    """Compute the light that leaves patches.

    Parameters
    ----------
    surfaces : Surfaces
        All that rays can hit, with emission if any shines; for RADIOSITY with the patch of each triangle, counted over
        both sets.
    patches : Patches
        To bake.
    others : Patches
        All other surfaces that scatter light, cut up; may be empty.
    materials : PatchMaterials
    sources : LightSources
    settings : BakeSettings
    light : LightSettings
    neighbours, monitor, intersector, block_rays
        As for `bake_obscurances`.

    Raises
    ------
    GeometryError
        When there is nothing to bake, or too much for radiosity.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    quantity, n_baked = light.quantity, len(patches)
    if quantity is Quantity.RADIOSITY:
        check_size(
            n_baked + len(others), len(others) * settings.rays + (settings.ray_budget or settings.rays * n_baked)
        )
    began = time.perf_counter()
    bare = build_scene(surfaces, patches, settings, monitor, intersector, whole=True)
    scene = lit_scene(bare, surfaces, patches.with_others(others), sources, settings)
    built = time.perf_counter()
    obscurances = None
    if quantity in _WITH_AMBIENT:
        obscurances = obscurances_in(
            bare,
            surfaces,
            patches.ids,
            settings,
            neighbours=neighbours,
            patch_reflectance=materials.seen_reflectance()[:n_baked],
            patch_opacity=materials.opacity_of(slice(n_baked)),
            monitor=monitor,
            block_rays=block_rays,
        )
    obscured = time.perf_counter()
    lit = light_up(
        scene,
        materials,
        error_sample(patches.ids),
        bare.normalisation.scale,
        settings,
        light,
        valid=None if obscurances is None else obscurances.sums.valid,
        monitor=monitor,
        block_rays=block_rays,
    )
    emitted = lit.emitted(sources)
    indirect = None
    if obscurances is not None:
        indirect = light_by_obscurances(lit, obscurances, emitted, settings, light, monitor)
    elif quantity is Quantity.RADIOSITY:
        own = allocate_rays(scene.traced.cells.area[:n_baked], settings)
        per_patch = np.concatenate([own, np.full(len(others), settings.rays, np.int64)])
        indirect = light_by_radiosity(lit, per_patch, settings, monitor, block_rays)
    values, again = _sum_up(lit, indirect, light)
    exposed = lit.direct.valid[:n_baked]
    again[exposed == 0.0] = np.nan
    rmse = half_difference(values, again)
    fill_invalid(values, exposed > 0.0, np.zeros(3), neighbours)
    parts = [part for part in (obscurances, lit, indirect) if part is not None]
    reflectors = indirect.reflectors if indirect else None
    r_ave = obscurances.r_ave if obscurances else lit.mean_reflectance(surfaces, n_baked)
    return BakedLight(
        radiance=values / np.pi,
        rmse=rmse / np.pi,
        exposed=exposed,
        r_ave=r_ave,
        d_max=bare.d_max,
        rays=sum(part.rays for part in parts),
        error_rays=sum(part.error_rays for part in parts),
        ambient=indirect.ambient if indirect else None,
        reflectors=len(reflectors) if reflectors else 0,
        reflected_share=reflectors.light_share if reflectors else 0.0,
        seconds={"build": built - began, "trace": obscured - built, "light": time.perf_counter() - obscured},
        warnings=light_warnings(lit, emitted, light) + (obscurances.warnings if obscurances else []),
        rooms=bare.rooms,
    )


def lit_scene(
    scene: BuiltScene, surfaces: Surfaces, patches: Patches, sources: LightSources, settings: BakeSettings
) -> LitScene:
    """The traced scene with rays leaving all patches, and its light in normalised coordinates."""
    traced, normalisation = scene.traced, scene.normalisation
    cells = prepare_cells(patches, normalisation, settings.thread_count())
    unmet = _unmet_emitters(surfaces, normalisation)
    emission = traced.surfaces.emission
    shines = emission is not None and (unmet is not None or (emission > 0.0).any())
    emitters = EmissiveTriangles(traced.surfaces, unmet) if shines else None
    lamps = tuple(lamp.normalised(normalisation) for lamp in sources.lamps)
    rooms = None if patches.shell is None else scene.rooms.of(patches.shell)
    return LitScene(
        replace(traced, cells=cells, rooms=rooms), patches.ids, lamps, emitters, np.asarray(sources.world, np.float64)
    )


def _unmet_emitters(surfaces: Surfaces, normalisation: Normalisation) -> Surfaces | None:
    """The triangles that shine although no ray meets them, normalised; None where there is none."""
    if surfaces.occludes is None or surfaces.emission is None:
        return None
    unmet = np.flatnonzero(~surfaces.occludes & (surfaces.emission > 0.0).any(1))
    vertices = normalisation.apply(surfaces.vertices)
    unmet = unmet[usable_triangles(vertices, surfaces.triangles[unmet])[0]]
    return surfaces.only(unmet, vertices) if len(unmet) else None


def _sum_up(lit: LitPatches, indirect: IndirectLight | None, light: LightSettings) -> tuple[np.ndarray, np.ndarray]:
    """Radiosity of the quantity asked for (n, 3) W/m^2, twice."""
    direct, direct_again = lit.unshot[lit.baked], lit.unshot_again[lit.baked]
    if indirect is None:
        return direct.copy(), direct_again.copy()
    values, again = indirect.radiosity.copy(), indirect.again.copy()
    everything = light.quantity is Quantity.COMBINED or (
        light.quantity is Quantity.RADIOSITY and not light.indirect_only
    )
    if everything:
        emission = lit.materials.emission[lit.baked]
        values += direct + emission
        again += direct_again + emission
    return values, again


def light_warnings(lit: LitPatches, emitted: np.ndarray, light: LightSettings) -> list[str]:
    """What the user should know about the light; `emitted` (3,) W by lamps and surfaces."""
    warnings = []
    unreached = [name for name in lit.direct.unreached if name != EmissiveTriangles.name]
    if unreached:
        cure = "if one is inside of a wall or lamp housing, move it out"
        warnings.append(f"lights that reach no surface: {named(unreached)}; {cure}")
    if not lit.scene.sources and not lit.scene.world.any():
        warnings.append("nothing shines on the scene, so its light is black: add a light, or bake OBSCURANCE")
    if light.quantity is Quantity.RADIOSITY and lit.scene.traced.transparency is not None:
        warnings.append("radiosity takes transparent faces for opaque ones: bake COMBINED, or hide them from renders")
    from_emission = light.ambient is Ambient.EMISSION and light.quantity in _WITH_AMBIENT
    if from_emission and lit.unshot.any() and not emitted.any():
        warnings.append(
            "ambient light is computed from what is emitted, but what shines (sun, world) has no known power, so "
            "ambient light is black: use ambient light RECEIVED"
        )
    return warnings
