"""Broken and awkward geometry: each case has a stated right answer."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.errors import GeometryError, SettingsError
from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene.solids import Shells
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from tests.core import closed_forms as exact
from tests.core.measuring import ROUNDING, SEEDS, SIGMAS, bakes, estimate
from tests.core.scenes import Mesh, Scene, box, floor, grid, icosphere, join, mesh, room, scene

pytestmark = pytest.mark.filterwarnings("error")  # no numpy warning may reach the user either

WALL = grid((0, -1, 0), (0, 3, 0), (0, 0, 1), 2, 2, (0.8, 0.2, 0.1))
GROUND = floor((0, 0), (1, 1), 5, 5, colour=(0.2, 0.6, 0.4))
SETTINGS = BakeSettings(distance=0.7)


def assert_defined(baked) -> None:
    assert np.isfinite(baked.coloured).all()
    assert np.isfinite(baked.grey).all()
    assert np.isfinite(baked.white).all()
    assert np.isfinite(baked.rmse).all()
    assert ((baked.grey >= 0.0) & (baked.grey <= 1.0 + 1e-6)).all()


DEFECTS = {
    "point": [(0.4, 0.4, 0.0)] * 3,
    "segment": [(0.4, 0.4, 0.0), (0.6, 0.4, 0.0), (0.5, 0.4, 0.0)],
    "needle": [(0.4, 0.4, 0.0), (0.6, 0.4, 0.0), (0.5, 0.4 + 1e-8, 0.0)],
    "speck": [(0.4, 0.4, 0.0), (0.4 + 1e-9, 0.4, 0.0), (0.4, 0.4 + 1e-9, 0.0)],
    "nan": [(0.4, 0.4, 0.0), (0.6, np.nan, 0.0), (0.5, 0.6, 0.0)],
    "inf": [(0.4, 0.4, 0.0), (np.inf, 0.4, 0.0), (0.5, 0.6, 0.0)],
    "-inf": [(0.4, 0.4, -np.inf), (0.6, 0.4, 0.0), (0.5, 0.6, 0.0)],
    "all nan": [(np.nan,) * 3] * 3,
}


@pytest.mark.parametrize("defect", DEFECTS)
@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_unusable_triangles_are_invalid_and_harm_no_other(defect, falloff):
    """Their patch is that of an open patch, marked invalid; all others keep every bit."""
    bad = mesh(DEFECTS[defect], [(0, 1, 2)], colour=(0.2, 0.6, 0.4))
    settings = replace(SETTINGS, falloff=falloff)
    with_bad, without = scene([GROUND, bad], [WALL]).bake(settings), scene([GROUND], [WALL]).bake(settings)
    assert_defined(with_bad)
    np.testing.assert_array_equal(with_bad.valid, [True] * 25 + [False])
    np.testing.assert_array_equal(with_bad.grey[:25], without.grey)
    np.testing.assert_allclose(with_bad.coloured[:25], without.coloured, rtol=0, atol=1e-9)  # the needle is in R_ave
    np.testing.assert_array_equal(with_bad.white[25], 1.0)


@pytest.mark.parametrize("defect", ["segment", "needle", "nan", "inf"])
def test_a_face_with_one_unusable_triangle_is_sampled_on_the_other(defect):
    """The value is that of the usable part alone."""
    part = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    alone = scene([mesh(part, [(0, 1, 2)])], [WALL]).bake(SETTINGS)
    both = scene([mesh([*part, *DEFECTS[defect]], [(0, 1, 2), (3, 4, 5)], [0, 0])], [WALL]).bake(SETTINGS)
    assert both.valid.all()
    np.testing.assert_array_equal(both.sums.valid, 1.0)
    # The triangle is the first cell of two; its half of the rays is noisier.
    assert both.grey[0] == pytest.approx(alone.grey[0], abs=5e-3)


def test_unusable_patches_take_the_value_of_their_neighbours():
    """The mean over the neighbours found at its nodes, and of all colours."""
    bad = mesh(DEFECTS["needle"], [(0, 1, 2)])
    s = scene([GROUND, bad], [WALL])
    patch, node = np.array([0, 1, 7, 25, 25]), np.array([0, 1, 2, 0, 1])
    baked = s.bake(SETTINGS, neighbours=(patch, node))
    np.testing.assert_allclose(baked.grey[25], baked.grey[[0, 1]].mean(), rtol=1e-12)
    np.testing.assert_allclose(baked.coloured[25], baked.coloured[[0, 1]].mean(0), rtol=1e-12)


@pytest.mark.parametrize("defect", ["needle", "all nan", "inf"])
def test_a_scene_of_unusable_triangles_only(defect):
    """Either there is no extent, and that is said, or the patches are those of an open plane, invalid."""
    s = scene([mesh(DEFECTS[defect], [(0, 1, 2)])])
    if defect == "all nan":
        with pytest.raises(GeometryError):
            s.bake()
        return
    baked = s.bake()
    assert_defined(baked)
    assert not baked.valid.any()
    np.testing.assert_array_equal(baked.white, 1.0)


def without_faces(vertices: int) -> Scene:
    m = mesh(np.zeros((vertices, 3)), [])
    return scene([m])


@pytest.mark.parametrize("vertices", [0, 5])
def test_nothing_to_bake_is_an_error(vertices):
    """An empty mesh, and a mesh without faces."""
    with pytest.raises(GeometryError, match="no face"):
        without_faces(vertices).bake()


def test_a_vertex_beyond_all_numbers_is_an_error():
    with pytest.raises(GeometryError, match="astray"):
        scene([GROUND, mesh([(1e300, 0, 0), (-1e300, 0, 0), (0, 1e300, 0)], [(0, 1, 2)])]).bake()


def test_a_vertex_far_astray_leaves_defined_values():
    """Beside a triangle of 1e30 metres the floor is lost in rounding: its patches are invalid, not undefined."""
    astray = mesh([(1e30, 0, 0), (-1e30, 0, 0), (0, 1e30, 0)], [(0, 1, 2)])
    baked = scene([GROUND, astray]).bake(SETTINGS)
    assert_defined(baked)
    np.testing.assert_array_equal(baked.valid, [False] * 25 + [True])


def test_faces_without_extent_are_an_error():
    with pytest.raises(GeometryError, match="no extent"):
        scene([mesh([(3, 3, 3)] * 3, [(0, 1, 2)])]).bake()


@pytest.mark.parametrize("vertices", [0, 5])
def test_meshes_without_faces_do_no_harm(vertices):
    """Beside others they change nothing but the bounding box, which is fixed here by the distance."""
    empty = mesh(np.zeros((vertices, 3)), [])
    one, two = scene([GROUND], [WALL, empty]).bake(SETTINGS), scene([GROUND], [WALL]).bake(SETTINGS)
    np.testing.assert_array_equal(one.grey, two.grey)


@pytest.mark.parametrize("brute", [True, False])
def test_one_face(brute):
    """A single triangle sees nothing: W = 1."""
    baked = scene([mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])]).bake(brute=brute)
    assert baked.grey[0] == 1.0
    assert baked.valid.all()


@pytest.mark.parametrize("falloff", list(Falloff))
def test_patches_without_any_surface_around(falloff):
    """Surfaces may be empty: all rays miss."""
    s = scene([GROUND])
    nothing = type(s.surfaces)(
        np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32), Shells.none(0), np.zeros(0, int)
    )
    for brute in (True, False):
        baked = replace(s, surfaces=nothing).bake(BakeSettings(distance=1.0, falloff=falloff), brute=brute)
        np.testing.assert_array_equal(baked.grey, 1.0)


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("others", [[], [box((0.3, 0.3, 0.0), (0.7, 0.7, 0.5), 2)]], ids=["open", "solid"])
@pytest.mark.parametrize("distance", [5e-324, 1e-300, 1e-38, 1e-12])
def test_tiny_distances(falloff, others, distance):
    """Nothing is that near: W = 1 and R_ave, with a warning that says so."""
    baked = scene([GROUND, WALL], others).bake(BakeSettings(distance=distance, falloff=falloff))
    assert_defined(baked)
    np.testing.assert_array_equal(baked.grey[baked.valid], 1.0)
    assert len(baked.warnings) == 1
    assert "too small" in baked.warnings[0]


@pytest.mark.parametrize("distance", [np.inf, 1e300, 1e31])
@pytest.mark.parametrize("falloff", [f for f in Falloff if f is not Falloff.STEP])
def test_infinite_distances(falloff, distance):
    """Relative to infinity every hit is at contact: W is the share of misses, as with STEP, and 0 in a closed room."""
    s = scene([GROUND], [WALL])
    baked = s.bake(BakeSettings(distance=distance, falloff=falloff))
    step = s.bake(BakeSettings(distance=np.inf, falloff=Falloff.STEP))
    np.testing.assert_allclose(baked.grey, step.grey, rtol=0, atol=1e-9)
    assert_defined(baked)
    assert baked.d_max == distance
    assert not baked.warnings
    closed = scene([room((0, 0, 0), (1, 1, 1), 2), box((0.3, 0.3, 0.1), (0.7, 0.7, 0.5))]).bake(
        BakeSettings(distance=distance, falloff=falloff)
    )
    assert closed.grey[closed.valid].max() < 1e-9


def test_zero_distance_is_an_error():
    with pytest.raises(SettingsError, match="distance"):
        BakeSettings(distance=0.0)


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_duplicate_faces(falloff):
    """Every face twice, in the same place: the values of single faces, bit for bit."""
    settings = replace(SETTINGS, falloff=falloff)
    single = scene([GROUND], [WALL]).bake(settings)
    ids = np.tile(np.arange(25, dtype=np.uint32), 2)
    double = scene([GROUND, GROUND], [WALL, WALL], ids=ids).bake(settings)
    np.testing.assert_array_equal(double.grey, np.tile(single.grey, 2))
    np.testing.assert_allclose(double.coloured, np.tile(single.coloured, (2, 1)), rtol=0, atol=1e-7)
    assert double.valid.all()


HALF_OFFSET = 0.25e-5  # metres, of a unit square baked alone: 1e-5 of its half side, halved


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("height", [0.0, 1e-8, HALF_OFFSET])
def test_decals_lower_than_the_ray_offset_shade_nothing(falloff, height):
    baked = scene([floor((0, 0), (1, 1))], [floor((-1, -1), (2, 2), z=height)]).bake(replace(SETTINGS, falloff=falloff))
    assert baked.grey[0] == 1.0


@pytest.mark.parametrize("offsets", [1.2, 2.0, 3.0])
def test_decals_a_few_ray_offsets_high(offsets):
    """A decal k offsets high lets rays pass that meet it within 4 offsets: those with cos > (k - 1) / 4."""
    decal = floor((-1, -1), (2, 2), z=2 * offsets * HALF_OFFSET)
    s = scene([floor((0, 0), (1, 1))], [decal])
    got = estimate(bakes(s, BakeSettings(1024, distance=1.0)))
    q, cosine = 2 * HALF_OFFSET * (offsets - 1.0), (offsets - 1.0) / 4.0
    shaded = 4.0 / 3.0 * np.sqrt(q) * cosine**1.5
    assert got.error[3] < 1e-3
    assert abs(got.mean[3] - (1.0 - cosine**2 + shaded)) < SIGMAS * got.error[3] + 1e-5


def test_opposite_faces_in_contact_do_occlude():
    """A ceiling 3 ray offsets above the floor, facing it: closed, not doubled."""
    baked = scene([GROUND], [floor((-1, -1), (2, 2), z=3e-5).flipped()]).bake(SETTINGS)
    assert baked.grey.max() < 0.05


def test_inside_out_normals():
    """A box with inward normals shows its inside: the values of a room, and all its patches are valid."""
    cube = box((0, 0, 0), (1, 1, 1), 3)
    inside_out = estimate(bakes(scene([cube.flipped()]), BakeSettings(distance=2.0, falloff=Falloff.LINEAR)))
    assert abs(inside_out.mean[3] - 4.0 / (6.0 * 2.0)) < SIGMAS * inside_out.error[3] + 4e-5
    outside = scene([cube]).bake()
    np.testing.assert_array_equal(outside.grey, 1.0)
    assert outside.valid.all()


def test_an_inside_out_neighbour_occludes_like_any_other():
    """The floor does not care which way the normals of a crate point."""
    crate = box((0.41, 0.41, 0.1), (0.79, 0.79, 0.5), 1, (0.9, 0.1, 0.1))
    proper, inverted = (scene([GROUND], [c]).bake(SETTINGS) for c in (crate, crate.flipped()))
    np.testing.assert_allclose(proper.grey, inverted.grey, rtol=0, atol=1e-6)
    np.testing.assert_allclose(proper.coloured, inverted.coloured, rtol=0, atol=1e-6)
    assert proper.grey.min() < 0.8


def test_a_mirrored_object():
    """Mirrored, with the order of corners reversed as Blender does, a scene has its original values."""
    mirror = np.diag([-1.0, 1.0, 1.0])
    meshes = [GROUND, box((0.21, 0.21, 0.0), (0.59, 0.59, 0.4), 2, (0.9, 0.1, 0.1)), WALL]
    original = scene(meshes)
    mirrored = scene([m.moved(mirror).flipped() for m in meshes])
    np.testing.assert_array_equal(original.surfaces.shells.solid, mirrored.surfaces.shells.solid)
    a, b = bakes(original, SETTINGS), bakes(mirrored, SETTINGS)
    one, two = estimate(a, original.area), estimate(b, original.area)
    assert (np.abs(one.mean - two.mean) < SIGMAS * np.hypot(one.error, two.error) + ROUNDING).all()
    error = np.sqrt((a.var(0, ddof=1) + b.var(0, ddof=1)) / SEEDS)
    assert (np.abs(a.mean(0) - b.mean(0)) < 6.0 * error + 1e-4).all()


def test_concave_n_gon():
    """An L-shaped face beside a wall: the mean over its true area, not over its convex hull."""
    outline = np.array([(0, 0, 0), (0.8, 0, 0), (0.8, 0.2, 0), (0.2, 0.2, 0), (0.2, 0.8, 0), (0, 0.8, 0)], float)
    l_shape = mesh(outline, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)], [0] * 4)
    assert l_shape.areas()[0] == pytest.approx(0.28)
    got = estimate(bakes(scene([l_shape], [WALL]), BakeSettings(256, distance=1.0)))
    near, far = (exact.strip(Falloff.SQRT, a, b) for a, b in ((0.0, 0.2), (0.2, 0.8)))
    mean = (0.16 * near + 0.12 * far) / 0.28
    hull = exact.strip(Falloff.SQRT, 0.0, 0.8)
    assert abs(mean - hull) > 20 * got.error[3]
    assert abs(got.mean[3] - mean) < SIGMAS * got.error[3] + ROUNDING


def folded(height: float) -> Mesh:
    """One quad, folded along its diagonal: its two corners off the diagonal are `height` above it."""
    return mesh([(0, 0, 0), (1, 0, height), (1, 1, 0), (0, 1, height)], [(0, 1, 2), (0, 2, 3)], [0, 0])


def test_a_quad_folded_as_a_ridge_sees_nothing_of_itself():
    baked = scene([folded(-0.5)]).bake(BakeSettings(1024, distance=np.inf, falloff=Falloff.STEP))
    assert baked.grey[0] == 1.0


def test_a_quad_folded_as_a_valley_sees_its_other_half():
    """STEP: one minus the form factor of one triangle to the other, by Lambert's formula and quadrature."""
    quad = folded(0.5)
    one, two = quad.corners()
    covers = [exact.mean_polygon_cover(a[None], b, 64) for a, b in ((one, two), (two, one))]
    values = bakes(scene([quad]), BakeSettings(1024, distance=np.inf, falloff=Falloff.STEP))[:, 0, 3]
    error = values.std(ddof=1) / np.sqrt(SEEDS)
    assert np.mean(covers) > 0.1
    assert abs(values.mean() - (1.0 - np.mean(covers))) < SIGMAS * error + 1e-4


def test_an_open_sheet_from_behind():
    """A sheet over the floor occludes and bleeds alike whichever side it shows, to rounding."""
    sheet = grid((0.1, 0.2, 0.3), (0.7, 0, 0.1), (0, 0.6, 0.0), 3, 3, colour=(0.9, 0.2, 0.1))
    front, back = (scene([GROUND], [s]).bake(SETTINGS) for s in (sheet.flipped(), sheet))
    np.testing.assert_allclose(front.coloured, back.coloured, rtol=0, atol=1e-6)
    assert front.grey.min() < 0.9


def test_both_sides_of_a_sheet_are_baked_apart():
    """The two faces of a doubled sheet, normals opposed, see only their own side."""
    sheet = floor((0, 0), (1, 1), 4, 4, z=0.5)
    below, above = sheet.flipped(), sheet
    ceiling = floor((-2, -2), (3, 3), z=0.75).flipped()
    baked = scene([above, below], [ceiling]).bake(SETTINGS)
    np.testing.assert_array_equal(baked.grey[16:], 1.0)
    assert baked.grey[:16].max() < 0.9


def test_a_needle_does_not_cast_a_shadow_beyond_its_width():
    """A usable sliver, 1e-5 wide, takes less than its share of any patch."""
    sliver = mesh([(0, 0.5, 0.2), (1, 0.5, 0.2), (1, 0.5 + 1e-5, 0.2)], [(0, 1, 2)])
    assert scene([GROUND], [sliver]).bake(SETTINGS).grey.min() > 0.98


def test_objects_out_of_reach_are_left_out_and_change_nothing():
    far = icosphere(1).moved(0.3, (0.5, 0.5, 4.0))
    asked = []

    def spy(vertices, triangles, progress):
        asked.append(len(triangles))
        return EmbreeIntersector(vertices, triangles, progress)

    one = scene([GROUND], [WALL]).bake(SETTINGS)
    two = scene([GROUND], [WALL, far]).bake(SETTINGS, intersector=spy)
    np.testing.assert_array_equal(one.grey, two.grey)
    assert asked == [len(GROUND.triangles) + len(WALL.triangles)]


def test_many_patches_share_few_point_sets_without_harm():
    """512 patches use 256 sets: the mean over an open floor beside nothing stays exact, beside a wall unbiased."""
    strip = floor((0, 0), (0.5, 64), 1, 512)
    got = estimate(
        bakes(scene([strip], [join([grid((0, -1.1, 0), (0, 66.2, 0), (0, 0, 1.1))])]), BakeSettings(16, distance=1.0))
    )
    assert abs(got.mean[3] - exact.strip(Falloff.SQRT, 0.0, 0.5)) < SIGMAS * got.error[3] + ROUNDING
