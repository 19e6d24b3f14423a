"""Form factors to triangles against closed forms, and sums of them against what must be conserved."""

import numpy as np
import pytest

from obscurance_addon.core.light.form_factors import triangle_form_factors
from tests.core.scenes import box, icosphere, rotation

UP = np.array([0.0, 0.0, 1.0])
# Rectangles a x b at height h = 1 with a corner above the point: closed form, evaluated to ten digits.
ABOVE = {(1, 1): 0.1385316060, (0.5, 0.5): 0.0598641176, (2, 1): 0.1673750099, (3, 3): 0.2292204334}
# Walls of height a and width b from the point's foot, at distance c.
WALL = {(1, 1, 1): 0.0557341970, (2, 1, 0.5): 0.1587748045, (1, 3, 0.25): 0.1889088605}


def of_quad(corners, point=(0.0, 0.0, 0.0), normal=UP):
    """Form factor to a quadrilateral, as its two triangles."""
    corners = np.asarray(corners, float)
    triangles = np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]])
    return triangle_form_factors(np.tile(point, (2, 1)), np.tile(normal, (2, 1)), triangles).sum()


@pytest.mark.parametrize("size", ABOVE)
def test_rectangle_above(size):
    a, b = size
    assert of_quad([(0, 0, 1), (0, b, 1), (a, b, 1), (a, 0, 1)]) == pytest.approx(ABOVE[size], abs=1e-10)


@pytest.mark.parametrize("size", WALL)
@pytest.mark.parametrize("below", [0.0, 1e-9, 0.3, 7.0])
def test_wall_however_far_it_reaches_below_the_horizon(size, below):
    a, b, c = size
    quad = [(c, 0, -below), (c, 0, a), (c, b, a), (c, b, -below)]
    assert of_quad(quad) == pytest.approx(WALL[size], abs=1e-9)


def test_backs_and_what_is_below_the_horizon_have_none():
    front = np.array([[(0, 0, 1), (0, 1, 1), (1, 0, 1)]], float)
    point, normal = np.zeros((1, 3)), UP[None]
    assert triangle_form_factors(point, normal, front) > 0.05
    assert triangle_form_factors(point, normal, front[:, ::-1]) == 0.0
    assert triangle_form_factors(point, -normal, front) == 0.0
    assert triangle_form_factors(point, normal, front - (0, 0, 2))[0] == 0.0


def test_triangles_in_the_plane_of_the_point_or_without_area_have_none():
    point, normal = np.zeros((1, 3)), UP[None]
    for corners in ([(1, 0, 0), (2, 0, 0), (1, 1, 0)], [(1, 0, 1)] * 3, [(0, 0, 0), (1, 0, 1), (0, 1, 1)]):
        for triangle in (corners, corners[::-1]):
            factor = triangle_form_factors(point, normal, np.array([triangle], float))
            assert np.isfinite(factor).all()
            assert factor == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_what_encloses_a_point_covers_its_hemisphere(seed):
    """Sum 1 from any point and normal within a closed surface seen from inside, wherever the horizon cuts it."""
    random = np.random.default_rng(seed)
    for mesh in (box((-1, -1, -1), (1, 1, 1), 3), icosphere(2)):
        corners = mesh.flipped().corners() @ rotation(seed).T
        point = random.uniform(-0.5, 0.5, 3)
        n = len(corners)
        normal = rotation(seed + 100)[0]
        total = triangle_form_factors(np.tile(point, (n, 1)), np.tile(normal, (n, 1)), corners).sum()
        assert total == pytest.approx(1.0, abs=1e-12)


def test_parts_add_up_to_the_whole():
    """Four quarters of a triangle that the horizon cuts, for 500 random ones."""
    random = np.random.default_rng(3)
    corners = random.normal(size=(500, 3, 3))
    a, b, c = corners.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    point, normal = np.zeros((500, 3)), np.tile(UP, (500, 1))
    whole = triangle_form_factors(point, normal, corners)
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    parts = sum(triangle_form_factors(point, normal, np.stack(q, 1)) for q in quarters)
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-12)
    assert np.count_nonzero(whole) > 150
