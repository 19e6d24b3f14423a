"""Self-intersections and leaks, measured ray by ray in rotated rooms of any size and place."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene import patches as patches_module
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from tests.core import closed_forms as exact
from tests.core.measuring import ROUNDING, SIGMAS, bakes, estimate
from tests.core.scenes import Scene, box, floor, grid, mesh, room, rotation, scene


class HitCounter:
    """Embree, counting rays, leaks (no hit) and hits on the back of what encloses the ray's start."""

    def __init__(self, *arguments):
        self.tracer = EmbreeIntersector(*arguments)
        self.rays = self.leaks = self.own = 0

    def intersect(self, origins, directions, limits):
        hits = self.tracer.intersect(origins, directions, limits)
        missed = hits.triangle < 0
        behind = np.einsum("ij,ij->i", directions, np.where(missed[:, None], 0.0, hits.normal)) > 0.0
        self.rays += len(origins)
        self.leaks += int(missed.sum())
        self.own += int(behind.sum())
        return hits


def count(s: Scene) -> HitCounter:
    """Cast infinite rays: in a convex room they all must meet the front of a wall."""
    counters = []

    def build(*arguments):
        counters.append(HitCounter(*arguments))
        return counters[0]

    s = replace(s, patches=replace(s.patches, shell=None))  # else other rays look for sheets that face the wrong way
    s.bake(BakeSettings(64, distance=np.inf, falloff=Falloff.LINEAR, threads=1), intersector=build)
    return counters[0]


def turned_room(scale: float, offset: float = 0.0, n: int = 16) -> Scene:
    return scene(
        [room((-0.5, -0.5, -0.5), (0.5, 0.7, 0.9), n).moved(rotation(7) * scale, (offset, -offset, 2 * offset))]
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_no_ray_leaks_or_meets_its_own_wall(scale):
    """Of 163,840 rays: 64 of each of 1,536 patches, and as many of the 1,024 that tell the error."""
    counted = count(turned_room(scale))
    assert counted.rays == 64 * (1536 + 1024)
    assert (counted.leaks, counted.own) == (0, 0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_no_ray_leaks_far_from_the_origin(scale):
    """A hundred thousand room sizes away, in float64 world coordinates."""
    counted = count(turned_room(scale, 1e5 * scale))
    assert (counted.leaks, counted.own) == (0, 0)


def test_the_offset_is_what_prevents_it(monkeypatch):
    """Without it, some third or more of the rays meet the wall that they leave: the counter above can fail."""
    monkeypatch.setattr(patches_module, "OFFSET", 0.0)
    counted = count(turned_room(1.0, n=4))
    assert counted.own > 0.2 * counted.rays


@pytest.mark.parametrize("factor", [1e-1, 1e1])
def test_the_offset_has_a_margin_on_both_sides(monkeypatch, factor):
    """A tenth and ten times of it still leave no self-intersection and no leak."""
    monkeypatch.setattr(patches_module, "OFFSET", patches_module.OFFSET * factor)
    counted = count(turned_room(1.0))
    assert (counted.leaks, counted.own) == (0, 0)


def test_a_closed_room_with_furniture_does_not_leak():
    """Infinite reach: no miss at all, for patches of the room and of two floating boxes."""
    turn = rotation(9)
    meshes = [
        room((0, 0, 0), (1, 1, 1), 8),
        box((0.2, 0.2, 0.3), (0.4, 0.5, 0.6), 4),
        box((-0.1, -0.1, -0.2), (0.1, 0.1, 0.2), 4).moved(rotation(2), (0.7, 0.7, 0.5)),
    ]
    baked = scene([m.moved(turn) for m in meshes]).bake(BakeSettings(256, distance=np.inf))
    assert baked.valid.all()
    assert baked.sums.miss.max() == 0.0


@pytest.mark.parametrize("far", [1.0, 10.0, 100.0])
def test_occluders_much_larger_than_the_patches(far):
    """Rays of a small patch meet a wall of up to 40,000 times its size exactly where it is."""
    patch = floor((0.0, 0.0), (0.01, 0.01)).moved(offset=(0.5 * far, 0, 0))
    wall = grid((0, -2 * far, 0), (0, 4 * far, 0), (0, 0, 2 * far))
    got = estimate(bakes(scene([patch], [wall]), BakeSettings(4096, distance=far, falloff=Falloff.LINEAR)))
    assert got.error[3] < 1e-4
    w = exact.strip(Falloff.LINEAR, 0.5, 0.5 + 0.01 / far)
    assert abs(got.mean[3] - w) < SIGMAS * got.error[3] + ROUNDING


def test_small_parts_of_a_large_scene_are_warned_of():
    """d_max below 1,000 ray offsets of some face: a warning with their number; above, none."""
    near, far = floor((0, 0), (0.1, 0.1), 2, 2), floor((1000, 0), (1000.1, 0.1), 3, 3)
    s = scene([near, far])
    # Both ends are 500 m from the middle: rays start 5 mm above them.
    assert not s.bake(BakeSettings(distance=5.1)).warnings
    (warning,) = s.bake(BakeSettings(distance=4.9)).warnings
    assert "13 patches" in warning


def test_a_detailed_part_in_the_middle_of_a_large_scene_is_exact():
    """The offset shrinks with the coordinates: a nook of 2 mm between parts 2 km apart keeps its value."""
    nook = floor((-0.001, -0.001), (0.001, 0.001))
    ceiling = floor((-0.005, -0.005), (0.005, 0.005), z=0.001).flipped()
    ends = [floor((x, -1), (x + 1, 1)) for x in (-1000, 999)]
    settings = BakeSettings(1024, distance=0.002, falloff=Falloff.LINEAR)
    alone, together = scene([nook], [ceiling]), scene([nook, *ends], [ceiling])
    assert together.bake(settings).grey[0] == pytest.approx(alone.bake(settings).grey[0], abs=2e-4)


def test_doubled_faces_with_a_reach_below_the_ray_offset():
    """Every face is there twice, in a scene so large that rays start farther off than they reach: W stays within 1."""
    ends = np.array([(s * 1e15, y, z) for s in (1, -1) for y, z in ((0, 0), (1, 0), (0, 1))])
    far = mesh(ends, [(0, 1, 2), (3, 4, 5)])
    for seed in range(4):
        corners = np.random.default_rng(seed).uniform(-0.5, 0.5, (6, 3, 3))
        faces = [mesh(triangle, [(0, 1, 2)]) for triangle in corners]
        baked = scene([*faces, *faces, far]).bake(BakeSettings(16, distance=1e-9, threads=1))
        assert baked.grey.max() <= 1.0
