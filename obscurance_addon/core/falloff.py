"""The distance function rho(d) of the obscurances (eq. 1): how much light a hit at distance d lets through.

Every rho is 0 at distance 0, never falls with distance, and is 1 from d_max on. Concave shapes join the value 1 without
a visible edge; see docs/theory.md for the sources of each.
"""

from __future__ import annotations

import enum

import numpy as np

_EXP_SCALE = 1.0 / -np.expm1(-1.0)  # 1 / (1 - 1/e): makes the exponential reach 1 at d_max without a jump


class Falloff(enum.StrEnum):
    """Names of the distance functions, written as functions of s = d / d_max in [0, 1)."""

    SQRT = "SQRT"  # s^(1/2)
    CBRT = "CBRT"  # s^(1/3)
    LINEAR = "LINEAR"  # s
    EXPONENTIAL = "EXPONENTIAL"  # (1 - exp(-s)) / (1 - 1/e)
    STEP = "STEP"  # 0: any hit nearer than d_max blocks fully, classical ambient occlusion


def apply_falloff(falloff: Falloff, s: np.ndarray) -> np.ndarray:
    """Replace relative distances by rho, in place.

    Parameters
    ----------
    falloff : Falloff
        The distance function.
    s : ndarray, float32 or float64, any shape
        d / d_max of rays that hit, in [0, 1]. Overwritten.

    Returns
    -------
    ndarray
        `s` itself, now rho in [0, 1].
    """
    if falloff is Falloff.SQRT:
        return np.sqrt(s, out=s)
    if falloff is Falloff.CBRT:
        return np.cbrt(s, out=s)
    if falloff is Falloff.EXPONENTIAL:
        np.expm1(np.negative(s, out=s), out=s)
        return np.multiply(s, -_EXP_SCALE, out=s)
    if falloff is Falloff.STEP:
        s.fill(0.0)
    return s
