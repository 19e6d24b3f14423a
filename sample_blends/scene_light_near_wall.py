"""A closed white room with one blue wall and a light close to it: the difficult case of the paper's figures 5 to 7."""

from __future__ import annotations

import math
from dataclasses import replace

from meshing import Body, Vector, box_sides, hexahedron
from scene_description import Camera, Material, Sample, SceneObject

ROOM_SIZE: Vector = (3.0, 4.0, 2.4)
CELLS = (15, 20, 12)
"""Patches of exactly 20 cm x 20 cm on every wall."""

# The light: a thin closed box, 10 cm in front of the blue wall (x = 0), that shines at that wall and nowhere else.
LAMP_LOWER: Vector = (0.10, 2.2, 1.3)
LAMP_UPPER: Vector = (0.14, 2.8, 1.7)
LAMP_CELLS = (1, 6, 4)

# Blocks: centre of the foot, side, height, turn about the vertical in degrees.
TALL_BLOCK = ((1.35, 3.0), 0.6, 1.2, 17.0)
SHORT_BLOCK = ((2.05, 2.2), 0.6, 0.6, -17.0)

MATERIALS = {
    "White": Material((0.75, 0.75, 0.75)),
    "Blue": Material((0.08, 0.12, 0.65)),
    "Lamp": Material((0.0, 0.0, 0.0), (60.0, 60.0, 60.0)),
    "Housing": Material((0.2, 0.2, 0.2)),
}

CAMERA = Camera((2.55, 0.1, 1.4), (1.0, 3.0, 1.05), 19.0)


def sample() -> Sample:
    """Return the scene."""
    sides = box_sides((0.0, 0.0, 0.0), ROOM_SIZE, "White")
    sides["left"] = replace(sides["left"], material="Blue")
    room = Body("Room", tuple(side.flipped() for side in sides.values())).divided(*CELLS)
    lamp = box_sides(LAMP_LOWER, LAMP_UPPER, "Housing")
    lamp["left"] = replace(lamp["left"], material="Lamp")
    objects = (
        SceneObject("Room", (room,)),
        SceneObject("Tall Block", (_block("Tall Block", *TALL_BLOCK).divided(3, 3, 6),)),
        SceneObject("Short Block", (_block("Short Block", *SHORT_BLOCK).divided(3, 3, 3),)),
        SceneObject("Lamp", (Body("Lamp", tuple(lamp.values())).divided(*LAMP_CELLS),)),
    )
    return Sample("light_near_wall", objects, MATERIALS, CAMERA, expected_polygons=24, expected_patches=1652)


def _block(name: str, centre: tuple[float, float], side: float, height: float, turn: float) -> Body:
    radius = side / math.sqrt(2.0)
    angles = [math.radians(turn + 225.0 + 90.0 * k) for k in range(4)]
    foot = [(centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angles]
    sides = hexahedron([(x, y, 0.0) for x, y in foot], [(x, y, height) for x, y in foot], "White")
    return Body(name, tuple(sides.values()))
