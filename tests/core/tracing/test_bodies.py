"""Which rays start inside of bodies, against winding numbers in double precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.bodies import Bodies, BodyShapes
from tests.core.scenes import Mesh, box, floor, grid, icosphere, join, mesh, room, rotation, scene


def winding(points: np.ndarray, m: Mesh) -> np.ndarray:
    """(n,) winding numbers of a mesh around points (n, 3); Van Oosterom and Strackee (1983)."""
    total = np.zeros(len(points))
    for corners in m.corners():
        a, b, c = (corner - points for corner in corners)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        dot = lambda x, y: np.einsum("ij,ij->i", x, y)  # noqa: E731
        below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total += np.arctan2(dot(a, np.cross(b, c)), below) / (2.0 * np.pi)
    return total


SAMPLES = 400  # of the oracle, on each face


def exposed_share(m: Mesh, solids: list[Mesh]) -> np.ndarray:
    """(f,) share of each face of a mesh that is outside of all solids, from points just above it."""
    rng, c = np.random.default_rng(0), m.corners()
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    area = np.linalg.norm(normal, axis=1)
    own = np.concatenate([
        rng.choice(np.flatnonzero(m.face == face), SAMPLES, p=area[m.face == face] / area[m.face == face].sum())
        for face in range(m.faces)
    ])  # fmt: skip
    u = np.sort(rng.random((len(own), 2)), axis=1)
    points = np.einsum("nk,nkx->nx", np.stack([u[:, 0], u[:, 1] - u[:, 0], 1 - u[:, 1]], -1), c[own])
    points += 1e-5 * (normal / area[:, None])[own]
    outside = np.stack([winding(points, solid) for solid in solids]) < 0.5
    return outside.all(0).reshape(m.faces, SAMPLES).mean(1)


def sofa(n: int) -> list[Mesh]:
    """Boxes that run into each other, so that from within one the outside of another is seen first."""
    return [
        box((0.05, 0.3, 0.0), (0.95, 2.3, 0.42), n),
        box((0.02, 0.25, 0.0), (0.3, 2.35, 0.9), n),
        box((0.03, 0.1, 0.0), (1.0, 0.36, 0.6), n),
        box((0.03, 2.24, 0.0), (1.0, 2.5, 0.6), n),
        box((0.1, 0.2, 0.3), (0.8, 0.8, 0.7), n).moved(rotation(3) @ rotation(4).T, (0.1, 0.1, 0.1)),
    ]


def rocks(_n: int) -> list[Mesh]:
    """Rocks in a hilly closed terrain, and in each other."""
    ground = box((-2, -2, -1), (2, 2, 0), 4)
    hills = ground.vertices.copy()
    hills[:, 2] += (hills[:, 2] > -1e-9) * 0.3 * np.sin(2 * hills[:, 0]) * np.cos(hills[:, 1])
    rng = np.random.default_rng(2)
    return [replace(ground, vertices=hills)] + [
        icosphere(0).moved(0.45 * rotation(i), (*rng.uniform(-1.2, 1.2, 2), rng.uniform(0.1, 0.3))) for i in range(6)
    ]


@pytest.mark.parametrize(
    ("distance", "falloff", "make"), [(0.2, Falloff.SQRT, sofa), (3.0, Falloff.STEP, sofa), (0.3, Falloff.SQRT, rocks)]
)
def test_overlapping_solids_hide_what_is_inside_of_any(make, distance, falloff):
    """Share outside of solids of every face, within five standard errors of the oracle's, and no bias."""
    meshes = make(4)
    baked = scene(meshes).bake(BakeSettings(512, distance=distance, falloff=falloff))
    expected = exposed_share(join(meshes), make(1))
    partly = (expected > 0.01) & (expected < 0.99)
    assert partly.sum() > 20
    difference, error = baked.sums.valid - expected, np.sqrt(np.maximum(expected * (1 - expected), 0.01) / SAMPLES)
    assert (np.abs(difference) < 5.0 * error).all()
    assert abs(difference[partly].mean()) < 5.0 * np.sqrt((error[partly] ** 2).sum()) / partly.sum()


def inside_of(m: Mesh, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    bodies = Bodies(np.zeros(1, np.int32), BodyShapes.of(m.vertices, m.triangles, np.ones(len(m.triangles), np.int32)))
    return bodies.start_inside(points.astype(np.float32), directions.astype(np.float32))[0]


@pytest.mark.parametrize(
    "m", [box((0, 0, 0), (1, 1, 1), 2), icosphere(2), join([icosphere(2), icosphere(1).moved(0.5).flipped()])],
    ids=["box", "ball", "hollow"],
)  # fmt: skip
def test_points_against_winding_numbers(m):
    rng = np.random.default_rng(1)
    points, directions = rng.uniform(-1.2, 1.2, (3000, 3)), rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    np.testing.assert_array_equal(inside_of(m, points, directions), winding(points, m) > 0.5)


def test_walls_that_coincide_hide_no_other():
    """A row of crates that touch, on a slab: faces of the slab beside them are exposed, those below are not."""
    slab = box((-1, -1, -1), (5, 2, 0), 1)
    top = floor((-1, -1), (5, 2), 18, 9)
    row = [box((0.5 * i, 0, 0), (0.5 * (i + 1), 1, 0.4), 1) for i in range(6)]
    baked = scene([top], [slab, *row, join(row).moved(offset=(0, 0, 0.4))]).bake(BakeSettings(256, distance=0.5))
    x, y, _ = top.centres().T
    below = (x > 0) & (x < 3) & (y > 0) & (y < 1)
    np.testing.assert_array_equal(baked.sums.valid, np.where(below, 0.0, 1.0))


def test_more_bodies_than_tracers_are_kept():
    """Embree's binding crashes where a thousand scenes are alive."""
    small = [box((i % 40, i // 40, -0.25), (i % 40 + 0.5, i // 40 + 0.5, 0.25)) for i in range(1200)]
    ground = floor((0, 0), (40, 30), 20, 15)
    baked = scene([ground], small).bake(BakeSettings(64, distance=0.4, threads=2))
    np.testing.assert_allclose(baked.sums.valid, 0.75, atol=0.06)


def test_a_shell_with_a_hole_hides_what_it_holds_and_nothing_outside():
    """A crate without its lid, through a floor: faces below it are hidden, a ceiling that looks into it sees walls."""
    crate = box((0.2, 0.2, -0.5), (0.8, 0.8, 0.5), 1)
    opened = mesh(crate.vertices, crate.triangles[:-2])
    ground, ceiling = floor((-1, -1), (2, 2), 15, 15), grid((0, 0, 0.9), (0, 1, 0), (1, 0, 0), 4, 4)
    baked = scene([ground, ceiling], [opened]).bake(BakeSettings(256, distance=1.0))
    x, y, _ = ground.centres().T
    below = (np.abs(x - 0.5) < 0.3) & (np.abs(y - 0.5) < 0.3)
    assert baked.sums.valid[: ground.faces][below].max() < 0.35  # rays leave through the hole
    np.testing.assert_array_equal(baked.sums.valid[: ground.faces][~below], 1.0)
    np.testing.assert_array_equal(baked.sums.valid[ground.faces :], 1.0)


def test_a_room_hides_nothing():
    shell = room((0, 0, 0), (1, 1, 1))
    ball = icosphere(1).moved(0.2, (0.5, 0.5, 0.5))
    assert scene([shell, ball]).bake(BakeSettings(64)).valid.all()
