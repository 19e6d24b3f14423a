"""Sharing rays out over patches, and over the cells of a patch."""

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.sampling.allocation import allocate_rays, split_rays
from obscurance_addon.core.settings import MIN_RAYS_PER_PATCH, BakeSettings
from tests.core import closed_forms as exact
from tests.core.measuring import bakes, estimate
from tests.core.scenes import floor, grid, mesh, scene

AREAS = np.exp(np.random.default_rng(1).normal(0, 1.5, 500))


def test_without_a_budget_all_get_the_same():
    np.testing.assert_array_equal(allocate_rays(AREAS, BakeSettings(100)), 100)


@pytest.mark.parametrize("budget", [8_000, 20_000, 123_456, 10_000_000])
def test_budget_is_kept_and_used(budget):
    """Powers of two, at least 16, in total more than half of the budget unless the floor takes all."""
    rays = allocate_rays(AREAS, BakeSettings(ray_budget=budget))
    assert rays.sum() <= budget
    assert rays.min() >= MIN_RAYS_PER_PATCH == 16
    np.testing.assert_array_equal(np.exp2(np.rint(np.log2(rays))), rays)
    assert rays.sum() > budget / 2


@pytest.mark.parametrize("budget", [20_000, 123_456, 10_000_000])
def test_rays_go_by_area_within_rounding(budget):
    """Above the floor, rays per area differ by less than the factor of two that rounding makes."""
    rays = allocate_rays(AREAS, BakeSettings(ray_budget=budget))
    density = (rays / AREAS)[rays > MIN_RAYS_PER_PATCH]
    assert density.max() / density.min() <= 2.0
    assert (np.diff(rays[np.argsort(AREAS)]) >= 0).all()


def test_a_budget_below_the_floor_gives_the_floor():
    np.testing.assert_array_equal(allocate_rays(AREAS, BakeSettings(ray_budget=1)), 16)


def test_patches_without_area_get_the_floor():
    rays = allocate_rays(np.array([0.0, 1.0, 0.0]), BakeSettings(ray_budget=1000))
    np.testing.assert_array_equal(rays, [16, 512, 16])
    np.testing.assert_array_equal(allocate_rays(np.zeros(3), BakeSettings(ray_budget=1000)), 16)


@pytest.mark.parametrize("budget", [1 << 40, 1 << 62])
@pytest.mark.parametrize("patches", [1, 2, 3])
def test_the_largest_budget_does_not_overflow(budget, patches):
    rays = allocate_rays(np.ones(patches), BakeSettings(ray_budget=budget))
    assert (rays >= MIN_RAYS_PER_PATCH).all()
    assert int(rays.astype(object).sum()) <= budget


@pytest.mark.parametrize("total", [1, 2, 16, 64, 100])
@pytest.mark.parametrize("cells", [1, 2, 3, 7, 300])
def test_ranges_stay_inside_of_the_sequence(total, cells):
    """Also with more triangles than rays: every cell has at least one ray."""
    weight = np.random.default_rng(cells).dirichlet(np.ones(cells))
    start, count = split_rays(np.zeros(cells, np.int64), weight, np.array([total]))
    assert (count >= 1).all()
    assert (start >= 0).all()
    assert (start + count <= total).all()


@pytest.mark.parametrize("cells", [1, 2])
def test_cells_of_triangles_and_quads_use_every_ray_once(cells):
    start, count = split_rays(np.zeros(cells, np.int64), np.full(cells, 1 / cells), np.array([64]))
    used = np.concatenate([np.arange(s, s + c) for s, c in zip(start, count, strict=True)])
    np.testing.assert_array_equal(np.sort(used), np.arange(64))


def test_larger_cells_get_more_rays():
    """The count is the power of two nearest to the share of the area."""
    weight = np.array([0.5, 0.25, 0.125, 0.125])
    _, count = split_rays(np.zeros(4, np.int64), weight, np.array([64]))
    np.testing.assert_array_equal(count, [32, 16, 8, 8])


def test_patches_do_not_mix():
    patch = np.array([0, 0, 1, 2, 2, 2])
    start, count = split_rays(patch, np.array([0.5, 0.5, 1, 1 / 3, 1 / 3, 1 / 3]), np.array([64, 16, 32]))
    np.testing.assert_array_equal(start[[0, 2, 3]], 0)
    np.testing.assert_array_equal(count[:3], [32, 32, 16])


def polygon_beside_a_wall(corners: int, rays: int):
    """A regular polygon of radius 0.4 whose centre is 0.5 from a wall, one patch."""
    turns = 2 * np.pi * np.arange(corners) / corners
    points = np.stack([0.5 + 0.4 * np.cos(turns), 0.4 * np.sin(turns), 0 * turns], -1)
    disc = mesh(points, [(0, i, i + 1) for i in range(1, corners - 1)], [0] * (corners - 2))
    return scene([disc], [grid((0, -2, 0), (0, 4, 0), (0, 0, 2))]), points, BakeSettings(rays, distance=1.0)


def mean_over_polygon(points: np.ndarray) -> float:
    """Exact mean of the wall's obscurance over a polygon that is symmetric about the x axis."""
    x = np.linspace(points[:, 0].min(), points[:, 0].max(), 401)
    middle = 0.5 * (x[1:] + x[:-1])
    upper = points[points[:, 1] >= -1e-12]
    order = np.argsort(upper[:, 0])
    height = np.interp(middle, upper[order, 0], upper[order, 1])
    return float(np.average([exact.wall(Falloff.SQRT, q) for q in middle], weights=height))


@pytest.mark.parametrize(("corners", "rays"), [(6, 64), (100, 64), (100, 16), (300, 16), (300, 1)])
def test_n_gons_are_unbiased_with_fewer_rays_than_triangles(corners, rays):
    s, points, settings = polygon_beside_a_wall(corners, rays)
    got = estimate(bakes(s, settings, seeds=64))
    assert got.error[3] < 0.02 / np.sqrt(rays)
    assert abs(got.mean[3] - mean_over_polygon(points)) < 5.0 * got.error[3] + 1e-4  # 1e-4: 400 slices of the polygon


def test_a_budget_reaches_the_estimator():
    """Large patches get more rays than small ones, and the bake casts what was allocated."""
    s = scene([floor((0, 0), (4, 4), 2, 2), floor((4, 0), (4.5, 4), 2, 16)], [grid((0, 0, 0), (0, 4, 0), (0, 0, 1))])
    settings = BakeSettings(ray_budget=3000)
    baked = s.bake(settings)
    assert baked.rays == allocate_rays(s.area, settings).sum() <= 3000
    assert s.bake(BakeSettings(ray_budget=1)).rays == 36 * 16
