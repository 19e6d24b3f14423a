"""The paper's scene Room (figures 8 and 9, table 1): furniture, a red and a yellow cube, and a cube that moves."""

from __future__ import annotations

from dataclasses import replace

from meshing import Body, Quad, Vector, box, box_sides, choose_divisions
from scene_description import Camera, Material, PointLamp, Sample, SceneObject

POLYGONS = 73
"""Table 1. Here 7 of the room (its ceiling is two: plain and shining), 10 boxes of furniture, the moving cube."""

ROOM_SIZE: Vector = (5.0, 4.0, 2.6)
LIGHT_STRIP_DEPTH = 0.4
"""The shining part of the ceiling: the strip along the wall behind the camera, y from 0 to this."""

# Axis labels of the room: 0 to 2 as in a box; the two parts of the ceiling may have grids of their own in depth, and
# the strip also in width, which is what makes odd totals possible (a closed box has an even number of patches).
CEILING_DEPTH_AXIS, STRIP_WIDTH_AXIS, STRIP_DEPTH_AXIS = 3, 4, 5

# The furniture: object, part, lower corner, upper corner, material.
FURNITURE: tuple[tuple[str, str, Vector, Vector, str], ...] = (
    ("Table", "Top", (2.9, 1.6, 0.66), (4.3, 2.4, 0.74), "Wood"),
    ("Table", "Leg 1", (2.95, 1.65, 0.0), (3.07, 1.77, 0.66), "Wood"),
    ("Table", "Leg 2", (4.13, 1.65, 0.0), (4.25, 1.77, 0.66), "Wood"),
    ("Table", "Leg 3", (4.13, 2.23, 0.0), (4.25, 2.35, 0.66), "Wood"),
    ("Table", "Leg 4", (2.95, 2.23, 0.0), (3.07, 2.35, 0.66), "Wood"),
    ("Sofa", "Seat", (2.7, 3.05, 0.0), (4.5, 3.7, 0.42), "Upholstery"),
    ("Sofa", "Back", (2.7, 3.7, 0.0), (4.5, 3.9, 0.84), "Upholstery"),
    ("Cabinet", "Body", (4.45, 0.5, 0.0), (4.9, 1.4, 1.8), "Wood"),
    ("Red Cube", "Body", (0.4, 2.95, 0.0), (1.0, 3.55, 0.6), "Red"),
    ("Yellow Cube", "Body", (1.85, 2.7, 0.0), (2.45, 3.3, 0.6), "Yellow"),
)

MOVING_CUBE_SIDE = 0.5
MOVING_CUBE_CELLS = 5
"""6 x 5 x 5 = 150 patches in both meshings: the paper's moving object has "around 150 patches"."""

# Keys of the moving cube, straight lines between them: in between red and yellow, up, over yellow and the table, past
# the cabinet, down and back. Centre of the cube.
MOVING_CUBE_KEYS: tuple[tuple[int, Vector], ...] = (
    (1, (1.425, 1.7, 0.35)),
    (45, (1.425, 3.2, 0.35)),
    (70, (1.425, 3.2, 1.0)),
    (95, (2.15, 3.0, 1.0)),
    (125, (2.7, 2.45, 1.1)),
    (155, (3.6, 2.0, 1.1)),
    (190, (4.0, 1.0, 0.9)),
    (225, (2.6, 0.95, 0.35)),
    (250, (1.425, 1.7, 0.35)),
)
LAST_FRAME = 250

MATERIALS = {
    "Wall": Material((0.70, 0.70, 0.68)),
    "Floor": Material((0.60, 0.58, 0.55)),
    "Wood": Material((0.42, 0.26, 0.14)),
    "Upholstery": Material((0.30, 0.38, 0.50)),
    "Red": Material((0.75, 0.06, 0.05)),
    "Yellow": Material((0.80, 0.65, 0.06)),
    "Moving": Material((0.75, 0.75, 0.75)),
    "Light Strip": Material((0.70, 0.70, 0.70), (4.0, 4.0, 4.0)),
}
LAMPS = (PointLamp("Lamp", (2.5, 1.6, 2.2), 60.0),)
CAMERA = Camera((0.35, 0.3, 1.75), (2.55, 2.45, 0.6), 20.0)


def sample(patches: int) -> Sample:
    """Return the scene with an exact number of patches, the moving cube's 150 among them."""
    half = MOVING_CUBE_SIDE / 2
    moving = box("Moving Cube", (-half,) * 3, (half,) * 3, "Moving").divided(*(MOVING_CUBE_CELLS,) * 3)
    still = [_room(), *(box(f"{thing} {part}", low, up, paint) for thing, part, low, up, paint in FURNITURE)]
    room, *boxes = choose_divisions(still, patches - moving.patch_count())
    objects: dict[str, tuple[Body, ...]] = {"Room": (room,)}
    for (thing, *_), body in zip(FURNITURE, boxes, strict=True):
        objects[thing] = (*objects.get(thing, ()), body)
    return Sample(
        f"room_{patches}",
        (
            *(SceneObject(name, bodies) for name, bodies in objects.items()),
            SceneObject("Moving Cube", (moving,), MOVING_CUBE_KEYS),
        ),
        MATERIALS,
        CAMERA,
        LAMPS,
        expected_polygons=POLYGONS,
        expected_patches=patches,
        last_frame=LAST_FRAME,
    )


def _room() -> Body:
    """Return the room's seven rectangles, facing inwards."""
    width, depth, height = ROOM_SIZE
    sides = box_sides((0.0, 0.0, 0.0), ROOM_SIZE, "Wall")
    sides["bottom"] = replace(sides["bottom"], material="Floor")
    del sides["top"]
    edge = LIGHT_STRIP_DEPTH
    ceiling = Quad(
        ((0.0, edge, height), (width, edge, height), (width, depth, height), (0.0, depth, height)),
        (0, CEILING_DEPTH_AXIS),
        "Wall",
    )
    strip = Quad(
        ((0.0, 0.0, height), (width, 0.0, height), (width, edge, height), (0.0, edge, height)),
        (STRIP_WIDTH_AXIS, STRIP_DEPTH_AXIS),
        "Light Strip",
    )
    return Body("Room", tuple(side.flipped() for side in (*sides.values(), ceiling, strip)))
