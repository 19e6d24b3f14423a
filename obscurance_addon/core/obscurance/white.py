"""Obscurances as a white layer: 1 where nothing is near, to multiply colours with.

W / R_ave has no bound, because R_ave takes in surfaces however far away: beside a large one that scatters nothing, or
nothing of one colour, everything else counts as many times brighter than the surroundings. What white relates to, and
how far above 1 it may rise, is told in docs/theory.md, "White scale".
"""

from __future__ import annotations

import numpy as np

MOST_BRIGHTER = 1.0  # how far above 1 the surroundings may count, however bright they are
LEAST_CHANNEL = 0.05  # of the brightest channel: a channel with less is told
_CHANNELS = ("red", "green", "blue")


def white_hits(hit: np.ndarray, reference: float) -> np.ndarray:
    """What hits add to a white layer, (n, 3) float64.

    Parameters
    ----------
    hit : ndarray, (n, 4) float64
        Mean of rho R per RGB channel and of rho over rays that hit, times their share, as of `ObscuranceSums`.
    reference : float
        Reflectance of hits that count as white; 0 takes hits of any colour so.
    """
    if not reference > 0.0:
        return np.repeat(hit[:, 3:], 3, axis=1)
    rho = hit[:, 3:]
    brightness = hit[:, :3] / np.where(rho > 0.0, reference * rho, 1.0)
    beyond = np.maximum(brightness - 1.0, 0.0)
    bounded = np.minimum(brightness, 1.0) - MOST_BRIGHTER * np.expm1(-beyond / MOST_BRIGHTER)
    return rho * bounded


def white_warnings(scattering: np.ndarray) -> list[str]:
    """What the user should know of a white layer with colour, from the mean reflectance (3,) of what scatters light."""
    if not scattering.any():
        return ["no surface reflects diffuse light, so the layer is grey: give the materials a color"]
    lacking = [
        name for name, value in zip(_CHANNELS, scattering, strict=True) if value < LEAST_CHANNEL * scattering.max()
    ]
    if not lacking:
        return []
    return [
        f"the surfaces reflect almost no {' and '.join(lacking)} light, so whatever is near another is tinted; "
        "turn off color bleeding for a grey layer"
    ]
