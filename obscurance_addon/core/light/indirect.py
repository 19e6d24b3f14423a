"""Indirect light on patches to bake, from what all patches scatter: by obscurances, or by radiosity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..monitor import Monitor
from ..obscurance import Obscurances
from ..settings import BakeSettings
from .ambient import AmbientLight, ambient_from_emission, ambient_from_received
from .lit_patches import LitPatches
from .radiosity import gather_form_factors, solve_radiosity
from .redistribution import redistribute, sample_receivers
from .reflectors import Reflectors, choose_reflectors
from .settings import Ambient, LightSettings

ERROR_RECEIVERS = 256  # patches that receive redistributed light twice, which fixes the error to 6 %

ERROR_TOLERANCE = 0.02  # relative, of what the error of direct light makes of radiosity


@dataclass(frozen=True)
class IndirectLight:
    """Indirect light of n patches.

    Attributes
    ----------
    radiosity : ndarray, (n, 3) float64
        W/m^2.
    again : ndarray, (n, 3) float64
        The same from independent points for some patches; else NaN.
    rays, error_rays : int
    ambient : AmbientLight or None
    reflectors : Reflectors or None
    """

    radiosity: np.ndarray
    again: np.ndarray
    rays: int
    error_rays: int
    ambient: AmbientLight | None = None
    reflectors: Reflectors | None = None


def ambient_of_scene(
    lit: LitPatches,
    r_ave: np.ndarray,
    emitted: np.ndarray,
    settings: BakeSettings,
    light: LightSettings,
    monitor: Monitor,
) -> tuple[Reflectors | None, tuple[AmbientLight, AmbientLight], int]:
    """Who passes light on and the ambient light that is left, where no patch is to be baked: for other receivers.

    Returns
    -------
    reflectors : Reflectors or None
    ambient : tuple of two AmbientLight
        From independent samples.
    rays : int
    """
    passed = _pass_on(lit, settings, light, monitor)
    one, other = (_ambient(lit, r_ave, left, emitted, settings, light) for left in passed.left)
    return passed.reflectors, (one, other), passed.rays


def light_by_obscurances(
    lit: LitPatches,
    obscurances: Obscurances,
    emitted: np.ndarray,
    settings: BakeSettings,
    light: LightSettings,
    monitor: Monitor,
) -> IndirectLight:
    """R w H_A (see `AmbientLight`) and what reflectors pass on; `emitted` (3,) W is the flux of all sources."""
    reflectance = lit.materials.reflectance
    passed = _pass_on(lit, settings, light, monitor)
    ambient, ambient_again = (_ambient(lit, obscurances.r_ave, left, emitted, settings, light) for left in passed.left)
    own = reflectance[lit.baked]
    return IndirectLight(
        radiosity=passed.radiosity + own * obscurances.relative() * ambient.irradiance,
        again=passed.again + own * obscurances.relative_again() * ambient_again.irradiance,
        rays=passed.rays,
        error_rays=passed.error_rays,
        ambient=ambient,
        reflectors=passed.reflectors,
    )


def light_by_radiosity(
    lit: LitPatches, per_patch: np.ndarray, settings: BakeSettings, monitor: Monitor, block_rays: int
) -> IndirectLight:
    """The reference: I = R F (U + I), with `per_patch` (p,) rays for the rows of F."""
    sample, reflectance = lit.sample, lit.materials.reflectance
    monitor.phase("radiosity", int(per_patch.sum() + per_patch[lit.baked][sample].sum()))
    progress = {"progress": monitor.advance, "block_rays": block_rays}
    factors = gather_form_factors(lit.scene, per_patch, lit.direct.valid, settings, **progress)
    unshot_again = lit.unshot_filled()
    indirect = solve_radiosity(factors, reflectance, lit.unshot, check=lambda: monitor.advance(0))
    change = solve_radiosity(factors, reflectance, unshot_again - lit.unshot, tolerance=ERROR_TOLERANCE)
    second = gather_form_factors(lit.sampled_scene(), per_patch, lit.direct.valid, settings, replicate=1, **progress)
    again = (reflectance * second.gather(unshot_again + indirect + change))[lit.baked]
    again[~sample] = np.nan
    return IndirectLight(indirect[lit.baked].copy(), again, factors.rays, second.rays)


@dataclass(frozen=True)
class _Passed:
    """What reflectors passed on to the patches to bake (n, 3) W/m^2, and the unshot flux left (3,) W; each twice."""

    radiosity: np.ndarray
    again: np.ndarray
    left: tuple[np.ndarray, np.ndarray]
    rays: int = 0
    error_rays: int = 0
    reflectors: Reflectors | None = None


def _pass_on(lit: LitPatches, settings: BakeSettings, light: LightSettings, monitor: Monitor) -> _Passed:
    """Let the most important reflectors shoot what they scatter, and keep the books of what is unshot."""
    reflectance, area, n_baked = lit.materials.reflectance, lit.materials.given(lit.area), len(lit.sample)
    unshot, unshot_again = lit.unshot, lit.unshot_filled()
    reflectors = choose_reflectors(lit.scene.traced.cells, unshot, area, reflectance, light.reflectors)
    if reflectors is None:
        nothing = np.zeros((n_baked, 3))
        return _Passed(nothing, nothing, (area @ unshot, area @ unshot_again))
    receivers, weight = sample_receivers(n_baked, area, reflectance, settings.seed)
    sampled = np.flatnonzero(lit.sample)[:ERROR_RECEIVERS]
    monitor.phase("redistribute", len(receivers) + len(sampled))
    first, second = (
        redistribute(
            lit.scene,
            reflectors,
            exitance,
            lit.direct.valid,
            patches,
            settings,
            replicate=replicate,
            progress=monitor.advance,
        )
        for replicate, (exitance, patches) in enumerate(((unshot, receivers), (unshot_again, sampled)))
    )
    scattered = reflectance[receivers] * first.irradiance
    again = np.full((n_baked, 3), np.nan)
    again[sampled] = reflectance[sampled] * second.irradiance
    kept = area * ~reflectors.is_chosen
    arrived = (weight * area[receivers]) @ scattered
    return _Passed(
        scattered[:n_baked],
        again,
        (kept @ unshot + arrived, kept @ unshot_again + arrived),
        first.rays,
        second.rays,
        reflectors,
    )


def _ambient(
    lit: LitPatches,
    r_ave: np.ndarray,
    left: np.ndarray,
    emitted: np.ndarray,
    settings: BakeSettings,
    light: LightSettings,
) -> AmbientLight:
    """The ambient light once `left` (3,) W of the scattered direct light is unshot."""
    areas, opaque = lit.materials.given(lit.area), lit.materials.given(lit.opaque_area())
    area = opaque.sum()
    if not area > 0.0:
        return AmbientLight(np.zeros(3), r_ave, 0.0, settings.use_bleeding)
    openness = float(np.clip(1.0 - opaque @ lit.direct.hit_share / area, 0.0, 1.0))
    if light.ambient is Ambient.EMISSION:
        scattered = areas @ lit.unshot
        share = np.where(scattered > 0.0, left / np.where(scattered > 0.0, scattered, 1.0), 1.0)
        irradiance = ambient_from_emission(emitted, area, r_ave) * share
    else:
        irradiance = ambient_from_received(left, area, r_ave, openness)
    return AmbientLight(irradiance, r_ave, openness, settings.use_bleeding)
