"""Colour: linear in the occluder's colour, R_ave weighed by area, and the white display scale."""

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene.reflectance import mean_reflectance
from obscurance_addon.core.scene.solids import Shells
from obscurance_addon.core.settings import BakeSettings
from tests.core.scenes import box, floor, grid, room, scene

EPS = np.finfo(np.float64).eps
RED = (0.8, 0.1, 0.0)


def beside_a_wall(wall_colour, floor_colour=(0.3, 0.4, 0.5)):
    ground = floor((0, 0), (1, 1), 6, 6, colour=floor_colour)
    return scene([ground], [grid((0, -1, 0), (0, 3, 0), (0, 0, 1), colour=wall_colour)])


@pytest.mark.parametrize("falloff", list(Falloff))
def test_one_occluder_colour(falloff):
    """W = R (W_rho - M) + R_ave M patch by patch, with M the share of misses."""
    baked = beside_a_wall(RED).bake(BakeSettings(distance=0.7, falloff=falloff))
    miss = baked.sums.miss[:, None]
    expected = np.float32(RED) * (baked.grey[:, None] - miss) + baked.r_ave * miss
    assert 0.4 < baked.grey.min() < baked.grey.max() == 1.0
    np.testing.assert_allclose(baked.coloured, expected, rtol=0, atol=1e-6)


def test_linear_in_the_colour_of_the_occluder():
    """Hit sums of the mean of two colours are the mean of their hit sums; misses do not change."""
    one, two, mean = (
        beside_a_wall(c).bake(BakeSettings(distance=0.7)).sums for c in ((0.2, 0.9, 0), (0.6, 0.1, 1), (0.4, 0.5, 0.5))
    )
    np.testing.assert_allclose(mean.hit[:, :3], 0.5 * (one.hit + two.hit)[:, :3], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(mean.miss, one.miss)


def test_hits_of_several_colours_keep_their_channels_apart():
    """A red wall on one side and a blue one on the other: each channel is that of a bake with the other wall black."""
    ground = floor((0, 0), (1, 1), 5, 5)
    left = grid((0, -1, 0), (0, 3, 0), (0, 0, 1))
    right = left.moved(offset=(1, 0, 0))

    def hits(a, b):
        return scene([ground], [left.coloured(a), right.coloured(b)]).bake(BakeSettings(distance=0.8)).sums.hit

    both, red, blue = hits((1, 0, 0), (0, 0, 1)), hits((1, 0, 0), (0, 0, 0)), hits((0, 0, 0), (0, 0, 1))
    np.testing.assert_array_equal(both[:, 1], 0.0)
    np.testing.assert_array_equal(both[:, 0], red[:, 0])
    np.testing.assert_array_equal(both[:, 2], blue[:, 2])
    np.testing.assert_allclose(both[:, 0] + both[:, 2], both[:, 3], atol=1e-6)


def test_without_bleeding_all_channels_are_grey():
    """The same rays give the same grey values with and without colour."""
    coloured, grey = (beside_a_wall(RED).bake(BakeSettings(distance=0.7, use_bleeding=b)) for b in (True, False))
    np.testing.assert_array_equal(grey.coloured, np.repeat(grey.grey[:, None], 3, axis=1))
    np.testing.assert_allclose(grey.grey, coloured.grey, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(grey.white, grey.coloured)


def test_r_ave_is_weighed_by_area():
    """Surfaces count by their area whether they are baked or only in the way."""
    s = scene([floor((0, 0), (2, 1), 3, 3, colour=(0.9, 0.3, 0))], [floor((5, 5), (6, 6), z=3, colour=(0, 0.6, 1))])
    r_ave = s.bake(patch_reflectance=s.patch_reflectance).r_ave
    np.testing.assert_allclose(r_ave, [0.6, 0.4, 1 / 3], rtol=1e-6)


def test_r_ave_leaves_out_what_lies_inside_of_solids():
    """The lower quarter of a white post in a big black box adds nothing; without patch colours it would."""
    outer, post = box((0, 0, 0), (2, 2, 2), 2, (0.1,) * 3), box((0.8, 0.8, 1.5), (1.2, 1.2, 3.5), 4, (0.9,) * 3)
    s = scene([outer, post])
    hidden = s.bake(patch_reflectance=s.patch_reflectance).r_ave
    # The top of the black box lacks nothing of its own: the post's cross-section stands for what it covers.
    np.testing.assert_allclose(hidden, ((24 - 0.16) * 0.1 + (0.16 + 4 * 0.4 * 1.5) * 0.9) / (24 + 2.4), rtol=5e-3)
    np.testing.assert_allclose(s.bake().r_ave, (24 * 0.1 + (0.32 + 3.2) * 0.9) / 27.52, rtol=1e-6)


def test_r_ave_of_nothing_is_defined():
    s = scene([floor((0, 0), (1, 1))])
    no_area = type(s.surfaces)(
        np.zeros((3, 3)), s.surfaces.triangles[:1] * 0, np.ones((1, 3), np.float32), Shells.none(1)
    )
    np.testing.assert_array_equal(mean_reflectance(no_area, np.zeros(1), np.ones(1), None), 0.0)


@pytest.mark.parametrize("rays", [1, 3, 64, 100])
@pytest.mark.parametrize("colour", [(1 / 49, 0.3, 0.7), (0.1, 1 / 3, 0.9)])
def test_white_makes_open_patches_exactly_1(rays, colour):
    """White of a patch whose rays all miss is 1.0, not nearly 1.0, for any number of rays and of triangles."""
    ground = floor((0, 0), (1, 1), 7, 7, colour=colour).moved(np.array([[1, 0.3, 0], [0, 1, 0.1], [0.2, 0, 1.0]]))
    baked = scene([ground]).bake(BakeSettings(rays=rays))
    np.testing.assert_array_equal(baked.white, 1.0)
    np.testing.assert_array_equal(baked.grey, 1.0)


def test_what_light_relates_to_is_the_paper_value_of_an_open_patch():
    """W / R_ave, and eq. 2 in a channel without any reflectance."""
    baked = beside_a_wall((0, 0.5, 0), (0, 0.5, 1.0)).bake(BakeSettings(distance=0.7))
    assert baked.r_ave[0] == 0.0
    for found, w, grey in (
        (baked.relative(), baked.coloured, baked.grey),
        (baked.relative_again(), baked.repeated[:, :3], baked.repeated[:, 3]),
    ):
        np.testing.assert_array_equal(found[:, 0], grey)
        np.testing.assert_allclose(found[:, 1:], w[:, 1:] / baked.r_ave[1:], rtol=4 * EPS)


@pytest.mark.parametrize("r", [0.0, 1.0])
def test_black_and_white_scenes(r):
    """R = 0: nothing comes back, W = 0, white() = grey. R = 1: colour adds nothing, W = grey."""
    s = scene([room((0, 0, 0), (1, 1, 1), 3, (r, r, r))])
    baked = s.bake(BakeSettings(distance=0.4))
    np.testing.assert_allclose(baked.coloured, r * baked.grey[:, None].repeat(3, 1), rtol=0, atol=1e-6)
    np.testing.assert_allclose(baked.r_ave, r, rtol=1e-14)
    np.testing.assert_allclose(baked.white, baked.grey[:, None].repeat(3, 1), rtol=0, atol=1e-6)
    assert np.isfinite(baked.white_rmse).all()
