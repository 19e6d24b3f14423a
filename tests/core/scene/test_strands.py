"""Tubes for hair and balls for points cover as much of any view, in the mean, as what they stand for."""

import numpy as np
import pytest

from obscurance_addon.core.scene.patches import triangle_areas
from obscurance_addon.core.scene.solids import find_shells
from obscurance_addon.core.scene.strands import balls, thinned, tubes


def shadow(vertices, triangles, direction):
    """Area that convex closed triangles cover along a direction: half of what all of them project to."""
    a, b, c = (vertices[corner] for corner in triangles.T)
    return 0.5 * np.abs(0.5 * np.cross(b - a, c - a) @ direction).sum()


def test_a_ball_has_the_surface_of_a_sphere_and_encloses_its_point():
    """Cauchy: the mean shadow is a quarter of the surface, that of a sphere of radius r is pi r^2."""
    centres, radius = np.array([[1.0, 2.0, 3.0], [-4.0, 0.0, 0.5]]), np.array([0.5, 2.0])
    vertices, triangles = balls(centres, radius)
    assert len(triangles) == 40
    assert find_shells(vertices, triangles)[0].solid.all()
    for i in range(2):
        own = triangles[20 * i : 20 * i + 20]
        assert triangle_areas(vertices[own]).sum() == pytest.approx(4.0 * np.pi * radius[i] ** 2, rel=1e-12)
        assert np.allclose(vertices[np.unique(own)].mean(0), centres[i])
        directions = np.random.default_rng(i).normal(size=(4000, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        mean = np.mean([shadow(vertices, own, d) for d in directions])
        assert mean == pytest.approx(np.pi * radius[i] ** 2, rel=0.005)


@pytest.mark.parametrize("turned", range(6))
def test_a_straight_tube_has_the_surface_of_a_cylinder(turned):
    """Along the axes and across: 2 pi r times the length, around the strand."""
    towards = np.vstack([np.eye(3), [[1, 1, 0], [1, 2, 3], [-1, 0, 1e-9]]])[turned] * 2.0
    points = np.linspace(0.0, 1.0, 5)[:, None] * towards
    vertices, triangles = tubes(points, np.full(5, 0.01), np.array([0, 5]))
    length = np.linalg.norm(towards)
    assert len(triangles) == 4 * 6
    assert triangle_areas(vertices[triangles]).sum() == pytest.approx(2.0 * np.pi * 0.01 * length, rel=1e-9)
    assert np.allclose(vertices.reshape(5, 3, 3).mean(1), points, atol=1e-12)


def test_strands_stay_apart_and_taper():
    """Strands of 1, 3 and 2 points: none, two and one segments; no triangle joins two of them, radius 0 is a tip."""
    rng = np.random.default_rng(0)
    points, start = rng.normal(size=(6, 3)), np.array([0, 1, 4, 6])
    radius = np.array([1.0, 0.1, 0.2, 0.0, 0.3, 0.3])
    vertices, triangles = tubes(points, radius, start)
    assert len(triangles) == 18
    strand = np.searchsorted(start, triangles // 3, side="right") - 1
    assert (strand == strand[:, :1]).all()
    assert set(strand[:, 0]) == {1, 2}
    assert np.allclose(vertices[9:12], points[3])


def test_nothing_gives_nothing():
    for vertices, triangles in (
        balls(np.zeros((0, 3)), np.zeros(0)),
        tubes(np.zeros((0, 3)), np.zeros(0), np.zeros(1, int)),
    ):
        assert (len(vertices), len(triangles)) == (0, 0)


@pytest.mark.parametrize(("count", "most"), [(0, 10), (10, 10), (11, 10), (1000, 7)])
def test_no_more_than_the_most_are_left(count, most):
    assert len(range(0, count, thinned(count, most))) <= most
    assert thinned(count, most) == 1 or len(range(0, count, thinned(count, most) - 1)) > most
