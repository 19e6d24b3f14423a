"""Light sources without geometry, in Blender's units as Cycles renders them, and how to sample them.

Lamps are made in the world's metres and watts; `normalised` moves them into the coordinates of a bake and divides
radiant intensities (W/sr) by the square of its scale, so that intensity / distance^2 stays an irradiance in W/m^2.
Every lamp answers `sample`: for shading points and points of the unit square, a direction, a distance, and what a
surface facing that direction would receive if nothing were in the way, so that E = cos(theta) x received x visibility
has the lamp's irradiance as its mean over the unit square.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..sampling import orthonormal_frames, sample_cone, sample_disc
from ..scene import Normalisation
from ..tracing import FAR

TINY = np.float32(1e-20)


@dataclass(frozen=True)
class LampSamples:
    """Samples of a lamp from n shading points.

    Attributes
    ----------
    direction : ndarray, (n, 3) float32
        Unit vectors towards the lamp.
    distance : ndarray, (n,) float32
        How far the way must be free, normalised.
    received : ndarray, (n, 3) float32
        W/m^2 on a surface that faces the direction.
    """

    direction: np.ndarray
    distance: np.ndarray
    received: np.ndarray


class LightSource(Protocol):
    """What direct light asks of a source."""

    name: str
    casts_shadow: bool

    def sample(self, points: np.ndarray, normals: np.ndarray, unit: np.ndarray) -> LampSamples:
        """Sample the source; points and normals (n, 3) float32, unit (n, 2) float32 in 0 .. 1."""
        ...


class Lamp(LightSource, Protocol):
    """A source without geometry, made in the world's metres."""

    def normalised(self, normalisation: Normalisation) -> Lamp:
        """The lamp of the world's metres in normalised coordinates."""
        ...

    def flux(self) -> np.ndarray:
        """What the lamp emits altogether per channel, (3,) W; before `normalised`. 0 for one infinitely far away."""
        ...


@dataclass(frozen=True)
class PointLamp:
    """A ball that shines evenly to all sides, a point when its radius is 0; with a cone it is a spot lamp.

    Attributes
    ----------
    name : str
    position : ndarray, (3,)
    intensity : ndarray, (3,)
        Radiant intensity per channel on the axis.
    radius : float
    cone : SpotCone or None
    is_disc : bool
        The ball is replaced by a disc that turns towards each shading point (Blender's soft falloff): within reach of
        the ball, light falls off without an edge.
    casts_shadow : bool
    """

    name: str
    position: np.ndarray
    intensity: np.ndarray
    radius: float = 0.0
    cone: SpotCone | None = None
    is_disc: bool = False
    casts_shadow: bool = True

    def normalised(self, normalisation: Normalisation) -> PointLamp:
        return replace(
            self,
            position=normalisation.apply(np.asarray(self.position)),
            intensity=np.asarray(self.intensity) / normalisation.scale**2,
            radius=self.radius / normalisation.scale,
        )

    def flux(self) -> np.ndarray:
        return 4.0 * np.pi * np.asarray(self.intensity) * (1.0 if self.cone is None else self.cone.mean_share())

    def sample(self, points: np.ndarray, _normals: np.ndarray, unit: np.ndarray) -> LampSamples:
        towards = np.float32(self.position) - points
        square = np.maximum(np.einsum("ij,ij->i", towards, towards), TINY)
        distance = np.sqrt(square)
        axis = towards / distance[:, None]
        if self.radius > 0.0 and self.is_disc:
            direction, distance, per_intensity = self._sample_disc(axis, distance, unit)
        elif self.radius > 0.0:
            radius_square = np.float32(self.radius**2)
            outside = square > radius_square
            cosine = np.where(outside, np.sqrt(np.maximum(1.0 - radius_square / square, 0.0)), -1.0)
            direction, along = sample_cone(axis, cosine, unit)
            # Radiance I / (pi r^2) x solid angle 2 pi (1 - cos), written so that small spheres keep their digits.
            per_intensity = 2.0 / np.where(outside, square * (1.0 + cosine), 0.5 * radius_square)
            inner = np.sqrt(np.maximum(radius_square - square * (1.0 - along * along), 0.0))
            distance = distance * along + np.where(outside, -inner, inner)
        else:
            direction, per_intensity = axis, 1.0 / square
        received = per_intensity[:, None] * np.float32(self.intensity)
        if self.cone is not None:
            received *= self.cone.share(-direction)[:, None]
        return LampSamples(direction, distance, received.astype(np.float32))

    def _sample_disc(
        self, axis: np.ndarray, distance: np.ndarray, unit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction (n, 3), distance (n,) and received light per intensity (n,) of points on the disc."""
        place = np.concatenate([sample_disc(unit) * np.float32(self.radius), distance[:, None]], 1)
        length = np.sqrt(np.einsum("ij,ij->i", place, place))
        direction = np.einsum("ij,ijk->ik", place / length[:, None], orthonormal_frames(axis).astype(np.float32))
        return direction.astype(np.float32), length, distance / length**3


@dataclass(frozen=True)
class SpotCone:
    """How much of a spot lamp's intensity goes where.

    Attributes
    ----------
    frame : ndarray, (3, 3)
        Rows: the lamp's x axis, y axis and beam in the world; x and y divided by the lamp's scale against that along
        the beam, so that a stretched lamp has an elliptic cone.
    cosine : float
        Of half the opening angle.
    blend : float
        Share 0 .. 1 of the cone over which it fades.
    """

    frame: np.ndarray
    cosine: float
    blend: float

    def share(self, direction: np.ndarray) -> np.ndarray:
        """Share 0 .. 1 of the intensity along unit vectors (n, 3) that leave the lamp."""
        local = direction @ np.float32(self.frame).T
        cosine = local[:, 2] / np.maximum(np.sqrt(np.einsum("ij,ij->i", local, local)), TINY)
        edge = max((1.0 - self.cosine) * self.blend, 1e-6)
        x = np.clip((cosine - np.float32(self.cosine)) / np.float32(edge), 0.0, 1.0)
        return x * x * (3.0 - 2.0 * x)

    def mean_share(self) -> float:
        """Mean of `share` over all directions, for a round cone."""
        edge = max((1.0 - self.cosine) * self.blend, 1e-6)  # the share of a direction there is 1/2 on average
        return 0.5 * (1.0 - self.cosine - 0.5 * edge)


@dataclass(frozen=True)
class SunLamp:
    """A disc infinitely far away.

    Attributes
    ----------
    name : str
    direction : ndarray, (3,)
        Unit vector towards the sun.
    irradiance : ndarray, (3,)
        W/m^2 on a surface that faces it.
    half_angle : float
        Radians, 0 .. pi / 2.
    casts_shadow : bool
    """

    name: str
    direction: np.ndarray
    irradiance: np.ndarray
    half_angle: float = 0.0
    casts_shadow: bool = True

    def normalised(self, _normalisation: Normalisation) -> SunLamp:
        return self

    def flux(self) -> np.ndarray:
        return np.zeros(3)

    def sample(self, points: np.ndarray, _normals: np.ndarray, unit: np.ndarray) -> LampSamples:
        axis = np.broadcast_to(np.float32(self.direction), points.shape)
        cosine = np.float32(np.cos(self.half_angle))
        direction = sample_cone(axis, cosine, unit)[0] if self.half_angle > 0.0 else axis
        # Radiance E / (pi sin^2) x solid angle 2 pi (1 - cos) = 2 E / (1 + cos).
        received = np.broadcast_to(np.float32(2.0 * np.asarray(self.irradiance) / (1.0 + cosine)), points.shape)
        return LampSamples(direction, np.full(len(points), FAR, np.float32), received)


@dataclass(frozen=True)
class AreaLamp:
    """A rectangle or ellipse that shines to one side.

    Attributes
    ----------
    name : str
    centre : ndarray, (3,)
    half_x, half_y : ndarray, (3,)
        Half the sides, or the semi-axes.
    beam : ndarray, (3,)
        Unit normal of the side that shines.
    radiance : ndarray, (3,)
        W/(m^2 sr) along the normal.
    is_ellipse : bool
    half_spread : float
        Radians, up to pi / 2; below that the light is gathered into a beam, as Cycles does.
    casts_shadow : bool
    """

    name: str
    centre: np.ndarray
    half_x: np.ndarray
    half_y: np.ndarray
    beam: np.ndarray
    radiance: np.ndarray
    is_ellipse: bool = False
    half_spread: float = np.pi / 2.0
    casts_shadow: bool = True

    @property
    def area(self) -> float:
        """Normalised units squared."""
        rectangle = 4.0 * float(np.linalg.norm(np.cross(self.half_x, self.half_y)))
        return rectangle * (np.pi / 4.0 if self.is_ellipse else 1.0)

    def of_power(self, power: np.ndarray) -> AreaLamp:
        """The lamp with the radiance that makes it emit `power` (3,) watts."""
        return replace(self, radiance=np.asarray(power) / (np.pi * self.area))

    def normalised(self, normalisation: Normalisation) -> AreaLamp:
        half_x, half_y = (np.asarray(half) / normalisation.scale for half in (self.half_x, self.half_y))
        return replace(self, centre=normalisation.apply(np.asarray(self.centre)), half_x=half_x, half_y=half_y)

    def flux(self) -> np.ndarray:
        return np.pi * self.area * np.asarray(self.radiance)  # gathering it into a beam keeps the flux

    def sample(self, points: np.ndarray, _normals: np.ndarray, unit: np.ndarray) -> LampSamples:
        place = sample_disc(unit) if self.is_ellipse else 2.0 * unit - 1.0
        on_lamp = np.float32(self.centre) + place @ np.float32([self.half_x, self.half_y])
        towards = on_lamp - points
        square = np.maximum(np.einsum("ij,ij->i", towards, towards), TINY)
        distance = np.sqrt(square)
        direction = towards / distance[:, None]
        cosine = np.maximum(-(direction @ np.float32(self.beam)), 0.0)
        factor = np.float32(self.area) * cosine / square
        if self.half_spread < np.pi / 2.0 - 1e-4:
            factor = factor * self._spread(cosine)
        return LampSamples(direction, distance, (factor[:, None] * np.float32(self.radiance)).astype(np.float32))

    def _spread(self, cosine: np.ndarray) -> np.ndarray:
        """Radiance at an angle to the normal, relative to a lamp without spread (Cycles' light/area.h)."""
        half = max(self.half_spread, 1e-4)
        tangent = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)) / np.maximum(cosine, TINY)
        return np.maximum(np.float32(np.tan(half)) - tangent, 0.0) / np.float32(np.tan(half) - half)
