"""Rays that go on behind transparent triangles: each once, none skipped, wherever they stand."""

from __future__ import annotations

import numpy as np
import pytest

from obscurance_addon.core.scene.patches import Normalisation
from obscurance_addon.core.scene.transmission import Transmission, join_transmissions
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.tracing.traced_scene import FAR
from obscurance_addon.core.tracing.transparency import Passage, Transparency
from tests.core.scenes import floor, join

UNIT = Normalisation(np.zeros(3), 1.0)


def rays_onto(rng, n, centre, steepest):
    """Origins over a unit square about a point and directions that meet it, of cosines up to `steepest`."""
    target = centre + np.column_stack([rng.uniform(-0.4, 0.4, (n, 2)), np.zeros(n)])
    cosine, turn = rng.uniform(0.0, steepest, n) + 1e-4, rng.uniform(0.0, 2.0 * np.pi, n)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    directions = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), -cosine])
    origins = (target - rng.uniform(0.05, 0.1, (n, 1)) * directions).astype(np.float32)
    return origins, directions.astype(np.float32)


def met_by(tracer, origins, directions, most):
    """Triangles (n, most) that rays meet one after the other, and their distances."""
    rays = np.arange(len(origins))
    hits = tracer.intersect(origins, directions, np.full(len(origins), FAR, np.float32))
    passage = Passage(tracer, origins, directions, FAR, hits, rays)
    triangles, distances = np.full((2, len(origins), most), -1.0)
    for layer in range(most):
        met = passage.triangle >= 0
        triangles[passage.rays[met], layer] = passage.triangle[met]
        distances[passage.rays[met], layer] = passage.distance[met]
        passage.keep(met)
        passage.go_on()
    assert not len(passage.rays) or (passage.triangle < 0).all()
    return triangles, distances


@pytest.mark.parametrize("steepest", [0.01, 1.0])
@pytest.mark.parametrize("far", [0.0, 1.0, 1000.0])
def test_each_triangle_is_met_once(far, steepest):
    """At flat angles, too, where rounding puts the place behind a hit before the surface."""
    rng = np.random.default_rng(int(far))
    centre = np.array([far, -0.7 * far, 0.31 * (1.0 + far)])
    triangle = np.array([(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0)])
    origins, directions = rays_onto(rng, 20000, centre, steepest)
    triangles, _ = met_by(
        EmbreeIntersector((triangle + centre).astype(np.float32), np.array([(0, 1, 2)])), origins, directions, 4
    )
    assert (triangles[:, 0] == 0).mean() > 0.99
    assert (triangles[:, 1:] == -1).all()


def test_no_layer_is_skipped():
    """Five cards a ten-thousandth apart, near the origin, straight and flat."""
    cards = join([floor((-9, -9), (9, 9), z=-1e-4 * i) for i in range(5)])
    tracer = EmbreeIntersector(cards.vertices.astype(np.float32), cards.triangles)
    for steepest in (0.05, 1.0):
        origins, directions = rays_onto(np.random.default_rng(1), 5000, np.zeros(3), steepest)
        triangles, distances = met_by(tracer, origins, directions, 8)
        whole = (distances[:, :5] >= 0.0).all(1) & (distances[:, 5:] < 0.0).all(1)
        assert whole.mean() > 0.999  # a ray along the diagonal of a card may meet both of its triangles
        assert (np.diff(distances[whole, :5], axis=1) > 0.0).all()
        np.testing.assert_array_equal(triangles[whole, :5] // 2, np.tile(np.arange(5), (whole.sum(), 1)))


def test_lookups_get_the_places_that_rays_meet():
    """In any order of corners, and of several meshes, by the numbers that they have in these."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1.0, 1.0, (6, 3, 3))
    asked = []

    def lookup(number):
        def look_up(triangles, places):
            asked.append((number, triangles, places))
            return np.full((len(triangles), 3), 0.25 * (1 + number), np.float32)

        return look_up

    parts = [
        Transmission(
            np.full((3, 3), 0.5, np.float32),
            np.array([0, -1, 1], np.int32),
            corners[[3 * i, 3 * i + 2]],
            np.array([7, 9], np.int32),
            np.zeros(2, np.int32),
            (lookup(i),),
        )
        for i in range(2)
    ]
    joined = join_transmissions([(3, parts[0]), (2, None), (3, parts[1])])
    transparency = Transparency.of(joined.only(np.array([0, 3, 5, 7])), UNIT)
    places = np.float32([(0.2, 0.3, 0.5), (0.7, 0.2, 0.1), (0.1, 0.1, 0.8)])
    points = np.einsum("nk,nkc->nc", places, corners[[0, 3, 5]])
    triangle = np.array([0, 2, 3], np.int32)
    passing, cover = transparency.at(triangle, points.astype(np.float32), np.zeros((3, 3), np.float32), np.zeros(3))
    np.testing.assert_allclose(passing, np.repeat([[0.25], [0.5], [0.5]], 4, axis=1), rtol=1e-6)
    np.testing.assert_allclose(cover, [1.5, 1.0, 1.0], rtol=1e-6)
    assert [(number, *triangles) for number, triangles, _ in asked] == [(0, 7), (1, 7, 9)]
    np.testing.assert_allclose(np.concatenate([place for *_, place in asked]), places, atol=1e-6)
    assert transparency.lets_through(np.array([0, 1, 2, 3, -1, -(1 << 15)])).tolist() == [
        True,
        False,
        True,
        True,
        False,
        False,
    ]
