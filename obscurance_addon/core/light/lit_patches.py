"""All patches of a scene under its direct light: what they receive and scatter, and once more for the error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..monitor import Monitor
from ..sampling import allocate_rays
from ..scene import Surfaces, mean_reflectance
from ..settings import BakeSettings
from .direct import OPENNESS_RAYS, DirectLight, LitScene, gather_direct_light, share_by_area
from .records import LightSources, PatchMaterials
from .settings import LightSettings, Quantity

OTHERS_SAMPLES = 1 << 17  # for each source, shared out by area over the surfaces that are not baked
MAX_OTHER_SAMPLES = 4096  # of them for one patch


@dataclass(frozen=True)
class LitPatches:
    """Direct light on p patches, the first of which are to be baked.

    Attributes
    ----------
    scene : LitScene
    materials : PatchMaterials
    sample : ndarray, (n,) bool
        Patches to bake that are estimated twice, to tell the error; n is their number.
    direct : DirectLight
    unshot : ndarray, (p, 3) float64
        U = R H, the direct light that each patch scatters, W/m^2.
    unshot_again : ndarray, (p, 3) float64
        The same from independent points for the sample and all patches that are not baked; else NaN.
    whole_area, area : ndarray, (p,) float64
        Square metres, of all of each patch and of its part outside of solids.
    rays, error_rays : int
    """

    scene: LitScene
    materials: PatchMaterials
    sample: np.ndarray
    direct: DirectLight
    unshot: np.ndarray
    unshot_again: np.ndarray
    whole_area: np.ndarray
    area: np.ndarray
    rays: int
    error_rays: int

    @property
    def baked(self) -> slice:
        """The patches to bake."""
        return slice(0, len(self.sample))

    def emitted(self, sources: LightSources) -> np.ndarray:
        """What surfaces and lamps emit, (3,) W."""
        return self.whole_area @ self.materials.given(self.materials.emission) + sum(
            lamp.flux() for lamp in sources.lamps
        )

    def opaque_area(self) -> np.ndarray:
        """Area (p,) outside of solids that stops light, square metres."""
        return self.area if self.materials.opacity is None else self.area * self.materials.opacity

    def mean_reflectance(self, surfaces: Surfaces, n: int) -> np.ndarray:
        """R_ave (3,) of the scene's surfaces, of which the first n patches were baked."""
        own = slice(n)
        reflectance, opacity = self.materials.seen_reflectance()[own], self.materials.opacity_of(own)
        return mean_reflectance(surfaces, self.whole_area[own], self.direct.valid[own], reflectance, opacity)

    def unshot_filled(self) -> np.ndarray:
        """`unshot_again` with `unshot` where there is none, (p, 3) float64."""
        return np.where(np.isnan(self.unshot_again), self.unshot, self.unshot_again)

    def sampled_scene(self) -> LitScene:
        """The scene with rays leaving the sample only."""
        chosen = np.zeros(len(self.area), bool)
        chosen[self.baked] = self.sample
        return _leaving_from(self.scene, chosen)


def light_up(
    scene: LitScene,
    materials: PatchMaterials,
    sample: np.ndarray,
    metres_per_unit: float,
    settings: BakeSettings,
    light: LightSettings,
    *,
    valid: np.ndarray | None,
    monitor: Monitor,
    block_rays: int,
) -> LitPatches:
    """Gather direct light on all patches, and once more on those that tell the error.

    Parameters
    ----------
    scene : LitScene
    materials : PatchMaterials
    sample : ndarray, (n,) bool
        Among the patches to bake.
    metres_per_unit : float
        Of normalised coordinates.
    settings : BakeSettings
        Rays of what is baked.
    light : LightSettings
        For radiosity, patches that are not baked have no fewer samples than others.
    valid : ndarray, (n,) float64, or None
        Shares outside of solids where they are known; then openness is asked for too.
    monitor, block_rays
        As for `bake_obscurances`.
    """
    area, n_baked = scene.traced.cells.area, len(sample)
    others = share_by_area(area[n_baked:], OTHERS_SAMPLES, MAX_OTHER_SAMPLES)
    least_for_others = settings.rays if light.quantity is Quantity.RADIOSITY else 0
    per_patch = np.concatenate([allocate_rays(area[:n_baked], settings), np.maximum(others, least_for_others)])
    twice = np.ones(len(area), bool)
    twice[:n_baked] = sample
    openness_rays = 0 if valid is None else 2 * OPENNESS_RAYS  # at most
    passes = len(scene.sources) + 1
    monitor.phase("light", int(passes * (per_patch.sum() + per_patch[twice].sum())) + openness_rays)

    def gather(scene: LitScene, replicate: int) -> DirectLight:
        return gather_direct_light(
            scene,
            per_patch,
            settings,
            valid=valid,
            replicate=replicate,
            progress=monitor.advance,
            block_rays=block_rays,
        )

    direct, again = gather(scene, 0), gather(_leaving_from(scene, twice), 1)
    unshot_again = materials.reflectance * again.irradiance
    unshot_again[~twice] = np.nan
    whole_area = area * metres_per_unit**2
    return LitPatches(
        scene=scene,
        materials=materials,
        sample=sample,
        direct=direct,
        unshot=materials.reflectance * direct.irradiance,
        unshot_again=unshot_again,
        whole_area=whole_area,
        area=whole_area * direct.valid,
        rays=direct.rays,
        error_rays=again.rays,
    )


def _leaving_from(scene: LitScene, chosen: np.ndarray) -> LitScene:
    """The scene with rays leaving some patches (p,) bool only."""
    return replace(scene, traced=replace(scene.traced, cells=scene.traced.cells.of_patches(chosen)))
