"""The ambient light I_A."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_ABSORPTION = 0.05  # light in a closed scene that absorbs less has no bound


@dataclass(frozen=True)
class AmbientLight:
    """What surroundings out of reach, and bounces that are not followed, are worth.

    Attributes
    ----------
    irradiance : ndarray, (3,) float64
        What an open patch receives of it, W/m^2: indirect light is I = R x (W / R_ave) x irradiance.
    r_ave : ndarray, (3,) float64
    openness : float
        1 - C: share of the hemisphere, averaged over all surfaces, in which there is none.
    use_bleeding : bool
    """

    irradiance: np.ndarray
    r_ave: np.ndarray
    openness: float
    use_bleeding: bool

    def intensity(self) -> np.ndarray:
        """I_A as the 2003 paper defines it, (3,) W/m^2: by eq. 4 with bleeding, where W carries an R, else by eq. 3."""
        if not self.use_bleeding:
            return self.irradiance
        return np.where(self.r_ave > 0.0, self.irradiance / np.where(self.r_ave > 0.0, self.r_ave, 1.0), 0.0)


def ambient_from_emission(flux: np.ndarray, area: float, r_ave: np.ndarray) -> np.ndarray:
    """Ambient irradiance (3,) W/m^2 from all that is emitted: R_ave / (1 - R_ave) x sum A E / A_total (eqs. 3, 4).

    Parameters
    ----------
    flux : ndarray, (3,)
        sum A_i E_i, W.
    area : float
        A_total, m^2.
    r_ave : ndarray, (3,)
        0 .. 1; from 0.95 on as 0.95.
    """
    return r_ave * flux / (area * np.maximum(1.0 - r_ave, LEAST_ABSORPTION))


def ambient_from_received(flux: np.ndarray, area: float, r_ave: np.ndarray, openness: float) -> np.ndarray:
    """Ambient irradiance (3,) W/m^2 from the direct light that surfaces scatter: C sum A R H / (A_total (1 - C R_ave)).

    The share C of light that leaves a surface meets another one, at every bounce: sum over n of C (C R_ave)^n. The
    result equals `ambient_from_emission` where R is the same everywhere and the scene is closed (C = 1), and it knows
    on which colour light falls.

    Parameters
    ----------
    flux : ndarray, (3,)
        sum A_i R_i H_i, W.
    area, r_ave
        As for `ambient_from_emission`.
    openness : float
        1 - C, 0 .. 1.
    """
    closed = 1.0 - openness
    return closed * flux / (area * np.maximum(1.0 - closed * r_ave, LEAST_ABSORPTION))
