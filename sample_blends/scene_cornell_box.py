"""The Cornell box as published, cut into patches of about 3.4 cm."""

from __future__ import annotations

from dataclasses import replace

import cornell_measurements as cornell
from meshing import Body, Quad, Vector, hexahedron, piecewise, uniform
from scene_description import Camera, Material, Sample, SceneObject

MILLIMETRE = 0.001

# Cells between the light's edges and the walls, so that the hole for the light falls on grid lines in the ceiling.
CELLS_ACROSS = (6, 4, 6)
CELLS_DEEP = (7, 3, 7)
CELLS_HIGH = 16
SHORT_BLOCK_CELLS = (5, 5, 5)
TALL_BLOCK_CELLS = (5, 5, 10)

RESOLUTION = (480, 480)
"""Square, as the published sensor."""

EXPOSURE = 1.2
"""Stops; the unit of the published emission is arbitrary, and this shows the walls at a usual brightness."""

MATERIALS = {
    "White": Material(cornell.to_linear_rgb(cornell.WHITE_SPECTRUM)),
    "Red": Material(cornell.to_linear_rgb(cornell.RED_SPECTRUM)),
    "Green": Material(cornell.to_linear_rgb(cornell.GREEN_SPECTRUM)),
    "Light": Material((cornell.LIGHT_REFLECTANCE,) * 3, cornell.to_linear_rgb(cornell.LIGHT_SPECTRUM)),
}
WALL_MATERIALS: dict[str, str] = {"left": "Red", "right": "Green"}


def to_blender(point: Vector) -> Vector:
    """Turn a published point (x left, y up, z away; mm) into Blender's axes (x right, y away, z up; m)."""
    x, y, z = point
    return -x * MILLIMETRE, z * MILLIMETRE, y * MILLIMETRE


def sample() -> Sample:
    """Return the scene."""
    objects = (
        SceneObject("Room", (_room(),)),
        SceneObject("Short Block", (_block("Short Block", cornell.SHORT_BLOCK_TOP).divided(*SHORT_BLOCK_CELLS),)),
        SceneObject("Tall Block", (_block("Tall Block", cornell.TALL_BLOCK_TOP).divided(*TALL_BLOCK_CELLS),)),
        SceneObject("Light", (_light(),)),
    )
    position = cornell.CAMERA_POSITION
    ahead = tuple(p + d for p, d in zip(position, cornell.CAMERA_DIRECTION, strict=True))
    camera = Camera(
        to_blender(position),
        to_blender(ahead),
        cornell.CAMERA_FOCAL_LENGTH,
        cornell.CAMERA_SENSOR_WIDTH,
        RESOLUTION,
        EXPOSURE,
    )
    return Sample("cornell_box", objects, MATERIALS, camera, expected_polygons=18, expected_patches=1744)


def _room() -> Body:
    """Return floor, ceiling and three walls, facing inwards; the front is open and the ceiling has the light's hole."""
    sides = hexahedron([to_blender(p) for p in cornell.FLOOR], [to_blender(p) for p in cornell.CEILING], "White")
    del sides["front"]
    light_left, light_right, light_front, light_back = _light_fractions()
    sides["top"] = replace(sides["top"], opening=(light_left, light_right, light_front, light_back))
    inwards = tuple(_painted(name, side).flipped() for name, side in sides.items())
    across = piecewise((0.0, light_left, light_right, 1.0), CELLS_ACROSS)
    deep = piecewise((0.0, light_front, light_back, 1.0), CELLS_DEEP)
    return Body("Room", inwards, (across, deep, uniform(CELLS_HIGH)))


def _painted(name: str, side: Quad) -> Quad:
    return replace(side, material=WALL_MATERIALS.get(name, side.material))


def _light_fractions() -> tuple[float, float, float, float]:
    """Return where the light's edges lie across (left to right) and into (front to back) the ceiling."""
    width, depth = cornell.CEILING[0][0], cornell.CEILING[2][2]
    xs, zs = [p[0] for p in cornell.LIGHT], [p[2] for p in cornell.LIGHT]
    return (width - max(xs)) / width, (width - min(xs)) / width, min(zs) / depth, max(zs) / depth


def _light() -> Body:
    corners = tuple(to_blender(p) for p in cornell.LIGHT)
    return Body("Light", (Quad(corners, (0, 1), "Light").flipped(),)).divided(CELLS_ACROSS[1], CELLS_DEEP[1])


def _block(name: str, published_top: tuple[Vector, ...]) -> Body:
    top = [to_blender(p) for p in published_top]
    return Body(name, tuple(hexahedron([(x, y, 0.0) for x, y, _ in top], top, "White").values()))
