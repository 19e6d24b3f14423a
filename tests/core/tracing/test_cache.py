"""The ray tracer that is kept between bakes."""

import numpy as np

from obscurance_addon.core.obscurance.bake import bake_obscurances
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.cache import BYTES_PER_TRIANGLE, IntersectorCache
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from tests.core.scenes import box, floor, scene

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
TRIANGLES = np.array([[0, 1, 2], [0, 1, 3]], np.int32)


class Counting:
    """Builds, and counts how often."""

    def __init__(self):
        self.built = 0

    def __call__(self, *arguments):
        self.built += 1
        return EmbreeIntersector(*arguments)


def cache(ceiling=1 << 20):
    made = IntersectorCache(Counting())
    made.ceiling_bytes = ceiling
    return made


def test_equal_arrays_are_built_once():
    kept = cache()
    assert kept(VERTICES, TRIANGLES) is kept(VERTICES.copy(), TRIANGLES.copy())
    assert kept._build.built == 1


def test_any_difference_builds_anew():
    """A vertex moved by one unit in the last place of single precision, a triangle turned over, a vertex more."""
    moved = VERTICES.copy()
    moved[3, 2] = np.nextafter(np.float32(1.0), np.float32(2.0))
    for vertices, triangles in (
        (moved, TRIANGLES),
        (VERTICES, TRIANGLES[:, ::-1]),
        (np.tile(VERTICES, (2, 1)), TRIANGLES),
    ):
        kept = cache()
        assert kept(VERTICES, TRIANGLES) is not kept(vertices, triangles)
        assert kept._build.built == 2


def test_above_the_ceiling_nothing_is_kept():
    """Exactly at the ceiling it is."""
    size = BYTES_PER_TRIANGLE * len(TRIANGLES)
    for ceiling, built in ((size, 1), (size - 1, 2), (0, 2)):
        kept = cache(ceiling)
        kept(VERTICES, TRIANGLES)
        kept(VERTICES, TRIANGLES)
        assert kept._build.built == built


def test_clearing_lets_go():
    kept = cache()
    first = kept(VERTICES, TRIANGLES)
    kept.clear()
    assert kept(VERTICES, TRIANGLES) is not first


def test_a_bake_is_the_same_with_it():
    """Bit for bit, first and second time."""
    baked = scene([box((0, 0, 0), (1, 1, 1), n=3)], [floor((-1, -1), (2, 2))])
    surfaces, patches = baked.surfaces, baked.patches
    kept = cache()
    plain = bake_obscurances(surfaces, patches, BakeSettings(rays=16))
    for _ in range(2):
        again = bake_obscurances(surfaces, patches, BakeSettings(rays=16), intersector=kept)
        assert np.array_equal(again.coloured, plain.coloured)
    assert kept._build.built == 1
