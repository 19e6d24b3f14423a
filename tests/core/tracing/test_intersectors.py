"""Embree against brute force and against geometry, and the questions that the estimator asks of either."""

import threading

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.tracing.intersector import BruteForceIntersector
from tests.core.scenes import box, floor, grid, icosphere, join, room, rotation, scene

EVERY = pytest.mark.parametrize("kind", [EmbreeIntersector, BruteForceIntersector])


def random_rays(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return rng.uniform(-1, 1, (n, 3)).astype(np.float32), directions.astype(np.float32)


def soup(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + rng.normal(0, 0.2, (n, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * n, dtype=np.int32).reshape(n, 3)


@pytest.mark.parametrize("limit", [0.3, 1e30])
def test_embree_equals_brute_force(limit):
    """Same triangle, distance and normal for 20,000 rays in a soup, but for rays that graze an edge or a second hit."""
    vertices, triangles = soup(150, 5)
    origins, directions = random_rays(20000, 6)
    limits = np.full(len(origins), limit, np.float32)
    fast = EmbreeIntersector(vertices, triangles).intersect(origins, directions, limits.copy())
    slow = BruteForceIntersector(vertices, triangles).intersect(origins, directions, limits.copy())
    same = np.maximum(fast.triangle, -1) == slow.triangle
    assert np.count_nonzero(~same) <= 2  # an edge is some 1e-7 wide in float32: of 20,000 rays, none is expected there
    hit = same & (slow.triangle >= 0)
    assert 0.1 < hit.mean() < 0.999
    np.testing.assert_allclose(fast.distance[hit], slow.distance[hit], rtol=2e-5, atol=2e-6)
    np.testing.assert_array_equal(fast.distance[fast.triangle < 0], limits[fast.triangle < 0])
    np.testing.assert_array_equal(slow.distance[slow.triangle < 0], limits[slow.triangle < 0])
    unit = [h.normal[hit] / np.linalg.norm(h.normal[hit], axis=1, keepdims=True) for h in (fast, slow)]
    assert np.einsum("ij,ij->i", *unit).min() > 0.9999


@EVERY
def test_occluded_says_whether_intersect_hits(kind):
    vertices, triangles = soup(60, 7)
    origins, directions = random_rays(5000, 8)
    tracer, limits = kind(vertices, triangles), np.full(5000, 0.5, np.float32)
    hits = tracer.intersect(origins, directions, limits.copy())
    np.testing.assert_array_equal(tracer.occluded(origins, directions, limits.copy()), hits.triangle >= 0)


@EVERY
def test_limits_are_per_ray(kind):
    """A plane at distance 1 is met by a limit just above 1 and not by one just below."""
    tracer = kind(np.array([[-9, -9, 1], [9, -9, 1], [0, 9, 1]], np.float32), np.array([[0, 1, 2]]))
    origins, directions = np.zeros((3, 3), np.float32), np.tile(np.float32([0, 0, 1]), (3, 1))
    hits = tracer.intersect(origins, directions, np.float32([0.999, 1.001, 1e30]))
    np.testing.assert_array_equal(hits.triangle >= 0, [False, True, True])
    np.testing.assert_allclose(hits.distance, [0.999, 1.0, 1.0], rtol=1e-6)


@EVERY
def test_normals_are_right_handed_on_both_sides(kind):
    tracer = kind(np.array([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], np.float32), np.array([[0, 1, 2]]))
    origins, directions = np.float32([[0, 0, 1], [0, 0, -1]]), np.float32([[0, 0, -1], [0, 0, 1]])
    normal = tracer.intersect(origins, directions, np.full(2, 9, np.float32)).normal
    assert (normal[:, 2] > 0.0).all()


@EVERY
def test_a_scene_without_triangles_is_missed(kind):
    tracer = kind(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    origins, directions = random_rays(100, 9)
    hits = tracer.intersect(origins, directions, np.full(100, 2.0, np.float32))
    assert (hits.triangle < 0).all()
    assert not tracer.occluded(origins, directions, np.full(100, 2.0, np.float32)).any()


def test_triangles_keep_their_numbers_beyond_one_slice():
    """Of 81,920 triangles, built in three slices, the one named holds the hit point."""
    sphere = icosphere(6)
    reported = []
    tracer = EmbreeIntersector(sphere.vertices, sphere.triangles, reported.append)
    _, directions = random_rays(20000, 10)
    hits = tracer.intersect(np.zeros_like(directions), directions, np.full(20000, 9, np.float32))
    assert (hits.triangle >= 0).all()
    assert hits.triangle.max() > 1 << 16
    assert reported == [1 << 15, 1 << 16, 81920]
    a, b, c = sphere.corners()[hits.triangle].transpose(1, 0, 2)
    inside = [np.einsum("ij,ij->i", np.cross(p, q), directions) for p, q in ((a, b), (b, c), (c, a))]
    assert np.min(inside) > -1e-7


def test_building_can_be_cancelled():
    sphere = icosphere(2)

    def stop(_done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        EmbreeIntersector(sphere.vertices, sphere.triangles, stop)


@pytest.mark.parametrize("falloff", list(Falloff))
def test_bakes_with_brute_force_and_with_embree_are_equal(falloff):
    """Every patch to 1e-5, with solids, sheets and colours: no ray meets another triangle."""
    turn = rotation(3)
    meshes = [
        room((0, 0, 0), (1, 1, 1), 2, (0.3, 0.5, 0.7)),
        box((0.2, 0.2, 0.0), (0.5, 0.6, 0.4), 1, (0.8, 0.1, 0.1)),
        grid((0.6, 0.3, 0.3), (0.3, 0, 0.1), (0, 0.4, 0), colour=(0.1, 0.8, 0.2)),
    ]
    s = scene([m.moved(turn) for m in meshes])
    settings = BakeSettings(rays=32, distance=0.6, falloff=falloff)
    fast, slow = s.bake(settings), s.bake(settings, brute=True)
    np.testing.assert_array_equal(fast.valid, slow.valid)
    np.testing.assert_allclose(fast.grey, slow.grey, rtol=0, atol=1e-5)
    np.testing.assert_allclose(fast.coloured, slow.coloured, rtol=0, atol=1e-5)
    np.testing.assert_allclose(fast.sums.miss, slow.sums.miss, rtol=0, atol=1e-12)


class Spy:
    """Counts rays per question and passes them on."""

    def __init__(self, tracer):
        self.tracer, self.rays, self.lock = tracer, {"intersect": 0, "occluded": 0}, threading.Lock()

    def _ask(self, question, origins, *rest):
        with self.lock:
            self.rays[question] += len(origins)
        return getattr(self.tracer, question)(origins, *rest)

    def intersect(self, *rays):
        return self._ask("intersect", *rays)

    def occluded(self, *rays):
        return self._ask("occluded", *rays)


def spied(meshes, settings):
    spies = []

    def build(*arguments):
        spies.append(Spy(EmbreeIntersector(*arguments)))
        return spies[0]

    baked = scene(meshes).bake(settings, intersector=build)
    return baked, spies[0].rays


OPEN = [floor((0, 0), (1, 1), 3, 3), grid((0, 0, 0), (0, 1, 0), (0, 0, 1), 3, 3)]


TO_BOTH_SIDES = 2 * 4 * 36  # rays that ask whether sheets look away: four to each side of each triangle of OPEN


def test_step_asks_only_for_occlusion_without_solids():
    baked, rays = spied(OPEN, BakeSettings(falloff=Falloff.STEP))
    assert rays == {"intersect": TO_BOTH_SIDES, "occluded": baked.rays + baked.error_rays}


def test_step_asks_for_the_side_hit_when_there_are_solids():
    baked, rays = spied([*OPEN, box((0.3, 0.3, 0.2), (0.6, 0.6, 0.5))], BakeSettings(falloff=Falloff.STEP))
    assert rays["occluded"] == 0
    patches = len(baked.grey)
    assert rays["intersect"] == 2 * patches * BakeSettings().rays + TO_BOTH_SIDES


@pytest.mark.parametrize("falloff", [f for f in Falloff if f is not Falloff.STEP])
def test_other_falloffs_ask_for_distances(falloff):
    baked, rays = spied(OPEN, BakeSettings(falloff=falloff))
    assert rays["occluded"] == 0
    assert rays["intersect"] >= baked.rays + baked.error_rays


def test_ray_counts():
    """Without solids: patches x rays for the values, and as many for the error of a small scene."""
    baked, _ = spied(OPEN, BakeSettings(rays=32))
    assert baked.rays == baked.error_rays == 18 * 32


def test_both_ways_of_step_agree():
    """A far-off solid that no ray reaches switches to the other query; no value changes."""
    settings = BakeSettings(falloff=Falloff.STEP, distance=0.5)
    far = box((1.2, 1.2, 2.0), (1.4, 1.4, 2.2))
    one = scene(OPEN).bake(settings)
    two = scene(OPEN, [join([far, far.moved(offset=(0, 0, 1))]), far.moved(offset=(-0.9, -0.9, -0.5))]).bake(settings)
    assert two.sums.hit.shape == one.sums.hit.shape
    np.testing.assert_array_equal(one.grey, two.grey)
