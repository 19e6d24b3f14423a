"""The paper's scene Infinite (figures 10 and 11, table 1): six rooms of Crystal Space's infinite maze.

The shape of a room is that of Crystal Space's demo (apps/walktest/infmaze.cpp, crystalspace/CS, as of 2001): rooms
2 m apart; each of the six walls is a square panel of 0.9 of the side, and four frame rectangles, 0.1 deep, stand on its
edges towards the room. The frames of neighbouring walls meet edge to edge, so that panels and frames close the room.
"""

from __future__ import annotations

from meshing import Body, Quad, Vector
from scene_description import Camera, Colour, Material, PointLamp, Sample, SceneObject

POLYGONS = 180
"""Table 1: six rooms with six walls of one panel and four frame rectangles."""

PITCH = 2.0
PANEL_HALF = 0.9
FRAME_DEPTH = 0.1
OPENING_FRACTION = 0.5
"""How much of a panel's width is open between two joined rooms (our choice)."""

FRAME_CELLS_DEEP = 2
PANEL_CELLS = {5508: 9, 13824: 16}
"""Cells along a panel's side n, such that 36 walls of n x n + 4 x (n x 2) patches give the totals of table 1."""

Cell = tuple[int, int, int]

# The maze is our choice: position of each room, the colour of its panels, its lamp's place relative to the centre.
ROOMS: tuple[tuple[str, Cell, Colour, Vector], ...] = (
    ("Orange", (0, 0, 0), (0.75, 0.36, 0.10), (-0.45, 0.1, 0.6)),
    ("Blue", (0, 1, 0), (0.12, 0.25, 0.72), (0.5, 0.3, 0.6)),
    ("Yellow", (0, 2, 0), (0.78, 0.68, 0.12), (0.4, 0.0, 0.3)),
    ("Red", (1, 1, 0), (0.72, 0.10, 0.10), (0.3, -0.2, 0.5)),
    ("Green", (-1, 2, 0), (0.14, 0.60, 0.18), (-0.3, 0.2, 0.5)),
    ("Violet", (0, 2, 1), (0.50, 0.15, 0.65), (-0.3, 0.3, 0.4)),
)
FRAME_COLOUR: Colour = (0.70, 0.70, 0.70)
LAMP_POWER = 14.0
CAMERA = Camera((0.38, -0.86, 0.12), (-0.02, 2.0, -0.06), 20.0)


def sample(patches: int) -> Sample:
    """Return the scene at one of the two patch counts of table 1."""
    cells = PANEL_CELLS[patches]
    centres = [tuple(PITCH * k for k in cell) for _, cell, _, _ in ROOMS]
    objects, lamps = [], []
    materials = {"Frame": Material(FRAME_COLOUR)}
    for (colour, cell, reflectance, offset), centre in zip(ROOMS, centres, strict=True):
        name = f"Room {colour}"
        materials[colour] = Material(reflectance)
        objects.append(SceneObject(name, (Body(name, _room(cell, colour)).divided(cells, FRAME_CELLS_DEEP),)))
        place = tuple(c + o for c, o in zip(centre, offset, strict=True))
        lamps.append(PointLamp(f"Lamp {colour}", place, LAMP_POWER))
    return Sample(
        f"infinite_{patches}",
        tuple(objects),
        materials,
        CAMERA,
        tuple(lamps),
        expected_polygons=POLYGONS,
        expected_patches=patches,
    )


def _room(cell: Cell, material: str) -> tuple[Quad, ...]:
    """Return the 30 polygons of the room at a place of the maze, facing inwards."""
    occupied = {position for _, position, _, _ in ROOMS}
    quads: list[Quad] = []
    for axis in range(3):
        for sign in (-1, 1):
            neighbour = tuple(k + sign * (a == axis) for a, k in enumerate(cell))
            quads += _wall(cell, axis, sign, neighbour in occupied, material)
    return tuple(quads)


def _wall(cell: Cell, axis: int, sign: int, joined: bool, material: str) -> list[Quad]:
    """Return the panel of one wall and its four frame rectangles.

    A joined wall's panel is pushed aside: it keeps a strip at one end, the panel of the room beyond a strip at the
    other end of the same plane, and the part between them is open.
    """
    first, second = ((axis + 1) % 3, (axis + 2) % 3)[::-sign]  # first x second points into the room
    slide = next(a for a in (0, 1) if a != axis)  # a leaf slides sideways, never up
    turns = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    strip_end = -PANEL_HALF + (1.0 - OPENING_FRACTION) * PANEL_HALF

    def corner(turn: tuple[int, int], outwards: float, leaf: bool = False) -> Vector:
        local = [0.0, 0.0, 0.0]
        local[axis], local[first], local[second] = sign * outwards, turn[0] * PANEL_HALF, turn[1] * PANEL_HALF
        if leaf and local[slide] * sign > 0.0:  # the leaf of the lower room stays at the lower end, and conversely
            local[slide] = sign * strip_end
        return tuple(PITCH * k + x for k, x in zip(cell, local, strict=True))

    plane = PITCH / 2
    panel = Quad(tuple(corner(turn, plane, joined) for turn in turns), (0, 0), material)
    frames = []
    for start, stop in zip(turns, (*turns[1:], turns[0]), strict=True):
        outer_stop, outer_start = corner(stop, plane), corner(start, plane)
        inner_start, inner_stop = corner(start, plane - FRAME_DEPTH), corner(stop, plane - FRAME_DEPTH)
        frames.append(Quad((outer_stop, outer_start, inner_start, inner_stop), (0, 1), "Frame"))
    return [panel, *frames]
