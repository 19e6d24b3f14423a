"""Surfaces that no ray meets, and surfaces whose colour nothing sees."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene.reflectance import mean_reflectance
from obscurance_addon.core.settings import BakeSettings
from tests.core.light.test_direct import agrees, irradiance
from tests.core.scenes import box, floor, grid, scene

FLOOR_COLOUR, CARD_COLOUR = (0.2, 0.4, 0.6), (0.8, 0.5, 0.1)
CARD = floor((-1, -1), (2, 2), z=0.1, colour=CARD_COLOUR)


def ground():
    return floor((0, 0), (1, 1), 4, 4, colour=FLOOR_COLOUR)


def of_others(s, n_baked, occludes=True, gives=True):
    """The scene with what is not baked, after its first `n_baked` triangles, as others meet and see it."""
    others = np.arange(len(s.surfaces.triangles)) >= n_baked
    surfaces = s.surfaces
    if not occludes:
        surfaces = replace(surfaces, occludes=~others)
    if not gives:
        reflectance, emission = surfaces.reflectance.copy(), surfaces.emission.copy()
        reflectance[others], emission[others] = np.nan, 0.0
        patch = np.where(others, -1, surfaces.patch).astype(np.int32)
        surfaces = replace(surfaces, reflectance=reflectance, emission=emission, patch=patch)
        n_patches = len(s.patches)
        materials = replace(s.materials, gives=np.arange(len(s.materials.reflectance)) < n_patches)
        return replace(s, surfaces=surfaces, materials=materials)
    return replace(s, surfaces=surfaces)


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("others", [[CARD], [box((0.2, 0.2, 0.1), (0.8, 0.8, 0.5))]])
def test_what_does_not_occlude_leaves_a_floor_open(falloff, others):
    """Sheets and solids alike; nothing is left for rays to meet but the floor itself."""
    s = of_others(scene([ground()], others), 32, occludes=False)
    found = s.bake(BakeSettings(64, distance=1.0, falloff=falloff))
    assert (found.grey == 1.0).all()
    assert (found.white == 1.0).all()


def test_what_does_not_occlude_counts_in_the_mean_reflectance():
    """Diffuse rays see it, so that what is far away has its colour too: areas 1 and 9."""
    found = of_others(scene([ground()], [CARD]), 32, occludes=False).bake(BakeSettings(16, distance=1.0))
    np.testing.assert_allclose(found.r_ave, (np.array(FLOOR_COLOUR) + 9.0 * np.array(CARD_COLOUR)) / 10.0, rtol=1e-6)


def test_nothing_that_rays_could_meet():
    """Even the floor itself."""
    s = scene([ground()])
    s = replace(s, surfaces=replace(s.surfaces, occludes=np.zeros(32, bool)))
    assert (s.bake(BakeSettings(16)).white == 1.0).all()


def test_a_colour_that_nothing_sees_is_black_and_leaves_the_mean():
    """Eq. 5 with R = 0 at the card and R_ave of the floor alone; without colours it occludes as any card."""
    settings = BakeSettings(64, distance=1.0, falloff=Falloff.LINEAR)
    seen = scene([ground()], [CARD]).bake(settings)
    unseen = of_others(scene([ground()], [CARD]), 32, gives=False).bake(settings)
    np.testing.assert_array_equal(unseen.grey, seen.grey)
    np.testing.assert_allclose(unseen.r_ave, FLOOR_COLOUR, rtol=1e-6)
    np.testing.assert_allclose(unseen.coloured, unseen.sums.miss[:, None] * unseen.r_ave, rtol=1e-12)
    assert 0.0 < unseen.coloured.max() < 0.02


def test_hidden_patches_whose_colour_nothing_sees_are_not_taken_from_the_mean():
    """They never were in it."""
    surfaces = scene([ground(), CARD]).surfaces
    reflectance = surfaces.reflectance.copy()
    reflectance[32:] = np.nan
    exposed, area = np.ones(17), np.r_[np.full(16, 1 / 16), 9.0]
    exposed[16] = 0.25
    patches = np.tile(np.array(FLOOR_COLOUR), (17, 1))
    patches[16] = np.nan
    found = mean_reflectance(replace(surfaces, reflectance=reflectance), area, exposed, patches)
    np.testing.assert_allclose(found, FLOOR_COLOUR, rtol=1e-6)


# ------------------------------------------------------------------------------------------------------------- light


def lit_plane():
    return floor((-1, -1), (1, 1), 8, 8, colour=(1.0, 1.0, 1.0))


def lamp_sheet(size=0.5, z=0.4):
    """Looks down, exitance pi."""
    sheet = grid((-size, -size, z), (0, 2 * size, 0), (2 * size, 0, 0))
    return sheet.shining((np.pi, np.pi, np.pi))


@pytest.mark.parametrize("size", [0.02, 0.5, 5.0])
def test_what_shines_without_occluding_lights_as_if_it_occluded(size):
    """Small or large: points on it and rays that meet it share the work where it is met, points do it all where not."""
    s = scene([lit_plane()], [lamp_sheet(size)])
    met, _ = irradiance(s, rays=1024)
    found = irradiance(of_others(s, 128, occludes=False), rays=1024)
    assert met.max() > 0.005
    assert agrees(found, met, 0.01)


def test_what_shines_without_occluding_lets_the_light_above_it_pass():
    """A sheet below a larger and equal one: both are seen whole, so what they add up to is the sum."""
    low, high = lamp_sheet(0.3, 0.4), lamp_sheet(0.6, 0.8)
    one, other = (irradiance(scene([lit_plane()], [sheet]), rays=1024)[0] for sheet in (low, high))
    s = scene([lit_plane()], [low, high])
    occludes = np.ones(len(s.surfaces.triangles), bool)
    occludes[128:130] = False
    s = replace(s, surfaces=replace(s.surfaces, occludes=occludes))
    assert agrees(irradiance(s, rays=1024), one + other, 0.01)


def test_what_nothing_sees_does_not_shine():
    s = of_others(scene([lit_plane()], [lamp_sheet()]), 128, gives=False)
    assert (s.bake_light("DIRECT", (), BakeSettings(64)).radiance == 0.0).all()


@pytest.mark.parametrize("quantity", ["AMBIENT", "RADIOSITY"])
def test_what_nothing_sees_passes_no_light_on(quantity):
    """A white wall beside a floor below the sky lights it, unless its colour is seen by nothing."""
    settings = BakeSettings(64, distance=1.0)
    wall = grid((0, -1, 0), (0, 3, 0), (0, 0, 1), colour=(0.9, 0.9, 0.9))
    s = scene([ground()], [wall])
    extra = {"indirect_only": True} if quantity == "RADIOSITY" else {}
    seen = s.bake_light(quantity, (), settings, world=(1.0, 1.0, 1.0), **extra).radiance
    unseen = of_others(s, 32, gives=False).bake_light(quantity, (), settings, world=(1.0, 1.0, 1.0), **extra).radiance
    assert seen.min() > 0.0
    if quantity == "RADIOSITY":  # nothing else is there to scatter
        assert (unseen == 0.0).all()
    else:
        assert unseen.sum() < 0.5 * seen.sum()
