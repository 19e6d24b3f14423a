"""The mean reflectance of a scene, and of those of its surfaces that scatter light."""

from __future__ import annotations

import numpy as np

from .patches import Surfaces, slices, triangle_areas
from .transmission import opacity

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709
# Luminance of a surface that counts half among those that scatter light; docs/theory.md, "White scale".
HALF_SCATTERING = 0.05


def mean_reflectance(
    surfaces: Surfaces,
    patch_area: np.ndarray,
    exposed: np.ndarray,
    patch_reflectance: np.ndarray | None,
    patch_opacity: np.ndarray | None = None,
) -> np.ndarray:
    """R_ave = sum A_i R_i / A_total per channel, over all surfaces but the parts of patches hidden inside of solids.

    The area of a transparent surface is that of what stops light: area times opacity.

    Parameters
    ----------
    surfaces : Surfaces
    patch_area : ndarray, (p,) float64
        Square metres.
    exposed : ndarray, (p,) float64
        Share of each patch outside of solids, 0 .. 1.
    patch_reflectance : ndarray, (p, 3) float, or None
        NaN for patches whose colour nothing sees. None leaves nothing out.
    patch_opacity : ndarray, (p,) float, or None
        None for opaque patches.

    Returns
    -------
    ndarray, (3,) float64
        Rounded to float32, so that areas of a turned object, which differ in their last bits, leave R_ave as it is:
        every patch of the scene depends on it.
    """
    sums = surface_sums(surfaces)
    hidden = np.zeros(4)
    if patch_reflectance is not None:
        hidden = hidden_sums(patch_area, exposed, patch_reflectance, patch_opacity)
    return mean_of_sums(sums[:4], hidden)


def surface_sums(surfaces: Surfaces) -> np.ndarray:
    """Sums over all triangles, (8,) float64.

    First of opaque area, square metres, and of area times reflectance, as `mean_of_sums` takes them; then the same of
    the area that scatters light, as `scattering_mean` takes them.
    """
    triangles = surfaces.triangles
    area = np.empty(len(triangles))
    for part in slices(len(triangles)):
        area[part] = triangle_areas(surfaces.vertices[triangles[part]])
    area[~np.isfinite(area)] = 0.0
    reflectance = surfaces.reflectance.astype(np.float64)
    if surfaces.transmission is not None:  # what stops light, and the reflectance of that alone
        stops = opacity(surfaces.transmission.mean)
        area = area * stops
        reflectance = reflectance / np.where(stops > 0.0, stops, 1.0)[:, None]
    area, reflectance = _seen(area, reflectance)
    square = (reflectance @ LUMINANCE) ** 2
    scattering = area * (square / (square + HALF_SCATTERING**2))
    return np.concatenate([[area.sum()], area @ reflectance, [scattering.sum()], scattering @ reflectance])


def hidden_sums(
    patch_area: np.ndarray, exposed: np.ndarray, patch_reflectance: np.ndarray, patch_opacity: np.ndarray | None = None
) -> np.ndarray:
    """Sums of opaque area, and of area times reflectance, of what is hidden inside of solids, (4,) float64."""
    hidden, reflectance = patch_area * (1.0 - exposed), np.asarray(patch_reflectance, np.float64)
    stops = np.ones(len(hidden)) if patch_opacity is None else patch_opacity
    seen = ~np.isnan(reflectance).any(1)
    return np.append(hidden[seen] @ stops[seen], hidden[seen] @ reflectance[seen])


def _seen(area: np.ndarray, reflectance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (n,) and reflectances (n, 3) without those that are NaN."""
    unseen = np.isnan(reflectance).any(1)
    return (area[~unseen], reflectance[~unseen]) if unseen.any() else (area, reflectance)


def mean_of_sums(sums: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """R_ave (3,) from sums of area and of area times reflectance, each (4,) float64, of all and of what is hidden."""
    if hidden[0] < (1.0 - 1e-9) * sums[0]:
        sums = sums - hidden
    return _mean(sums)


def scattering_mean(sums: np.ndarray) -> np.ndarray:
    """Mean reflectance (3,) of the surfaces that scatter light, from the last four of `surface_sums`; 0 for none.

    A surface of luminance g counts by g^2 / (g^2 + HALF_SCATTERING^2) of its area, so that black, shining and mirroring
    ones leave it by degrees.
    """
    return _mean(sums)


def _mean(sums: np.ndarray) -> np.ndarray:
    """Reflectance (3,) in 0 .. 1 from sums (4,), rounded to float32; 0 without area."""
    mean = np.clip(sums[1:] / sums[0], 0.0, 1.0) if sums[0] > 0.0 else np.zeros(3)
    return mean.astype(np.float32).astype(np.float64)
