"""What a sample scene consists of, said without Blender: objects, materials, lamps, a camera."""

from __future__ import annotations

from dataclasses import dataclass

from meshing import Body, Quad, Vector

Colour = tuple[float, float, float]
"""Linear RGB with Rec.709 primaries and a D65 white."""


@dataclass(frozen=True)
class Material:
    """A Lambertian surface: reflectance in 0..1 and emitted radiance in W/(m^2 sr), both per channel."""

    reflectance: Colour
    emission: Colour = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SceneObject:
    """A mesh object; a moving one has (frame, location) keys and its bodies are given around its own origin."""

    name: str
    bodies: tuple[Body, ...]
    keys: tuple[tuple[int, Vector], ...] = ()


@dataclass(frozen=True)
class PointLamp:
    """A point light: place in metres, power in watts, a radius that keeps shadows from being razor sharp."""

    name: str
    location: Vector
    power: float
    radius: float = 0.05


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: place and point looked at in metres, lens and sensor in millimetres, exposure in stops."""

    location: Vector
    target: Vector
    focal_length: float
    sensor_width: float = 36.0
    resolution: tuple[int, int] = (640, 480)
    exposure: float = 0.0


@dataclass(frozen=True)
class Sample:
    """One sample file and the counts that it must have."""

    name: str
    objects: tuple[SceneObject, ...]
    materials: dict[str, Material]
    camera: Camera
    lamps: tuple[PointLamp, ...] = ()
    expected_polygons: int | None = None
    expected_patches: int | None = None
    last_frame: int = 1

    def quads(self) -> list[Quad]:
        """Return every polygon of the scene before meshing."""
        return [quad for item in self.objects for body in item.bodies for quad in body.quads]

    def patch_count(self) -> int:
        """Return the number of patches of the scene."""
        return sum(body.patch_count() for item in self.objects for body in item.bodies)

    def check(self) -> None:
        """Compare the counts with the expected ones.

        Raises
        ------
        ValueError
            If the number of polygons or of patches is not the expected one, or a material is missing.
        """
        for what, expected, found in (
            ("polygons", self.expected_polygons, len(self.quads())),
            ("patches", self.expected_patches, self.patch_count()),
        ):
            if expected is not None and found != expected:
                raise ValueError(f"{self.name}: {found} {what} instead of {expected}")
        missing = {quad.material for quad in self.quads()} - self.materials.keys()
        if missing:
            raise ValueError(f"{self.name}: no material named {sorted(missing)}")
