"""The automatic distance: a fifth of the size of what is baked and stands by it, whatever else is in the scene."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.scene.patches import Patches
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import reach_of
from obscurance_addon.core.tracing.reach import scene_size
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import box, floor, icosphere, room, scene
from tests.core.updates.changing_scenes import objects_of

FLOOR = floor((-3, -3), (3, 3), 4, 4)
ROOF = box((-2, -2, 2.5), (2, 2, 2.7))
WALL = box((-2, -2, 0), (-1.8, 2, 2.5))
HUT = [FLOOR, ROOF, WALL]
HUT_SIZE = (6**2 + 6**2 + 2.7**2) ** 0.5
SKY, HORIZON = icosphere(2, 200.0).flipped(), floor((-1000, -1000), (1000, 1000), z=-0.05)
STRAY = box((500, 0, 0), (501, 1, 1))
CUP, TABLE, ROOM = (
    box((0, 0, 0.8), (0.1, 0.1, 0.9)),
    box((-0.7, -0.4, 0), (0.7, 0.4, 0.8)),
    room((-3, -3, 0), (3, 3, 3)),
)
TOWN = [box((x, y, 0), (x + 8, y + 8, 6)) for x in range(0, 100, 20) for y in range(0, 100, 20)]


def diagonal(*extent):
    return float(np.linalg.norm(extent))


# Houses of the town that are no direct neighbours of the one in its middle, which is the first here.
BEYOND = [k + (k < 12) for k in range(25) if abs(k // 5 - 2) + abs(k % 5 - 2) > 1]

# Baked objects, others, the size, and which are left out as far larger and as far away.
SCENES = {
    "a hut": (HUT, [], HUT_SIZE, [], []),
    "one object alone": ([ROOF], [], diagonal(4, 4, 0.2), [], []),
    "one plane alone": ([floor((0, 0), (2, 2))], [], diagonal(2, 2), [], []),
    "a sky and a horizon that are not baked": ([FLOOR], [ROOF, WALL, SKY, HORIZON], HUT_SIZE, [3, 4], []),
    "all baked with a sky and a horizon": ([*HUT, SKY, HORIZON], [], HUT_SIZE, [3, 4], []),
    "a stray object that is not baked": ([FLOOR], [ROOF, WALL, STRAY], HUT_SIZE, [], [3]),
    "a stray object that is baked": ([STRAY, *HUT], [], HUT_SIZE, [], [0]),
    "a room, baked with the cup in it": ([CUP, TABLE, ROOM], [], diagonal(6, 6, 3), [], []),
    "a cup on a table in a room": ([CUP], [TABLE, ROOM], diagonal(0.1, 0.1, 0.1), [1, 2], []),
    "a table with a cup in a room": ([TABLE], [CUP, ROOM], diagonal(6, 6, 3), [], []),
    "a town": (TOWN, [HORIZON], diagonal(88, 88, 6), [25], []),
    "a house of a town": (TOWN[12:13], [*TOWN[:12], *TOWN[13:]], diagonal(48, 48, 6), [], BEYOND),
}


@pytest.mark.parametrize("name", SCENES)
def test_size(name):
    baked, others, size, far_larger, astray = SCENES[name]
    s = scene(baked, others)
    found = scene_size(s.surfaces, s.patches)
    assert found.diagonal == pytest.approx(size, rel=1e-12)
    np.testing.assert_array_equal(found.far_larger, far_larger)
    np.testing.assert_array_equal(found.astray, astray)
    assert reach_of(s.surfaces, s.patches, BakeSettings()) == 0.2 * found.diagonal
    assert reach_of(s.surfaces, s.patches, BakeSettings(distance=3.0)) == 3.0
    assert s.bake(BakeSettings(1)).d_max == 0.2 * found.diagonal


@pytest.mark.parametrize("name", SCENES)
def test_the_order_of_objects_does_not_matter(name):
    baked, others, *_ = SCENES[name]
    one, other = scene(baked, others), scene(baked[::-1], others[::-1])
    assert scene_size(one.surfaces, one.patches).diagonal == scene_size(other.surfaces, other.patches).diagonal


@pytest.mark.parametrize("scale", [1e-3, 1e4])
@pytest.mark.parametrize("name", SCENES)
def test_it_scales_with_the_scene(name, scale):
    baked, others, *_ = SCENES[name]
    one, other = scene(baked, others), scene(*([m.moved(scale) for m in part] for part in (baked, others)))
    found = scene_size(other.surfaces, other.patches)
    assert found.diagonal == pytest.approx(scale * scene_size(one.surfaces, one.patches).diagonal, rel=1e-9)


def test_how_finely_objects_are_cut_does_not_matter():
    coarse = scene([floor((-3, -3), (3, 3)), ROOF, icosphere(1, 200.0)], [HORIZON])
    fine = scene([floor((-3, -3), (3, 3), 40, 40), box((-2, -2, 2.5), (2, 2, 2.7), 9), icosphere(1, 200.0)], [HORIZON])
    one, other = (scene_size(s.surfaces, s.patches) for s in (coarse, fine))
    assert one.diagonal == other.diagonal == pytest.approx(HUT_SIZE, rel=1e-12)


def test_objects_without_a_finite_triangle_do_not_count():
    nowhere = replace(ROOF, vertices=np.full_like(ROOF.vertices, np.nan))
    s = scene([*HUT, nowhere], [floor((9, 9), (9, 9))])
    assert scene_size(s.surfaces, s.patches).diagonal == pytest.approx(HUT_SIZE, rel=1e-12)
    nothing = replace(s.patches, corners=Patches.none().corners, patch=Patches.none().patch)
    assert np.isfinite(scene_size(s.surfaces, nothing).diagonal)


def test_a_sky_changes_nothing_under_a_roof():
    """Values of the floor, with the distance that is taken by itself."""
    alone = scene([FLOOR], [ROOF, WALL]).bake(BakeSettings(64)).grey
    for others in ([SKY], [HORIZON], [STRAY], [SKY, HORIZON, STRAY]):
        np.testing.assert_array_equal(scene([FLOOR], [ROOF, WALL, *others]).bake(BakeSettings(64)).grey, alone)


def test_what_follows_a_scene_takes_the_same_distance():
    objects = objects_of({"floor": FLOOR, "roof": ROOF, "sky": SKY})
    s = scene([FLOOR, ROOF, SKY])
    assert IncrementalBake(objects, BakeSettings(4)).held.d_max == s.bake(BakeSettings(4)).d_max
