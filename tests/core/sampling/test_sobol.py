"""The point set: the known Sobol points, and what nested scrambling must keep and must break."""

import itertools

import numpy as np
import pytest

from obscurance_addon.core.sampling import sobol


def scrambled(count: int, scrambles: int, salt: int = 0) -> np.ndarray:
    """(scrambles, count, 4) float64."""
    seeds = sobol.hash32(np.arange(salt, salt + 4 * scrambles, dtype=np.uint32)).reshape(scrambles, 1, 4)
    return sobol.to_unit(sobol.owen_scramble(sobol.sobol_points(0, count), seeds))


def test_first_points_are_those_of_joe_and_kuo():
    points = sobol.sobol_points(0, 8) / 2.0**32
    known = np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25, 0.25],
            [0.25, 0.75, 0.75, 0.75],
            [0.375, 0.375, 0.625, 0.875],
            [0.875, 0.875, 0.125, 0.375],
            [0.625, 0.125, 0.875, 0.625],
            [0.125, 0.625, 0.375, 0.125],
        ]
    )
    assert {tuple(p) for p in points} == {tuple(p) for p in known}


def test_a_range_is_a_part_of_the_sequence():
    np.testing.assert_array_equal(sobol.sobol_points(37, 100), sobol.sobol_points(0, 137)[37:])


def elementary_boxes_hold_one_point(points: np.ndarray, m: int) -> bool:
    """Whether 2^m points of the unit square put one into each box of area 2^-m with sides of powers of two."""
    for a in range(m + 1):
        cell = (points * [2**a, 2 ** (m - a)]).astype(int)
        if len(np.unique(cell[:, 0] * 2 ** (m - a) + cell[:, 1])) < 2**m:
            return False
    return True


@pytest.mark.parametrize("scramble", [None, 0, 1, 2])
def test_first_two_dimensions_are_a_net(scramble):
    """Every aligned run of 2^m points is a (0, m, 2)-net, before and after scrambling."""
    points = sobol.to_unit(sobol.sobol_points(0, 1024)) if scramble is None else scrambled(1024, 3)[scramble]
    for m in range(1, 11):
        for first in range(0, 1024, 2**m):
            assert elementary_boxes_hold_one_point(points[first : first + 2**m, :2], m)


def test_every_dimension_is_stratified_after_scrambling():
    for points in scrambled(4096, 8):
        np.testing.assert_array_equal(
            np.sort((points * 4096).astype(int), axis=0), np.arange(4096)[:, None].repeat(4, 1)
        )


def test_scrambling_is_nested():
    """Points that share exactly their first k digits share exactly their first k digits afterwards."""
    rng = np.random.default_rng(1)
    x = rng.integers(0, 2**32, 4000, dtype=np.uint32)
    common = rng.integers(0, 32, 4000)
    flip = np.uint32(1) << (31 - common).astype(np.uint32)
    noise = rng.integers(0, 2**32, 4000, dtype=np.uint32) & (flip - np.uint32(1))
    seed = np.uint32(0x1234567)
    difference = sobol.owen_scramble(x, seed) ^ sobol.owen_scramble(x ^ flip ^ noise, seed)
    np.testing.assert_array_equal(np.floor(np.log2(difference.astype(np.float64))), 31 - common)


def test_different_scrambles_are_independent():
    """Means of a smooth function over many scrambles average out as N^-1/2 of their number."""
    product = scrambled(16, 4096).prod(-1).mean(-1)
    error = product.std(ddof=1) / np.sqrt(len(product))
    assert error < 2e-4
    assert abs(product.mean() - 2.0**-4) < 5.0 * error


@pytest.mark.parametrize(("i", "j"), list(itertools.combinations(range(4), 2)))
def test_dimensions_of_one_point_are_uncorrelated_over_scrambles(i, j):
    """The first point of 8192 scrambles behaves like independent uniform numbers."""
    first = scrambled(1, 8192)[:, 0] - 0.5
    assert abs(np.mean(first[:, i] * first[:, j])) < 5.0 / 12.0 / np.sqrt(8192)


def test_unit_numbers_stay_inside_the_open_interval():
    unit = sobol.to_unit(np.array([0, 2**32 - 1], np.uint32))
    assert 0.0 < unit[0] < unit[1] < 1.0
    assert unit[0] == 1.0 - unit[1]


def test_hash_is_a_bijection_on_a_sample_and_avalanches():
    x = np.arange(1 << 16, dtype=np.uint32)
    assert len(np.unique(sobol.hash32(x))) == 1 << 16
    for bit in range(32):
        flipped = sobol.hash32(x) ^ sobol.hash32(x ^ np.uint32(1 << bit))
        share = np.array([(flipped >> np.uint32(k) & np.uint32(1)).mean() for k in range(32)])
        assert (np.abs(share - 0.5) < 0.05).all()
