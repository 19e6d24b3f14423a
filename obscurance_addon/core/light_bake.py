"""One bake of light: direct light, the ambient term with the obscurances, and radiosity to compare with.

Every step is a function of its own elsewhere; here they come in order, with the bookkeeping of what is unshot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .ambient import AmbientLight, ambient_from_emission, ambient_from_received, mean_reflectance
from .bake import Obscurances, error_sample, half_difference, obscurances_in
from .direct_light import OPENNESS_RAYS, DirectLight, LitScene, gather_direct_light, share_by_area
from .embree import EmbreeIntersector
from .emissive_triangles import EmissiveTriangles
from .errors import GeometryError
from .filling import fill_invalid
from .light_records import BakedLight, LightSources, PatchMaterials
from .light_settings import Ambient, LightSettings, Quantity
from .monitor import Monitor
from .patch_samples import BLOCK_RAYS
from .patches import Patches, Surfaces, prepare_cells
from .radiosity import check_size, gather_form_factors, solve_radiosity
from .ray_allocation import allocate_rays
from .ray_casting import Intersector
from .reflector_choice import Reflectors, choose_reflectors
from .scene_building import build_scene
from .secondary_reflectors import redistribute, sample_receivers
from .settings import BakeSettings

OTHERS_SAMPLES = 1 << 17  # for each source, shared out by area over the surfaces that are not baked
MAX_OTHER_SAMPLES = 4096  # of them for one patch
ERROR_RECEIVERS = 256  # patches that receive redistributed light twice, which fixes the error to 6 %

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
        All that rays can hit, with emission; for RADIOSITY with the patch of each triangle, counted over both sets.
    patches : Patches
        To bake.
    others : Patches
        All other surfaces that scatter light, cut up; may be empty.
    materials : PatchMaterials
    sources : LightSources
    settings : BakeSettings
    light : LightSettings
    neighbours, monitor, intersector, block_rays
        As for `bake.bake_obscurances`.

    Raises
    ------
    GeometryError
        When there is nothing to bake, or too much for radiosity.
    BakeCancelledError
        When the monitor says so.
    """
    if not len(patches):
        raise GeometryError("there is no face to bake")
    bake = _LightBake(surfaces, patches, others, materials, sources, settings, light, monitor or Monitor(), block_rays)
    return bake.run(neighbours, intersector)


@dataclass
class _LightBake:
    """The state of one bake: what `bake_light` was given, then geometry, direct light, what is unshot."""

    surfaces: Surfaces
    patches: Patches
    others: Patches
    materials: PatchMaterials
    sources: LightSources
    settings: BakeSettings
    light: LightSettings
    monitor: Monitor
    block_rays: int

    def __post_init__(self) -> None:
        self.n = len(self.patches)
        self.rays = self.error_rays = 0
        self.reflectors: Reflectors | None = None

    def run(
        self, neighbours: tuple[np.ndarray, np.ndarray] | None, intersector: Callable[..., Intersector]
    ) -> BakedLight:
        """All steps in order."""
        began = time.perf_counter()
        quantity = self.light.quantity
        if quantity is Quantity.RADIOSITY:  # before anything that takes long
            check_size(self.n + len(self.others), self.settings.ray_budget or self.settings.rays * self.n)
        self._build(intersector)
        if quantity is Quantity.RADIOSITY:
            check_size(self.n + len(self.others), int(self._form_factor_rays().sum()))
        built = time.perf_counter()
        obscurances = None
        if quantity in _WITH_AMBIENT:
            obscurances = self._obscurances(neighbours)
        traced = time.perf_counter()
        self._light_up(obscurances)
        warnings = self._lamp_warnings() + (obscurances.warnings if obscurances else [])
        values, again, ambient = {
            Quantity.DIRECT: lambda _: self._direct(),
            Quantity.AMBIENT: self._with_ambient,
            Quantity.COMBINED: self._with_ambient,
            Quantity.RADIOSITY: lambda _: self._radiosity(),
        }[quantity](obscurances)
        valid = self.direct.valid[: self.n] > 0.0
        again[~valid] = np.nan
        rmse = half_difference(values, again)
        fill_invalid(values, valid, np.zeros(3), neighbours)
        return BakedLight(
            radiance=values / np.pi,
            rmse=rmse / np.pi,
            exposed=self.direct.valid[: self.n],
            r_ave=obscurances.r_ave if obscurances else self._mean_reflectance(),
            d_max=self.d_max,
            rays=self.rays,
            error_rays=self.error_rays,
            ambient=ambient,
            reflectors=len(self.reflectors) if self.reflectors else 0,
            reflected_share=self.reflectors.light_share if self.reflectors else 0.0,
            seconds={"build": built - began, "trace": traced - built, "light": time.perf_counter() - traced},
            warnings=warnings,
        )

    def _build(self, intersector: Callable[..., Intersector]) -> None:
        traced, self.normalisation, self.d_max = build_scene(
            self.surfaces, self.patches, self.settings, self.monitor, intersector, whole=True
        )
        self.baked = traced
        everything = self.patches.with_others(self.others)
        cells = prepare_cells(everything, self.normalisation, self.settings.thread_count())
        emitters = EmissiveTriangles(traced.surfaces) if (traced.surfaces.emission > 0.0).any() else None
        self.scene = LitScene(
            replace(traced, cells=cells),
            everything.ids,
            tuple(lamp.normalised(self.normalisation) for lamp in self.sources.lamps),
            emitters,
            np.asarray(self.sources.world, np.float64),
        )
        self.sample = error_sample(self.patches.ids)
        self.whole_area = cells.area * self.normalisation.scale**2

    def _obscurances(self, neighbours: tuple[np.ndarray, np.ndarray] | None) -> Obscurances:
        found = obscurances_in(
            self.baked,
            self.normalisation,
            self.d_max,
            self.surfaces,
            self.patches.ids,
            self.settings,
            neighbours=neighbours,
            patch_reflectance=self.materials.reflectance[: self.n],
            monitor=self.monitor,
            block_rays=self.block_rays,
        )
        self.rays += found.rays
        self.error_rays += found.error_rays
        return found

    def _light_up(self, obscurances: Obscurances | None) -> None:
        """Direct light on all patches, and once more on the sample that tells the error."""
        per_patch = self._samples_per_patch()
        chosen = np.ones(len(per_patch), bool)
        chosen[: self.n] = self.sample
        passes = len(self.scene.sources) + 1
        openness_rays = 0 if obscurances is None else 2 * OPENNESS_RAYS  # at most
        self.monitor.phase("light", int(passes * (per_patch.sum() + per_patch[chosen].sum())) + openness_rays)

        def gather(scene: LitScene, **changes: object) -> DirectLight:
            return gather_direct_light(
                scene,
                per_patch,
                self.settings,
                valid=None if obscurances is None else obscurances.sums.valid,
                progress=self.monitor.advance,
                block_rays=self.block_rays,
                **changes,
            )

        self.direct = gather(self.scene)
        cells = self.scene.traced.cells.of_patches(chosen)
        self.again = gather(replace(self.scene, traced=replace(self.scene.traced, cells=cells)), replicate=1)
        self.rays += self.direct.rays
        self.error_rays += self.again.rays
        self.area = self.whole_area * self.direct.valid
        self.unshot = self.materials.reflectance * self.direct.irradiance
        self.unshot_again = self.materials.reflectance * self.again.irradiance
        self.unshot_again[~chosen] = np.nan

    def _samples_per_patch(self) -> np.ndarray:
        """(p,) int: as the settings say for what is baked; others share a budget by area, for what they scatter."""
        area = self.scene.traced.cells.area
        own = allocate_rays(area[: self.n], self.settings)
        if not len(self.others):
            return own
        others = share_by_area(area[self.n :], OTHERS_SAMPLES, MAX_OTHER_SAMPLES)
        if self.light.quantity is Quantity.RADIOSITY:
            others = np.maximum(others, self.settings.rays)
        return np.concatenate([own, others])

    def _direct(self) -> tuple[np.ndarray, np.ndarray, None]:
        return self.unshot[: self.n].copy(), self.unshot_again[: self.n], None

    def _with_ambient(self, obscurances: Obscurances) -> tuple[np.ndarray, np.ndarray, AmbientLight]:
        """Indirect light, with COMBINED all other light too; radiosities, W/m^2."""
        reflectance = self.materials.reflectance[: self.n]
        values, again, left, left_again = self._redistribute()
        ambient, ambient_again = (self._ambient(obscurances.r_ave, flux) for flux in (left, left_again))
        values += reflectance * obscurances.white() * ambient.irradiance
        again += reflectance * obscurances.white_again() * ambient_again.irradiance
        if self.light.quantity is Quantity.COMBINED:
            emission = self.materials.emission[: self.n]
            values += self.unshot[: self.n] + emission
            again += self.unshot_again[: self.n] + emission
        return values, again, ambient

    def _redistribute(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What reflectors pass on to the patches to bake (p, 3) W/m^2, and the unshot flux left (3,) W; each twice."""
        unshot_again = np.where(np.isnan(self.unshot_again), self.unshot, self.unshot_again)
        flux, flux_again = self.area @ self.unshot, self.area @ unshot_again
        nothing = np.zeros((self.n, 3))
        reflectance = self.materials.reflectance
        self.reflectors = choose_reflectors(
            self.scene.traced.cells, self.unshot, self.area, reflectance, self.light.reflectors
        )
        if self.reflectors is None:
            return nothing, nothing.copy(), flux, flux_again
        receivers, weight = sample_receivers(self.n, self.area, reflectance, self.settings.seed)
        sampled = np.flatnonzero(self.sample)[:ERROR_RECEIVERS]
        self.monitor.phase("redistribute", len(receivers) + len(sampled))

        def pass_on(patches: np.ndarray, unshot: np.ndarray, replicate: int) -> tuple[np.ndarray, int]:
            found = redistribute(
                self.scene,
                self.reflectors,
                unshot,
                self.direct.valid,
                patches,
                self.settings,
                replicate=replicate,
                progress=self.monitor.advance,
            )
            return reflectance[patches] * found.irradiance, found.rays

        scattered, rays = pass_on(receivers, self.unshot, 0)
        self.rays += rays
        again = np.full((self.n, 3), np.nan)
        again[sampled], rays = pass_on(sampled, unshot_again, 1)
        self.error_rays += rays
        chosen = self.reflectors.is_chosen
        arrived = (weight * self.area[receivers]) @ scattered
        left = flux - self.area[chosen] @ self.unshot[chosen] + arrived
        left_again = flux_again - self.area[chosen] @ unshot_again[chosen] + arrived
        return scattered[: self.n], again, np.maximum(left, 0.0), np.maximum(left_again, 0.0)

    def _ambient(self, r_ave: np.ndarray, left: np.ndarray) -> AmbientLight:
        """The ambient light once `left` (3,) W of the scattered direct light is unshot."""
        area = self.area.sum()
        openness = float(np.clip(1.0 - self.area @ self.direct.hit_share / area, 0.0, 1.0)) if area > 0.0 else 0.0
        if not area > 0.0:
            irradiance = np.zeros(3)
        elif self.light.ambient is Ambient.EMISSION:
            scattered = self.area @ self.unshot
            share = np.where(scattered > 0.0, left / np.where(scattered > 0.0, scattered, 1.0), 1.0)
            irradiance = ambient_from_emission(self._emitted(), area, r_ave) * share
        else:
            irradiance = ambient_from_received(left, area, r_ave, openness)
        return AmbientLight(irradiance, r_ave, openness, self.settings.use_bleeding)

    def _radiosity(self) -> tuple[np.ndarray, np.ndarray, None]:
        """All light by radiosity, or its indirect part; W/m^2."""
        reflectance = self.materials.reflectance
        per_patch = self._form_factor_rays()
        self.monitor.phase("radiosity", int(per_patch.sum() + per_patch[: self.n][self.sample].sum()))

        def factors(scene: LitScene, replicate: int) -> object:
            return gather_form_factors(
                scene,
                per_patch,
                self.direct.valid,
                self.settings,
                replicate=replicate,
                progress=self.monitor.advance,
                block_rays=self.block_rays,
            )

        found = factors(self.scene, 0)
        self.rays += found.rays
        indirect = solve_radiosity(found, reflectance, self.unshot, check=lambda: self.monitor.advance(0))
        chosen = np.zeros(len(reflectance), bool)
        chosen[: self.n] = self.sample
        cells = self.scene.traced.cells.of_patches(chosen)
        second = factors(replace(self.scene, traced=replace(self.scene.traced, cells=cells)), 1)
        self.error_rays += second.rays
        again = (reflectance * second.gather(self.unshot + indirect))[: self.n]
        again[~self.sample] = np.nan
        values = indirect[: self.n].copy()
        if not self.light.indirect_only:
            values += self.unshot[: self.n] + self.materials.emission[: self.n]
            again += self.unshot_again[: self.n] + self.materials.emission[: self.n]
        return values, again, None

    def _form_factor_rays(self) -> np.ndarray:
        """(p,) int: rays for a row of form factors."""
        own = allocate_rays(self.scene.traced.cells.area[: self.n], self.settings)
        return np.concatenate([own, np.full(len(self.others), self.settings.rays, np.int64)])

    def _mean_reflectance(self) -> np.ndarray:
        return mean_reflectance(
            self.surfaces,
            self.whole_area[: self.n],
            self.direct.valid[: self.n],
            self.materials.reflectance[: self.n],
        )

    def _lamp_warnings(self) -> list[str]:
        """What the user should know about the light."""
        warnings = []
        unreached = [name for name in self.direct.unreached if name != EmissiveTriangles.name]
        if unreached:
            warnings.append(
                f"lights that reach no surface: {', '.join(map(repr, unreached))}; if one is inside of a wall or lamp "
                "housing, move it out"
            )
        if not self.scene.sources and not self.scene.world.any():
            warnings.append("nothing shines on the scene, so its light is black: add a light, or bake OBSCURANCE")
        from_emission = self.light.ambient is Ambient.EMISSION and self.light.quantity in _WITH_AMBIENT
        if from_emission and self.unshot.any() and not self._emitted().any():
            warnings.append(
                "ambient light is computed from what is emitted, but what shines (sun, world) has no known power, so "
                "ambient light is black: use ambient light RECEIVED"
            )
        return warnings

    def _emitted(self) -> np.ndarray:
        """Flux of lamps and surfaces, (3,) W."""
        return self.whole_area @ self.materials.emission + sum(lamp.flux() for lamp in self.sources.lamps)
