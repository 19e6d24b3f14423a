"""The white layer: exactly 1 where nothing is near, near 1 whatever stands around, and continuous in all of it."""

import numpy as np
import pytest

from obscurance_addon.core.obscurance.white import MOST_BRIGHTER, white_hits, white_warnings
from obscurance_addon.core.scene.reflectance import HALF_SCATTERING, LUMINANCE
from obscurance_addon.core.settings import BakeSettings
from tests.core.obscurance.everyday_scenes import EVERYDAY, emissive_dome, lawn, red_ground, studio
from tests.core.scenes import floor, grid, scene

RAYS = 64


def hits(brightness, rho=0.5, reference=0.4):
    """Hits of one rho each, whose colours are so many times the reference."""
    brightness = np.atleast_1d(brightness)
    return np.column_stack([*[rho * reference * brightness] * 3, np.full(len(brightness), rho)])


@pytest.mark.parametrize("make", EVERYDAY)
def test_everyday_scenes_stay_near_1(make):
    """No face above 3 in any channel, and no more than one in 50 above 1.2."""
    everyday = make()
    s = everyday.scene()
    baked = s.bake(BakeSettings(RAYS, distance=everyday.reach), patch_reflectance=s.patch_reflectance)
    assert baked.white.max() < 1.5
    assert (baked.white.max(1) > 1.2).mean() < 0.02
    assert (baked.white <= (1.0 + MOST_BRIGHTER) * baked.grey[:, None] + 1e-9).all()
    is_open = baked.sums.miss == 1.0
    assert is_open.any()
    np.testing.assert_array_equal(baked.white[is_open], 1.0)


def test_the_ground_tints_nothing_that_is_out_of_its_reach():
    """Faces of a white house that see white ones only stay grey, however green the lawn is."""
    everyday = lawn()
    baked = everyday.scene().bake(BakeSettings(RAYS, distance=everyday.reach))
    hit = baked.sums.hit[:, :3]
    sees_grey = (np.ptp(hit, axis=1) < 1e-9) & (hit[:, 0] > 0.01)
    assert np.count_nonzero(sees_grey) > 10
    np.testing.assert_allclose(np.ptp(baked.white[sees_grey], axis=1), 0.0, atol=1e-9)


def test_darker_surroundings_are_linear_and_brighter_ones_bounded():
    """Up to the reference a hit counts by its colour; beyond it, the more it is above, the less it adds, up to 2."""
    dark = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(white_hits(hits(dark), 0.4)[:, 1], 0.5 * dark, rtol=1e-12, atol=1e-15)
    bright = np.array([1.0, 1.5, 3.0, 30.0, 1e9])
    np.testing.assert_allclose(white_hits(hits(bright), 0.4)[:, 1], 0.5 * (2.0 - np.exp(1.0 - bright)), rtol=1e-12)


def test_it_rises_with_what_is_hit_and_falls_with_the_reference():
    """Without a jump: the slope is at most that of the linear part."""
    brightness = np.linspace(0.0, 8.0, 801)
    values = white_hits(hits(brightness), 0.4)[:, 0]
    assert (np.diff(values) > 0.0).all()
    assert np.diff(values).max() <= 0.5 * 0.01 * (1.0 + 1e-9)
    over = [white_hits(hits(1.0), reference)[0, 0] for reference in np.geomspace(1e-6, 10.0, 200)]
    assert (np.diff(over) <= 0.0).all()
    assert over[0] == pytest.approx(0.5 * (1.0 + MOST_BRIGHTER))


def test_channels_do_not_meet():
    """Each depends on its own colour alone, so that the hue of what is near stays."""
    one, other = np.array([[0.1, 0.2, 0.0, 0.5]]), np.array([[0.1, 0.5, 0.4, 0.5]])
    assert white_hits(one, 0.4)[0, 0] == white_hits(other, 0.4)[0, 0]
    assert white_hits(one, 0.4)[0, 2] == 0.0


@pytest.mark.parametrize("r", [0.02, 0.3, 0.8])
def test_one_grey_everywhere_is_the_obscurance_without_colour(r):
    s = scene([floor((0, 0), (1, 1), 6, 6, colour=(r,) * 3)], [grid((0, -1, 0), (0, 3, 0), (0, 0, 1), colour=(r,) * 3)])
    baked = s.bake(BakeSettings(RAYS, distance=0.7))
    np.testing.assert_allclose(baked.white, baked.grey[:, None].repeat(3, 1), rtol=0, atol=1e-6)
    np.testing.assert_allclose(baked.white_rmse, baked.grey_rmse, rtol=1e-4)


def test_what_it_relates_to_is_weighed_by_area_and_brightness():
    """The same whether surfaces are baked or not."""
    one, other = floor((0, 0), (2, 1), 3, 3, colour=(0.9, 0.3, 0)), floor((5, 5), (6, 6), colour=(0, 0.02, 0.04))
    colours = np.array([(0.9, 0.3, 0), (0, 0.02, 0.04)])
    weight = np.array([2.0, 1.0]) * 1.0 / (1.0 + (HALF_SCATTERING / (colours @ LUMINANCE)) ** 2)
    for s in (scene([one, other]), scene([one], [other])):
        np.testing.assert_allclose(s.bake().scattering, weight @ colours / weight.sum(), rtol=1e-6)


def test_a_sky_that_begins_to_scatter_changes_little():
    """Continuous where it was black, although it is 180 times as large as all else."""
    everyday = emissive_dome()
    *things, sky = everyday.meshes
    settings = BakeSettings(RAYS, distance=everyday.reach)
    black = scene(things, [sky]).bake(settings).white
    for r, most in ((1e-6, 1e-4), (1e-4, 1e-2)):
        nearly = scene(things, [sky.coloured((r,) * 3)]).bake(settings).white
        assert 0.0 < np.abs(nearly - black).max() < most


def test_notes_name_the_channels_that_are_missing():
    red = white_warnings(scene(red_ground().meshes).bake(BakeSettings(1, distance=0.1)).scattering)
    assert len(red) == 1
    assert "no green and blue light" in red[0]
    assert "color bleeding" in red[0]
    assert white_warnings(scene(studio().meshes).bake(BakeSettings(1, distance=0.1)).scattering) == []
    assert "no surface reflects" in white_warnings(np.zeros(3))[0]
