"""Faces under the light of a scene, as far as receivers that are no patches need to know: the texels of a lightmap."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..monitor import Monitor
from ..scene import Surfaces
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS
from .ambient import AmbientLight
from .bake import light_warnings
from .direct import LitScene
from .indirect import ambient_of_scene
from .lit_patches import LitPatches, light_up
from .radiosity import gather_form_factors, solve_radiosity
from .records import LightSources, PatchMaterials
from .reflectors import Reflectors
from .settings import LightSettings, Quantity


@dataclass(frozen=True)
class LitFaces:
    """What texels need to know of the light on faces.

    Attributes
    ----------
    lit : LitPatches
    scene : LitScene
        Its cells are those of the faces.
    reflectance, emission : ndarray, (f, 3) float64
        Of the faces to bake.
    r_ave : ndarray, (3,)
    reflectors : Reflectors or None
    ambient : tuple of two AmbientLight, or None
        From independent samples.
    radiosity : ndarray, (p, 3) float64, or None
        Of all faces, W/m^2, to be gathered.
    rays, error_rays : int
    warnings : list of str
    """

    lit: LitPatches
    scene: LitScene
    reflectance: np.ndarray
    emission: np.ndarray
    r_ave: np.ndarray
    warnings: list[str]
    reflectors: Reflectors | None = None
    ambient: tuple[AmbientLight, AmbientLight] | None = None
    radiosity: np.ndarray | None = None
    rays: int = 0
    error_rays: int = 0


def light_up_faces(
    scene: LitScene,
    surfaces: Surfaces,
    n_faces: int,
    materials: PatchMaterials,
    sources: LightSources,
    metres_per_unit: float,
    settings: BakeSettings,
    light: LightSettings,
    monitor: Monitor,
) -> LitFaces:
    """Find what faces scatter and, unless direct light alone is asked for, who passes it on and the ambient light."""
    reflectance, emission = materials.reflectance[:n_faces], materials.emission[:n_faces]
    lit = light_up(
        scene,
        materials,
        np.zeros(0, bool),
        metres_per_unit,
        settings,
        light,
        valid=None,
        monitor=monitor,
        block_rays=BLOCK_RAYS,
    )
    emitted = lit.emitted(sources)
    found = LitFaces(
        lit,
        scene,
        reflectance,
        emission,
        lit.mean_reflectance(surfaces, n_faces),
        light_warnings(lit, emitted, light),
        rays=lit.rays,
        error_rays=lit.error_rays,
    )
    if light.quantity is Quantity.RADIOSITY:
        per_patch = np.full(len(lit.area), settings.rays)
        monitor.phase("radiosity", int(per_patch.sum()))
        factors = gather_form_factors(scene, per_patch, lit.direct.valid, settings, progress=monitor.advance)
        indirect = solve_radiosity(factors, materials.reflectance, lit.unshot, check=lambda: monitor.advance(0))
        return replace(found, radiosity=lit.unshot + indirect, rays=lit.rays + factors.rays)
    if light.quantity is Quantity.DIRECT:
        return found
    reflectors, ambient, rays = ambient_of_scene(lit, found.r_ave, emitted, settings, light, monitor)
    return replace(found, reflectors=reflectors, ambient=ambient, rays=lit.rays + rays)
