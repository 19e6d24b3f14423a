"""Patch obscurances against exact values, in grey and in colour, for every falloff.

The tolerance is five standard errors, measured from 16 independent seeds, plus float32 rounding; each test also asserts
that the standard error is small enough to tell a wrong model from a right one.
"""

import itertools

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from tests.core import closed_forms as exact
from tests.core.measuring import ROUNDING, SEEDS, SIGMAS, bakes, estimate
from tests.core.scenes import box, floor, grid, icosphere, join, mesh, room, scene, welded

EVERY = pytest.mark.parametrize("falloff", list(Falloff))
ORDER = [Falloff.STEP, Falloff.CBRT, Falloff.SQRT, Falloff.LINEAR, Falloff.EXPONENTIAL]
RED, BLUE = (0.8, 0.1, 0.0), (0.1, 0.3, 0.9)


def coloured(occluder, w, m, r_ave):
    """W = R (W_rho - M) + R_ave M for one occluder colour R; M is the share of misses."""
    return np.asarray(occluder) * (w - m) + np.asarray(r_ave) * m


@pytest.mark.parametrize(
    ("form", "at", "values"),
    [
        (exact.sphere, 0.25, (0.93750000, 0.99107143, 0.98750000, 0.97916667, 0.98412063)),
        (exact.sphere, 1.0, (0.00000000, 0.85714286, 0.80000000, 0.66666667, 0.74593012)),
        (exact.sphere, 10.0, (0.00000000, 0.39785047, 0.25298221, 0.06666667, 0.10161348)),
        (exact.planes, 0.1, (0.01000000, 0.55499066, 0.41830369, 0.19000000, 0.26250076)),
        (exact.planes, 0.9, (0.81000000, 0.99658726, 0.99491106, 0.99000000, 0.99397603)),
        (exact.wall, 0.01, (0.50636609, 0.66990229, 0.60491740, 0.53373019, 0.54541612)),
        (exact.wall, 0.5, (0.80449889, 0.98019289, 0.97129547, 0.94803516, 0.96399412)),
        (lambda f, x: exact.strip(f, 0.0, x), 0.1, (0.53180444, 0.76376368, 0.70278070, 0.61128588, 0.63845349)),
        (lambda f, x: exact.strip(f, 0.0, x), 1.0, (0.78779341, 0.94694835, 0.92926447, 0.89389670, 0.91129270)),
    ],
)
def test_the_closed_forms_have_their_known_values(form, at, values):
    """Eight decimals, computed elsewhere with 20 digits."""
    assert [form(falloff, at) for falloff in ORDER] == pytest.approx(values, abs=6e-9)


@pytest.mark.parametrize(
    ("a", "b", "cover"), [(1, 1, 0.1385316060), (0.5, 0.5, 0.0598641176), (2, 1, 0.1673750099), (3, 3, 0.2292204334)]
)
def test_polygon_cover_of_a_rectangle(a, b, cover):
    corners = np.array([[0, 0, 1], [a, 0, 1], [a, b, 1], [0, b, 1]], float)
    assert exact.polygon_cover(np.zeros((1, 3)), np.array([[0, 0, 1.0]]), corners)[0] == pytest.approx(cover, abs=1e-10)


@EVERY
def test_infinite_plane(falloff):
    """Every ray misses: W is 1 in grey, R_ave in colour, without noise."""
    baked = scene([floor((0, 0), (1, 1), 4, 4, colour=RED)]).bake(BakeSettings(falloff=falloff))
    np.testing.assert_array_equal(baked.grey, 1.0)
    np.testing.assert_allclose(baked.coloured, np.tile(np.float32(RED), (16, 1)), rtol=1e-15, atol=0)
    assert baked.valid.all()


@EVERY
@pytest.mark.parametrize("q", [0.1, 0.25, 0.5, 0.9])
def test_parallel_planes(falloff, q):
    """A floor below a ceiling that reaches d_max = 1 beyond it."""
    ceiling = floor((-1.01, -1.01), (2.01, 2.01), z=q, colour=BLUE).flipped()
    s = scene([floor((0, 0), (1, 1), 8, 8, colour=RED)], [ceiling])
    got = estimate(bakes(s, BakeSettings(rays=64, distance=1.0, falloff=falloff)))
    w, m = exact.planes(falloff, q), exact.planes(Falloff.STEP, q)
    r_ave = (np.array(RED) + 3.02**2 * np.array(BLUE)) / (1 + 3.02**2)
    assert got.error.max() < 1e-3
    # The rays start 1e-5 of the half diagonal (0.71) above the floor: the ceiling is that much nearer.
    offset = 0.71e-5 * (exact.planes(falloff, q * 1.01) - exact.planes(falloff, q * 0.99)) / (0.02 * q)
    assert (np.abs(got.mean - [*coloured(BLUE, w, m, r_ave), w]) < SIGMAS * got.error + ROUNDING + offset).all()


@EVERY
@pytest.mark.parametrize("from_behind", [False, True])
def test_strips_beside_a_wall(falloff, from_behind):
    """Strip averages from contact to beyond d_max = 1, each on its own; the wall may show its front or its back."""
    edges = np.linspace(0.0, 1.25, 6)
    ground = floor((0, 0), (1.25, 1), 5, 12, colour=RED)
    wall = grid((0, -1.01, 0), (0, 3.02, 0), (0, 0, 1.01), colour=BLUE)
    s = scene([ground], [wall.flipped() if from_behind else wall])
    values = bakes(s, BakeSettings(rays=64, distance=1.0, falloff=falloff))
    r_ave = (1.25 * np.array(RED) + 3.02 * 1.01 * np.array(BLUE)) / (1.25 + 3.02 * 1.01)
    for i, (near, far) in enumerate(itertools.pairwise(edges)):
        got = estimate(values[:, i::5])
        w, m = exact.strip(falloff, near, far), exact.strip(Falloff.STEP, near, far)
        assert got.error.max() < 2e-3
        assert got.agrees_with([*coloured(BLUE, w, m, r_ave), w]), (near, far)


@EVERY
@pytest.mark.parametrize("a", [0.25, 0.5, 1.0, 2.0])
def test_sphere_interior(falloff, a):
    """Icospheres come to the sphere as the square of the edge length; extrapolated, they meet its value."""
    radius = 0.7
    means, errors = [], []
    for level in (2, 3):
        inside = icosphere(level, radius).flipped()
        s = scene([inside])
        got = estimate(bakes(s, BakeSettings(rays=64, distance=2 * radius * a, falloff=falloff)), s.area)
        means.append(got.mean[3])
        errors.append(got.error[3])
    extrapolated = (4.0 * means[1] - means[0]) / 3.0
    error = np.hypot(4.0 * errors[1], errors[0]) / 3.0
    w = exact.sphere(falloff, a)
    # What the extrapolation leaves is of the fourth power of the edge length, 1/16 of the square of what it removes.
    left = 4.0 * (means[1] - means[0]) ** 2
    assert error < 1e-3
    assert abs(extrapolated - w) < SIGMAS * error + left + ROUNDING
    assert abs(means[1] - w) <= abs(means[0] - w) / 2 + SIGMAS * np.hypot(*errors)


@pytest.mark.parametrize("degrees", [45, 90, 120, 150])
def test_wedge(degrees):
    """STEP, infinite reach: (1 - cos angle) / 2 at any distance from the edge of two half planes.

    The wall ends 100 away, so it lacks a little cover, which Lambert's formula gives exactly.
    """
    angle, far = np.radians(degrees), 100.0
    wall = grid((0, -far, 0), (0, 2 * far, 0), far * np.array([np.cos(angle), 0, np.sin(angle)]))
    ground = floor((0, 0), (1, 2), 3, 16)
    values = bakes(scene([ground], [wall]), BakeSettings(rays=64, distance=np.inf, falloff=Falloff.STEP))
    outline = wall.vertices[[0, 1, 3, 2]]
    for strip in range(3):
        w = 1.0 - exact.mean_polygon_cover(ground.corners()[ground.face % 3 == strip], outline)
        assert 0.0 < w - exact.wedge(angle) < 1.0 / far
        got = estimate(values[:, strip::3])
        assert got.error[3] < 3e-3
        assert abs(got.mean[3] - w) < SIGMAS * got.error[3] + ROUNDING


@pytest.mark.parametrize(
    "polygon",
    [
        [(0.2, 0.1, 0.8), (1.2, 0.1, 0.8), (1.2, 0.9, 0.8), (0.2, 0.9, 0.8)],
        [(2.0, -1.0, 0.0), (2.0, 3.0, 0.0), (2.0, 3.0, 1.5), (2.0, -1.0, 1.5)],
        [(-0.5, 0.0, 0.4), (0.5, -0.2, 1.4), (0.3, 0.9, 0.9)],
    ],
    ids=["overhead", "wall", "slanted triangle"],
)
def test_polygon_occluders(polygon):
    """Lambert's form factor, averaged over each of the four patches by quadrature."""
    polygon = np.array(polygon, float)
    fan = [(0, i, i + 1) for i in range(1, len(polygon) - 1)]
    ground = floor((0, 0), (1, 1), 2, 2)
    s = scene([ground], [mesh(polygon, fan, np.zeros(len(fan), int))])
    values = bakes(s, BakeSettings(rays=1024, distance=np.inf, falloff=Falloff.STEP))
    covers = np.array([exact.mean_polygon_cover(quad, polygon) for quad in ground.corners().reshape(4, 2, 3, 3)])
    error = values[..., 3].std(0, ddof=1) / np.sqrt(SEEDS)
    assert error.max() < 2e-3
    assert (np.abs(values[..., 3].mean(0) - (1.0 - covers)) < SIGMAS * error + 1e-5).all()


def rooms_with_known_volume():
    blocks = [box((0.2, 0.3, 0.1), (0.5, 0.5, 0.4), 2), box((0.6, 0.2, 0.5), (0.8, 0.7, 0.9), 2)]
    yield "room with floating blocks", [room((0, 0, 0), (1, 1, 1), 4), *blocks], 1.0 - 0.018 - 0.04
    # An L-shaped room: two boxes, with the wall between them left out.
    outline = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    sides = [
        grid((*b, 0), (*(a - b), 0), (0, 0, 1), 3, 3)
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True)
    ]
    floors = [floor(low, high, 3, 3) for low, high in (((0, 0), (1, 1)), ((1, 0), (2, 1)), ((0, 1), (1, 2)))]
    ceilings = [f.moved(offset=(0, 0, 1)).flipped() for f in floors]
    yield "L-shaped room", [welded(join([*sides, *floors, *ceilings]))], 3.0


@pytest.mark.parametrize(("name", "meshes", "volume"), list(rooms_with_known_volume()), ids=lambda v: str(v)[:20])
def test_chord_theorem(name, meshes, volume):
    """Closed scenes, linear falloff, d_max >= diameter: the area mean of W is 4 V / (S d_max)."""
    s = scene(meshes)
    diameter = 3.1
    values = bakes(s, BakeSettings(rays=256, distance=diameter, falloff=Falloff.LINEAR))
    got = estimate(values, s.area)
    assert got.error[3] < 2e-4
    # Rays start 1e-5 above the surface, which shortens each by at most that over its cosine, twice in the mean.
    assert abs(got.mean[3] - 4.0 * volume / (s.area.sum() * diameter)) < SIGMAS * got.error[3] + 4e-5 / diameter


@EVERY
def test_furnace(falloff):
    """A closed scene of one colour R: W = R W_rho ray by ray, whatever the shape."""
    colour = np.float32([0.2, 0.5, 0.8])
    meshes = [room((0, 0, 0), (1, 1, 1), 3), box((0.2, 0.3, 0.0), (0.5, 0.5, 0.4), 2)]
    baked = scene([m.coloured(colour) for m in meshes]).bake(BakeSettings(distance=0.5, falloff=falloff))
    np.testing.assert_allclose(baked.r_ave, colour, rtol=1e-12)
    np.testing.assert_allclose(baked.coloured, baked.grey[:, None] * colour, rtol=2e-6)
    assert np.ptp(baked.grey) > 0.1


@EVERY
def test_furnace_without_distance(falloff):
    """With d_max -> 0 every ray misses and W = R to float rounding."""
    colour = np.float32([0.2, 0.5, 0.8])
    baked = scene([room((0, 0, 0), (1, 1, 1), 3).coloured(colour)]).bake(BakeSettings(distance=1e-6, falloff=falloff))
    near_edges = np.abs(baked.grey - 1.0).max()
    assert near_edges < 1e-3  # only rays that start within d_max of an edge can hit
    np.testing.assert_allclose(baked.coloured, baked.grey[:, None] * colour, rtol=2e-6)
