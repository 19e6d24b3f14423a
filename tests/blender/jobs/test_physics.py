"""Known obscurances through the whole of Blender: object, depsgraph, materials, bake, attribute."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from obscurance_addon.core.falloff import Falloff
from tests.blender.helpers import bake, baked, colors, floor, mean_over_seeds, new_object, sheet
from tests.core.closed_forms import planes, strip

pytestmark = pytest.mark.usefixtures("empty_scene")

FLOOR, OTHER = (0.9, 0.8, 0.7), (0.75, 0.4, 0.1)


def with_bleeding(grey, misses, r_ave):
    """W = R (W_rho - M) + R_ave M, when all that is seen has the one reflectance OTHER."""
    return np.array(OTHER) * (grey - misses) + r_ave * misses


def two_planes(height):
    """One square metre of floor below a ceiling that is wider than the reach of 1 m all round."""
    ob = floor(size=1.0, color=FLOOR)
    floor("Ceiling", size=3.5, z=height, color=OTHER)
    return ob


def wall_and_floor():
    """Strips of 0.25 m beside a wall which is longer and higher than the reach of 1 m."""
    ob = sheet("Floor", (0, -0.5, 0), (1.5, 0, 0), (0, 1, 0), 6, color=FLOOR)
    sheet("Wall", (0, -2, 0), (0, 4, 0), (0, 0, 1.5), color=OTHER)
    return ob, (1.5 * np.array(FLOOR) + 6.0 * np.array(OTHER)) / 7.5


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("height", [0.1, 0.5])
def test_two_parallel_planes(falloff, height):
    """Grey obscurances of a patch below an endless ceiling."""
    ob = two_planes(height)
    mean, tolerance = mean_over_seeds(
        lambda seed: baked(ob, rays=64, falloff=falloff, use_bleeding=False, seed=seed)[0]
    )
    assert (abs(mean - planes(falloff, height)) <= tolerance).all()


def test_two_parallel_planes_in_colour():
    """Each channel by itself, with R_ave the mean over both planes."""
    ob = two_planes(0.5)
    r_ave = (np.array(FLOOR) + 3.5**2 * np.array(OTHER)) / (1.0 + 3.5**2)
    assert bake(ob, rays=64).r_ave == pytest.approx(r_ave, rel=1e-6)
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, rays=64, scale="PAPER", seed=seed)[0])
    expected = with_bleeding(planes(Falloff.SQRT, 0.5), planes(Falloff.STEP, 0.5), r_ave)
    assert (abs(mean - expected) <= tolerance).all()


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.LINEAR, Falloff.STEP])
def test_strips_beside_a_wall(falloff):
    """Averages of each strip (theory, section 2.5); beyond the reach everything is open."""
    ob, _ = wall_and_floor()
    mean, tolerance = mean_over_seeds(
        lambda seed: baked(ob, rays=64, falloff=falloff, use_bleeding=False, seed=seed)[:, 0]
    )
    expected = [strip(falloff, 0.25 * i, 0.25 * (i + 1)) for i in range(6)]
    assert (abs(mean - expected) <= tolerance).all()
    assert np.allclose(mean[4:], 1.0, atol=1e-6)


def test_strips_beside_a_coloured_wall():
    """Three unlike channels, each with its own closed form: red, green and blue are not mixed up."""
    ob, r_ave = wall_and_floor()
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, rays=64, scale="PAPER", seed=seed))
    bounds = [(0.25 * i, 0.25 * (i + 1)) for i in range(6)]
    expected = [with_bleeding(strip(Falloff.SQRT, *b), strip(Falloff.STEP, *b), r_ave) for b in bounds]
    assert (abs(mean - expected) <= tolerance).all()


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_red_green_or_blue_wall_tints_what_is_near_it(channel, target):
    """On a white floor, the wall's own channel is the largest near it and all are equal out of its reach."""
    color = np.full(3, 0.05)
    color[channel] = 0.9
    ob = sheet("Floor", (0, 0, 0), (4, 0, 0), (0, 2, 0), 4, color=(0.9, 0.9, 0.9))
    sheet("Wall", (0, 0, 0), (0, 2, 0), (0, 0, 1), color=color)
    values = baked(ob, target=target, use_bleeding=True)
    at = ob.data.polygons if target == "FACE" else ob.data.loops if target == "CORNER" else ob.data.vertices
    x = np.array(
        [
            e.center.x if target == "FACE" else (ob.data.vertices[e.vertex_index] if target == "CORNER" else e).co.x
            for e in at
        ]
    )
    near, far = values[x == x.min()], values[x >= 2.0]
    others = [k for k in range(3) if k != channel]
    assert (near[:, channel, None] > near[:, others] + 0.01).all()
    assert np.allclose(far, 1.0, atol=1e-6)


# ---------------------------------------------------------------------------------------------------------- invariance

ROOF = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 1, 0.5)]
ROOF_FACES = [(0, 1, 4), (2, 1, 4)[::-1], (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)]


def among_others(make):
    """The roof that `make` builds, with a wall and a slanted sheet near it; all in an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sheet("Wall", (-2.25, -1, 0), (0, 4, 0), (0, 0, 1), color=OTHER)
    sheet("Slant", (-2, -1, 0.75), (3, 0, 0.5), (0, 2, 0.25), color=FLOOR)
    return make()


def test_a_mirrored_object_is_its_mirror_image():
    """Scale -1 gives the same bits as a mesh whose vertices are mirrored and whose faces are turned round."""

    def by_scale():
        ob = new_object("Roof", ROOF, ROOF_FACES)
        ob.scale = (-1.0, 1.0, 1.0)
        return ob

    def by_mesh():
        return new_object("Roof", [(-x, y, z) for x, y, z in ROOF], [f[::-1] for f in ROOF_FACES])

    assert np.array_equal(baked(among_others(by_scale)), baked(among_others(by_mesh)))
    assert baked(among_others(by_mesh)).min() < 0.95


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_an_exact_transform_may_be_applied(target):
    """Scale and place that float32 holds exactly: the same bits from the object's matrix and from moved vertices."""
    scale, offset = np.array([0.5, 1.0, 2.0]), np.array([-1.5, 0.25, 0.5])

    def by_matrix():
        ob = new_object("Roof", ROOF, ROOF_FACES)
        ob.matrix_world = Matrix.LocRotScale(offset, None, scale)
        return ob

    def by_mesh():
        return new_object("Roof", np.array(ROOF) * scale + offset, ROOF_FACES)

    found = baked(among_others(by_matrix), target=target)
    assert np.array_equal(found, baked(among_others(by_mesh), target=target))
    assert found.min() < 0.95


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_any_transform_may_be_applied(target):
    """Rotation, unequal scale and shear below a parent: equal up to rounding after Apply > All Transforms."""

    def posed():
        parent = bpy.data.objects.new("Parent", None)
        bpy.context.scene.collection.objects.link(parent)
        parent.scale = (1.0, 1.5, 0.75)
        ob = new_object("Roof", ROOF, ROOF_FACES)
        ob.parent = parent
        ob.rotation_euler, ob.location = (0.3, -0.2, 0.7), (-1.0, 0.5, 0.25)
        return ob

    def applied():
        ob = posed()
        bpy.context.view_layer.update()
        ob.data.transform(ob.matrix_world)
        ob.parent, ob.matrix_world = None, Matrix()
        return ob

    found = baked(among_others(posed), target=target)
    assert np.allclose(found, baked(among_others(applied), target=target), atol=1e-4)
    assert found.min() < 0.95


@pytest.mark.parametrize("distance", [1.0, None])
def test_size_does_not_matter(distance):
    """Everything and the reach four times as large: the same bits; the automatic reach grows by itself."""

    def scene(factor):
        ob = among_others(lambda: new_object("Roof", ROOF, ROOF_FACES))
        for each in bpy.context.scene.objects:
            each.scale = (factor,) * 3
        ob.location.x = -2.0 * factor
        bake(ob, distance=distance and factor * distance)
        return colors(ob)

    assert np.array_equal(scene(1.0), scene(4.0))
    assert scene(1.0).min() < 0.95


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_a_closed_room_of_one_colour_is_a_furnace(target):
    """All rays hit within reach, all colours are R: PAPER is R times grey, on every element."""
    size = 1.0
    vertices = [(x, y, z) for x in (0, size) for y in (0, size) for z in (0, size)]
    inwards = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    ob = new_object("Room", vertices, inwards, color=OTHER)
    grey = baked(ob, target=target, distance=3.0, use_bleeding=False)
    paper = baked(ob, target=target, distance=3.0, scale="PAPER")
    assert np.allclose(paper, grey * OTHER, atol=2e-6)
    assert grey.max() < 0.7


def test_the_mean_of_a_closed_room_is_the_mean_free_path():
    """Linear falloff, reach beyond the diagonal: the mean by area is 4 V / (S d_max), exactly (theory, section 2.7)."""
    vertices = [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]
    inwards = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    ob = new_object("Room", vertices, inwards)
    area = np.array([polygon.area for polygon in ob.data.polygons])

    def mean_by_area(seed):
        values = baked(ob, rays=64, distance=4.0, falloff="LINEAR", use_bleeding=False, seed=seed)
        return values[:, 0] @ area / area.sum()

    mean, tolerance = mean_over_seeds(mean_by_area)
    assert abs(mean - 4.0 * 6.0 / (22.0 * 4.0)) <= tolerance
