"""Light through transparent surfaces, in closed form: shadows of lamps, the world, shining faces, solids."""

from __future__ import annotations

import numpy as np
import pytest

from obscurance_addon.core.light.lamps import PointLamp, SunLamp
from obscurance_addon.core.settings import BakeSettings
from tests.core.scenes import box, floor, scene

UP, ONE, WHITE = np.array([0.0, 0.0, 1.0]), np.ones(3), (1.0, 1.0, 1.0)
RED = np.array([1.0, 0.5, 0.25])


def ground():
    return floor((-0.5, -0.5), (0.5, 0.5), 2, 2).coloured(WHITE)


def card(z, transmission, lookup=None):
    return floor((-9, -9), (9, 9), z=z).coloured((0.0, 0.0, 0.0)).letting_through(transmission, lookup)


def irradiance(baked, others, lamps=(), rays=256, **kw):
    return scene(baked, others).bake_light("DIRECT", lamps, BakeSettings(rays), **kw).radiance * np.pi


def halves(triangles, places):
    """Clear where x < 0 on a card of two triangles (a, b, c) and (a, c, d), opaque elsewhere."""
    x = np.where(triangles == 0, places[:, 0] * -9 + places[:, 1] * 9 + places[:, 2] * 9, 0.0)
    x += np.where(triangles == 1, places[:, 0] * -9 + places[:, 1] * 9 + places[:, 2] * -9, 0.0)
    return np.repeat((x < 0.0).astype(np.float32)[:, None], 3, axis=1)


@pytest.mark.parametrize("count", [1, 3, 30])
@pytest.mark.parametrize(
    "lamp", [SunLamp("Sun", UP, ONE), PointLamp("Point", np.array([0.0, 0.0, 2.0]), ONE)], ids=["sun", "point"]
)
def test_each_card_filters_the_light_of_lamps(lamp, count):
    bare = irradiance([ground()], [], [lamp])
    filtered = irradiance([ground()], [card(z, RED**0.5) for z in np.linspace(0.2, 1.0, count)], [lamp])
    assert bare.min() > 0.2
    share = RED ** (0.5 * count)
    share[share < 1e-3] = 0.0
    np.testing.assert_allclose(filtered, bare * share, rtol=2e-5, atol=1e-3)


def test_what_lies_behind_the_lamp_casts_no_shadow():
    lamp = PointLamp("Point", np.array([0.0, 0.0, 0.5]), ONE)
    others = [card(0.3, 0.5), card(0.7, 0.1), floor((-9, -9), (9, 9), z=0.9).flipped().coloured((0.0, 0.0, 0.0))]
    bare = irradiance([ground()], [], [lamp])
    assert bare.min() > 0.2
    np.testing.assert_allclose(irradiance([ground()], others, [lamp]), 0.5 * bare, rtol=2e-5)


def test_an_opaque_surface_behind_a_card_casts_its_whole_shadow():
    lamp = SunLamp("Sun", UP, ONE)
    assert not irradiance([ground()], [card(0.3, 0.5), card(0.6, 0.0)], [lamp]).any()


def test_cut_outs_are_looked_up_where_rays_pass():
    lit = irradiance([ground()], [card(0.3, 0.5, halves)], [SunLamp("Sun", UP, ONE)])
    np.testing.assert_allclose(lit[[0, 2]], 1.0, rtol=1e-5)
    np.testing.assert_allclose(lit[[1, 3]], 0.0, atol=1e-6)


def test_world_and_shining_faces_through_a_filter():
    """The sky comes through two cards; of a shining face behind one, what that lets through."""
    sky = irradiance([ground()], [card(0.3, RED), card(0.31, 0.5)], world=ONE, rays=1024)
    np.testing.assert_allclose(sky, np.broadcast_to(np.pi * 0.5 * RED, (4, 3)), rtol=2e-2)
    lamp = floor((-0.3, -0.3), (0.3, 0.3), z=1.0).flipped().coloured((0.0, 0.0, 0.0)).shining(ONE)
    bare, filtered = (irradiance([ground()], [lamp, *cards], rays=4096) for cards in ([], [card(0.5, RED)]))
    np.testing.assert_allclose(filtered, bare * RED, rtol=1e-2)


def test_a_patch_half_inside_of_a_solid_behind_a_card():
    """The hidden half is left out as without the card, and the other one gets half of the light."""
    strip = floor((-1, -1), (1, 1)).coloured(WHITE)
    block, lamp = box((0.0, -2.0, -1.0), (2.0, 2.0, 0.25)), SunLamp("Sun", UP, ONE)
    bare, behind = (irradiance([strip], [block, *cards], [lamp], 1024) for cards in ([], [card(0.5, 0.5)]))
    np.testing.assert_allclose(bare, 1.0, rtol=1e-3)
    np.testing.assert_allclose(behind, 0.5, rtol=1e-3)


@pytest.mark.parametrize("reflectors", [0, 8])
def test_cards_that_let_all_through_change_no_light(reflectors):
    """Nor do they count as area that receives ambient light, or as something that closes the scene."""
    lamp = SunLamp("Sun", np.array([0.6, 0.0, 0.8]), ONE)
    bodies = [ground(), box((0.1, -0.3, 0.0), (0.3, 0.3, 0.5)).coloured((0.5, 0.5, 0.5))]
    settings = BakeSettings(256, distance=1.0)
    bare, with_card = (
        scene(bodies, cards).bake_light("COMBINED", [lamp], settings, reflectors=reflectors)
        for cards in ([], [card(0.7, 1.0).moved(0.1, (0.0, 0.0, 0.6))])
    )
    assert bare.radiance.mean() > 0.05
    np.testing.assert_allclose(with_card.radiance, bare.radiance, rtol=0.01, atol=1e-3)
    assert with_card.ambient.openness == pytest.approx(bare.ambient.openness, abs=0.01)
