"""Where charts meet on a surface, a lookup from either side finds the same: margins continue charts past their border.

A bilinear lookup on the border of a chart takes half from the last texels in it and half from the margin. The margin
continues the chart, so that the lookup has the value half a texel inside, from either side.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from tests.core import closed_forms as exact
from tests.core.lightmap.lightmap_scenes import SIZE, Mapped, mapped_scene
from tests.core.measuring import ROUNDING, SEEDS, SIGMAS, Estimate
from tests.core.scenes import floor, mesh, welded

N, GAP = 20, 5  # texels along the side of a chart, and between charts: an odd number, which one side gets more of
LIFT = 0.6  # of the middle of the cube above the floor
FAR = 2000.0
STEP = BakeSettings(64, distance=np.inf, falloff=Falloff.STEP, use_bleeding=False)


def lookup(page, place):
    """Bilinear values (n, 3) of a page at places (n, 2) in texels; texel centres are at halves."""
    x, y = (place - 0.5).T
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    rows = [page[y0 + k, x0, :3] * (1 - fx) + page[y0 + k, x0 + 1, :3] * fx for k in (0, 1)]
    return rows[0] * (1 - fy) + rows[1] * fy


@dataclass(frozen=True)
class Unwrapped:
    """Six square charts of N x N texels: sides of a cube, each with its axis, sign and two directions along it."""

    scene: object
    at: np.ndarray  # (6, 2) lower left corners in texels
    axes: np.ndarray  # (6, 3, 3): outward, along u, along v

    def borders(self):
        """Places on charts a and b (12 N, 2) each, points on the cube's surface (12 N, 3), and edges (12 N,)."""
        found = {}
        for side, (outward, u, v) in enumerate(self.axes):
            t = (np.arange(N) + 0.5) / N
            for across, along, swap in ((u, v, False), (v, u, True)):
                for end in (0.0, 1.0):
                    points = outward + (2 * end - 1) * across + (2 * t[:, None] - 1) * along
                    place = np.stack([np.full(N, end), t], -1)
                    place = self.at[side] + N * (place[:, ::-1] if swap else place)
                    for p, where in zip(points, place, strict=True):
                        found.setdefault(tuple(np.round(p, 9)), []).append(where)
        points = np.array(list(found))
        assert all(len(pair) == 2 for pair in found.values())
        one, other = np.array(list(found.values())).transpose(1, 0, 2)
        edge = np.unique(np.where(abs(points) == 1.0, points, 0.0), axis=0, return_inverse=True)[1].ravel()
        return one, other, points, edge


def unwrapped(bend, lift, ground):
    """A cube whose sides are N x N quads, one texel each, its points moved by `bend`, its middle above a floor."""
    corners, uvs, axes = [], [], []
    at = np.array([(8 + (N + GAP) * (k % 3), 8 + (N + GAP) * (k // 3)) for k in range(6)], float)
    for side in range(6):
        axis, sign = side // 2, 2.0 * (side % 2) - 1.0
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        u, v = (u, v) if sign > 0 else (v, u)
        outward = sign * np.eye(3)[axis]
        y, x = np.mgrid[: N + 1, : N + 1]
        uv = np.stack([x, y], -1).astype(float)
        points = outward + (2 * uv[..., :1] / N - 1) * u + (2 * uv[..., 1:] / N - 1) * v
        for values, into in ((bend(np.round(points, 12)), corners), (uv + at[side], uvs)):
            a, b, c, d = values[:-1, :-1], values[:-1, 1:], values[1:, 1:], values[1:, :-1]
            into.append(np.stack([a, b, c, a, c, d], 2).reshape(-1, 3, values.shape[-1]))
        axes.append((outward, u, v))
    corners, uvs = np.concatenate(corners), np.concatenate(uvs)
    chart = np.arange(len(uvs)) // (2 * N * N)
    m = welded(mesh(np.round(corners, 12).reshape(-1, 3), np.arange(len(corners) * 3), np.arange(len(corners)) // 2))
    return Unwrapped(mapped_scene([Mapped(m.moved(offset=(0, 0, lift)), uvs, chart)], [ground]), at, np.array(axes))


def onto_sphere(points):
    """Cube to unit sphere with texels of nearly one size: coordinates turn into angles first."""
    points = np.tan(0.25 * np.pi * points)
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


SPHERE = unwrapped(onto_sphere, 1.25, floor((-FAR, -FAR), (FAR, FAR)))
CUBE = unwrapped(lambda points: 0.5 * points, LIFT, floor((-3, -3), (3, 3)))


def both_sides(shape, settings, margin=16):
    """Lookups on the borders from one chart and from the other, (seeds, 12 N) each."""
    assert shape.scene.scene.surfaces.shells.solid.any()
    one, other, _, _ = shape.borders()
    pages = [shape.scene.bake(replace(settings, seed=seed), margin=margin).pages[0] for seed in range(SEEDS)]
    return tuple(np.stack([lookup(page, place)[:, 0] for page in pages]) for place in (one, other))


def estimate(values):
    return Estimate(values.mean(0), values.std(0, ddof=1) / np.sqrt(len(values)))


def of_edges(values, edge):
    """Means (seeds, 12) over the N points of each edge."""
    return np.stack([np.bincount(edge, row) / N for row in values])


def open_share(texels):
    """W of STEP far and wide above a floor without end: (1 + n_z) / 2 wherever a convex body looks."""
    page = np.full((SIZE, SIZE, 3), np.nan)
    page.reshape(-1, 3)[texels.index] = 0.5 * (1.0 + texels.normal[:, 2:])
    return page


def exact_inside(shape):
    """Exact values of the last texels on either side of each point of a border, (12 N,) each."""
    page = open_share(shape.scene.texels())
    one, other, _, _ = shape.borders()
    found = []
    for place in (one, other):
        chart = np.argmin([np.abs(place - at - N / 2).max(1) for at in shape.at], axis=0)
        inside = place + 0.5 * np.sign(shape.at[chart] + N / 2 - place) * (place % 1.0 == 0.0)
        x, y = np.floor(inside).astype(int).T
        found.append(page[y, x, 0])
    return found


def test_a_sphere_has_no_seams():
    """Both lookups have the mean of the last texels, half a texel inside, and so differ by what is between them."""
    _, _, points, edge = SPHERE.borders()
    one, other = both_sides(SPHERE, STEP)
    inside = exact_inside(SPHERE)
    change = np.bincount(edge, inside[0] - inside[1]) / N
    got = estimate(of_edges(one - other, edge))
    assert got.error.max() < 5e-3
    # A margin texel is the mean of three neighbours along the border; W bends by less than a texel's angle squared.
    angle = 0.5 * np.pi / N
    assert (np.abs(got.mean - change) < SIGMAS * got.error + angle**2 + ROUNDING).all()
    whole = estimate((one - other).mean(1))
    assert abs(whole.mean - change.mean()) < SIGMAS * whole.error + angle**2
    # The value on the border itself: neither darker nor brighter than between the two, but for the same bend.
    seam = estimate(of_edges(0.5 * (one + other), edge))
    truth = np.bincount(edge, 0.5 * (1.0 + onto_sphere(points)[:, 2])) / N
    assert (np.abs(seam.mean - truth) < SIGMAS * seam.error + angle**2).all()


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.LINEAR])
def test_the_upright_edges_of_a_cube_have_no_seams(falloff):
    """The floor is the same on both sides of each, so that lookups agree in the mean, row by row of texels."""
    _, _, points, _ = CUBE.borders()
    upright = np.abs(points[:, 2]) < 1.0
    one, other = both_sides(CUBE, BakeSettings(64, distance=1.5, falloff=falloff, use_bleeding=False))
    height = np.unique(points[upright, 2], return_inverse=True)[1].ravel()
    assert np.bincount(height).tolist() == [4] * N
    got = estimate(np.stack([np.bincount(height, row) / 4 for row in (one - other)[:, upright]]))
    assert got.error.max() < 5e-3
    assert (np.abs(got.mean) < SIGMAS * got.error + ROUNDING).all()
    q = (LIFT + 0.5 * points[upright, 2]) / 1.5
    rows = [exact.strip(falloff, x - 0.5 / N / 1.5, x + 0.5 / N / 1.5) for x in np.unique(q)]
    slope = np.abs(np.gradient(rows)).max()  # margins smooth over three rows, whose ends lack one
    seam = estimate(np.stack([np.bincount(height, row) / 4 for row in (0.5 * (one + other))[:, upright]]))
    assert (np.abs(seam.mean - rows) < SIGMAS * seam.error + 0.25 * slope + ROUNDING).all()
    assert np.ptp(rows) > SIGMAS * seam.error.max()  # there is something to get wrong


def test_the_level_edges_of_a_cube_have_the_values_of_their_own_sides():
    """What meets there is open, upright and covered: 1, 1/2 and 0 exactly, with nothing of the other side."""
    cube = unwrapped(lambda points: 0.5 * points, LIFT, floor((-FAR, -FAR), (FAR, FAR)))
    _one, _other, points, _ = cube.borders()
    level = np.abs(points[:, 2]) == 1.0
    values = np.stack([v.mean(0) for v in both_sides(cube, STEP)], -1)[level]
    error = 0.5 / np.sqrt(64 * SEEDS * 0.5)  # of random rays, of which a lookup has one texel's or more
    top = points[level, 2] > 0.0
    np.testing.assert_allclose(values[top].max(1), 1.0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(values[~top].min(1), 0.0, rtol=0, atol=2.0 / FAR)
    np.testing.assert_allclose([*values[top].min(1), *values[~top].max(1)], 0.5, rtol=0, atol=SIGMAS * error)


def test_without_margins_seams_show():
    """Half of each lookup is then empty: what the other tests look at is there to be seen."""
    _, _, points, edge = SPHERE.borders()
    one, other = both_sides(SPHERE, STEP, margin=0)
    truth = np.bincount(edge, 0.5 * (1.0 + onto_sphere(points)[:, 2])) / N
    seam = estimate(of_edges(0.5 * (one + other), edge))
    lack = truth - seam.mean
    assert (lack > SIGMAS * seam.error + (0.5 * np.pi / N) ** 2)[truth > 0.1].all()
    np.testing.assert_allclose(seam.mean, 0.5 * truth, rtol=0, atol=0.01)
