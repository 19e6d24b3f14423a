"""Sheets that look away from the scene are found, others are not."""

import numpy as np
import pytest

from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from tests.core.scenes import Mesh, box, floor, grid, icosphere, mesh, scene

GROUND = floor((-5, -5), (5, 5), 10, 10)
CUBE = box((-1, -1, 0.02), (1, 1, 2))
SIDES = box((0, 0, 0), (4, 4, 3))
WALLS = [mesh(SIDES.vertices, SIDES.triangles[2 * i : 2 * i + 2], [0, 0]) for i in range(6)]


def away(*meshes: Mesh) -> list[int]:
    """Which of the meshes look away."""
    s = scene(meshes)
    numbers = build_scene(s.surfaces, s.patches, BakeSettings(distance=1.0), whole=True).rooms.away
    return (np.searchsorted(s.surfaces.object_starts, numbers - 1, side="right") - 1).tolist()


def test_a_ground_with_normals_down():
    assert away(GROUND, CUBE) == []
    assert away(GROUND.flipped(), CUBE) == [0]


def test_walls_that_are_planes():
    lamp = icosphere(1).moved(0.3, (2, 2, 1.5))
    assert away(*[wall.flipped() for wall in WALLS], lamp) == []
    assert away(*WALLS, lamp) == list(range(6))


@pytest.mark.parametrize("alone", [GROUND, GROUND.flipped(), grid((0, 0, 0), (0, 1, 0), (0, 0, 1))])
def test_a_sheet_alone_looks_nowhere(alone):
    assert away(alone) == []


def test_a_bowl_and_solids_do_not():
    """What lies behind a bowl is itself."""
    ball = icosphere(3)
    bowl = mesh(ball.vertices, ball.triangles[ball.corners().mean(1)[:, 2] < 0.0])
    assert away(bowl) == []
    assert away(CUBE, CUBE.moved(offset=(3, 0, 0))) == []
