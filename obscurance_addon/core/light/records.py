"""What a bake of light takes beside geometry, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..tracing import Rooms
from .ambient import AmbientLight
from .lamps import Lamp


@dataclass(frozen=True)
class LightSources:
    """The light of a scene, but for its emissive faces.

    Attributes
    ----------
    lamps : tuple of Lamp
        In the world's metres.
    world : ndarray, (3,) float64
        Constant radiance of the world, W/(m^2 sr).
    """

    lamps: tuple[Lamp, ...] = ()
    world: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class PatchMaterials:
    """What all patches of a scene scatter and emit: first those to bake, then those around them.

    Attributes
    ----------
    reflectance : ndarray, (p, 3) float64
    emission : ndarray, (p, 3) float64
        Radiant exitance, W/m^2.
    gives : ndarray, (p,) bool, or None
        False for patches whose colour and light nothing else sees; None where all is seen.
    opacity : ndarray, (p,) float64, or None
        Share of the light that they stop; None where all are opaque.
    """

    reflectance: np.ndarray
    emission: np.ndarray
    gives: np.ndarray | None = None
    opacity: np.ndarray | None = None

    def given(self, values: np.ndarray) -> np.ndarray:
        """Values (p, ...) of patches, 0 where nothing else sees them."""
        return values if self.gives is None else (values.T * self.gives).T

    def seen_reflectance(self) -> np.ndarray:
        """`reflectance`, NaN where nothing else sees it."""
        return self.reflectance if self.gives is None else np.where(self.gives[:, None], self.reflectance, np.nan)

    def opacity_of(self, patches: slice) -> np.ndarray | None:
        """That of some patches; None where all are opaque."""
        return None if self.opacity is None else self.opacity[patches]


@dataclass(frozen=True)
class BakedLight:
    """What a bake of light computed.

    Attributes
    ----------
    radiance : ndarray, (p, 3) float64
        Of the quantity asked for, W/(m^2 sr), as it leaves each patch.
    rmse : ndarray, (3,) float64
        Estimated root mean square error of `radiance` over patches.
    exposed : ndarray, (p,) float64
        Share of each patch outside of solids. Where it is 0, values come from neighbours as in `Obscurances`.
    r_ave : ndarray, (3,) float64
    d_max : float
        Metres.
    rays, error_rays : int
    ambient : AmbientLight or None
    reflectors : int
        Secondary reflectors that redistributed light.
    reflected_share : float
        Share of the scattered direct light that they held.
    seconds : dict of str to float
        Per phase: build, trace, light.
    warnings : list of str
    rooms : Rooms
        Who is in which room.
    """

    radiance: np.ndarray
    rmse: np.ndarray
    exposed: np.ndarray
    r_ave: np.ndarray
    d_max: float
    rays: int
    error_rays: int
    ambient: AmbientLight | None
    reflectors: int
    reflected_share: float
    seconds: dict[str, float]
    warnings: list[str]
    rooms: Rooms

    @property
    def valid(self) -> np.ndarray:
        """(p,) bool: patches with a value of their own."""
        return self.exposed > 0.0
