"""What must not matter: where the scene is, how it is turned, and in which unit it is measured."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from tests.core.measuring import SIGMAS, bakes, estimate
from tests.core.scenes import Scene, box, grid, room, rotation, scene

DISTANCE = 0.5


def furnished(scale=1.0, offset=(0.0, 0.0, 0.0)) -> Scene:
    """A room with a crate on its floor, a floating crate and a sheet; corners are multiples of 1/64."""
    meshes = [
        room((0, 0, 0), (1, 1, 1), 4, (0.3, 0.5, 0.7)),
        box((0.25, 0.1875, 0.0), (0.5, 0.4375, 0.375), 2, (0.8, 0.1, 0.1)),
        box((0.5625, 0.5, 0.25), (0.8125, 0.75, 0.5), 2, (0.2, 0.2, 0.9)),
        grid((0.625, 0.125, 0.5), (0.25, 0, 0.125), (0, 0.25, 0), colour=(0.1, 0.8, 0.2)),
    ]
    return scene([m.moved(scale, offset) for m in meshes])


def assert_equal(a, b, tolerance: float) -> None:
    np.testing.assert_array_equal(a.valid, b.valid)
    np.testing.assert_allclose(a.coloured, b.coloured, rtol=0, atol=tolerance)
    np.testing.assert_allclose(a.grey, b.grey, rtol=0, atol=tolerance)


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("offset", [(1e5, -2e5, 3e5), (-65536.0, 0, 7)])
def test_translation_by_a_representable_offset_changes_no_bit(falloff, offset):
    """1e5 scene sizes away, all corners still exact in float64."""
    settings = BakeSettings(32, distance=DISTANCE, falloff=falloff)
    assert_equal(furnished().bake(settings), furnished(offset=offset).bake(settings), 0.0)


@pytest.mark.parametrize("exponent", [-13, 17])
def test_scaling_by_a_power_of_two_changes_no_bit(exponent):
    one = furnished().bake(BakeSettings(32, distance=DISTANCE))
    other = furnished(2.0**exponent).bake(BakeSettings(32, distance=DISTANCE * 2.0**exponent))
    assert_equal(one, other, 0.0)
    assert other.d_max == one.d_max * 2.0**exponent


@pytest.mark.parametrize("scale", [1e-4, 1e-3, 0.1, 1e3, 1e5])
@pytest.mark.parametrize("away", [0.0, 1e5])
def test_any_scale_and_place(scale, away):
    """Uneven factors round the corners anew; values move by that rounding, and no ray changes its triangle."""
    one = furnished().bake(BakeSettings(32))
    other = furnished(scale, np.array([away, -0.7 * away, 0.3 * away]) * scale * 1.1).bake(BakeSettings(32))
    assert_equal(one, other, 1e-4)
    assert other.d_max == pytest.approx(one.d_max * scale, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_rotation(seed):
    """Turned scenes use other rays: patch means over seeds agree within their standard errors."""
    settings = BakeSettings(64, distance=DISTANCE)
    turn = rotation(seed)
    upright = furnished()
    turned = replace(
        upright,
        surfaces=replace(upright.surfaces, vertices=upright.surfaces.vertices @ turn.T),
        patches=replace(upright.patches, corners=upright.patches.corners @ turn.T),
    )
    a, b = bakes(upright, settings), bakes(turned, settings)
    difference = a.mean(0) - b.mean(0)
    deviation = np.sqrt((a.var(0, ddof=1) + b.var(0, ddof=1)) / len(a))
    one, two = estimate(a, upright.area), estimate(b, upright.area)
    assert (np.abs(one.mean - two.mean) < SIGMAS * np.hypot(one.error, two.error) + 1e-6).all()
    noisy = deviation > 1e-5
    # Over some 1,000 values the mean square of z is 1 (t with 30 degrees of freedom: 1.07) within a few percent.
    assert np.mean((difference[noisy] / deviation[noisy]) ** 2) < 1.25
    assert np.abs(difference[~noisy]).max(initial=0.0) < 1e-4
    assert noisy.mean() > 0.9


def test_units_of_the_white_scale():
    """white() and the error figures are free of units."""
    one, other = (furnished(k).bake(BakeSettings(32, distance=DISTANCE * k)) for k in (1.0, 1024.0))
    np.testing.assert_array_equal(one.white, other.white)
    np.testing.assert_array_equal(one.white_rmse, other.white_rmse)
