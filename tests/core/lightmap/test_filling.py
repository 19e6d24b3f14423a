"""Values that spread from texel to texel: inside of a chart, and from its border into the empty margin."""

import numpy as np
import pytest

from obscurance_addon.core.lightmap.filling import dilate, fill_inside_charts

N = 32


def page(*rectangles):
    """Pixels (N N, 2) and charts (N N,) of rectangles x0, y0, x1, y1; a texel's value is its chart + 1, and its x."""
    chart = np.full((N, N), -1, np.int32)
    pixels = np.zeros((N, N, 2), np.float32)
    for k, (x0, y0, x1, y1) in enumerate(rectangles):
        chart[y0:y1, x0:x1] = k
        pixels[y0:y1, x0:x1, 0] = k + 1
        pixels[y0:y1, x0:x1, 1] = np.arange(x0, x1)
    return pixels.reshape(-1, 2), chart.ravel()


def distances(rectangle):
    """Rings between each texel of the page and a rectangle: the Chebyshev distance, 0 inside; (N, N)."""
    x0, y0, x1, y1 = rectangle
    y, x = np.mgrid[:N, :N]
    return np.maximum.reduce([x0 - x, x - x1 + 1, y0 - y, y - y1 + 1, np.zeros_like(x)])


@pytest.mark.parametrize("rings", [0, 1, 2, 5, 40])
@pytest.mark.parametrize("place", [(10, 12, 15, 18), (0, 0, 3, 2), (N - 2, N - 4, N, N), (0, 0, N, N)])
def test_dilation_reaches_as_many_rings_as_asked(rings, place):
    """Also at the borders of the page, past which nothing is carried to the other side."""
    pixels, chart = page(place)
    before = pixels.copy(), chart.copy()
    dilate(pixels, chart, N, rings)
    reached = (distances(place) <= rings).ravel()
    np.testing.assert_array_equal(chart, np.where(reached, 0, -1))
    np.testing.assert_array_equal(pixels[:, 0], reached)
    covered = before[1] >= 0
    np.testing.assert_array_equal(pixels[covered], before[0][covered])
    np.testing.assert_array_equal(pixels[~reached], 0.0)
    assert pixels[:, 1].max() <= place[2] - 1  # means never leave the range of what they are of


def test_a_margin_texel_is_the_mean_of_its_neighbours_in_the_chart():
    pixels, chart = page((10, 10, 14, 14))
    dilate(pixels, chart, N, 1)
    x = pixels[:, 1].reshape(N, N)
    np.testing.assert_array_equal(x[9, 9:15], [10.0, 10.5, 11.0, 12.0, 12.5, 13.0])
    np.testing.assert_array_equal(x[10:14, 14], 13.0)


@pytest.mark.parametrize("gap", range(1, 8))
@pytest.mark.parametrize("rings", [1, 3, 10])
def test_dilation_meets_but_never_mixes_charts(gap, rings):
    """Each takes the half that is nearer; the middle of an odd gap goes to the higher number."""
    one, other = (0, 0, 8, N), (8 + gap, 0, 16 + gap, N)
    pixels, chart = page(one, other)
    dilate(pixels, chart, N, rings)
    near, far = distances(one), distances(other)
    owner = np.where(far <= near, 1, 0)
    expected = np.where(np.minimum(near, far) <= rings, owner, -1)
    np.testing.assert_array_equal(chart.reshape(N, N), expected)
    np.testing.assert_array_equal(pixels[:, 0], chart + 1)


def test_dilation_between_many_charts_takes_the_nearest():
    """Scattered texels, each a chart: the owner of any texel is among those nearest in rings, and nothing is mixed."""
    random = np.random.default_rng(5)
    at = random.choice(N * N, 40, replace=False)
    chart, pixels = np.full(N * N, -1, np.int32), np.zeros((N * N, 1), np.float32)
    chart[at], pixels[at, 0] = np.arange(40), np.arange(1, 41)
    dilate(pixels, chart, N, 3)
    away = np.maximum(abs(np.arange(N * N)[:, None] // N - at // N), abs(np.arange(N * N)[:, None] % N - at % N))
    nearest = away.min(1)
    np.testing.assert_array_equal(chart >= 0, nearest <= 3)
    filled = np.flatnonzero(chart >= 0)
    np.testing.assert_array_equal(away[filled, chart[filled]], nearest[filled])
    np.testing.assert_array_equal(pixels[filled, 0], chart[filled] + 1)


def test_dilation_of_an_empty_page_does_nothing():
    pixels, chart = page()
    dilate(pixels, chart, N, 5)
    assert not pixels.any()
    assert (chart == -1).all()


def hole(x0, y0, x1, y1):
    y, x = np.mgrid[y0:y1, x0:x1]
    return (y * N + x).ravel()


def test_holes_are_filled_inwards_ring_by_ring():
    """A hole of 5 x 1 texels in a strip: each end is what is beside it, and the middle their mean."""
    pixels, chart = page((4, 6, 20, 7))
    missing = hole(8, 6, 13, 7)
    pixels[missing] = 99.0
    assert not len(fill_inside_charts(pixels, chart, missing, N))
    np.testing.assert_array_equal(pixels[missing, 1], [7, 7, 10, 13, 13])
    np.testing.assert_array_equal(pixels[missing, 0], 1.0)


def test_a_hole_in_a_plane_takes_only_what_is_around_it():
    pixels, chart = page((2, 2, 20, 20))
    missing = hole(5, 5, 12, 12)
    pixels[missing] = np.nan
    assert not len(fill_inside_charts(pixels, chart, missing, N))
    x = pixels[:, 1].reshape(N, N)[5:12, 5:12]
    assert x.min() >= 4.0
    assert x.max() <= 12.0
    np.testing.assert_allclose(x + x[:, ::-1], 16.0, rtol=0, atol=1e-5)  # symmetric about the hole's middle, x = 8
    np.testing.assert_array_equal(x, x[::-1])


def test_holes_are_not_filled_from_other_charts():
    """A hole at the border of two charts; a chart without any value is left and named; so is an island of one."""
    pixels, chart = page((0, 0, 10, 10), (10, 0, 20, 10), (20, 0, 24, 10), (0, 20, 3, 23))
    missing = np.sort(np.concatenate([hole(8, 2, 12, 6), hole(20, 0, 24, 10)]))
    pixels[missing] = np.nan
    alone = fill_inside_charts(pixels, chart, missing, N)
    np.testing.assert_array_equal(alone, hole(20, 0, 24, 10))
    rest = chart != 2
    np.testing.assert_array_equal(pixels[rest, 0], chart[rest] + 1)
    assert np.isnan(pixels[alone]).all()


def test_texels_of_one_chart_that_do_not_touch_do_not_fill_each_other():
    """A chart in two pieces, one of them without values: fill goes from neighbour to neighbour only."""
    pixels, chart = page((0, 0, 4, 4), (8, 0, 12, 4))
    chart[chart == 1] = 0
    missing = hole(8, 0, 12, 4)
    np.testing.assert_array_equal(fill_inside_charts(pixels, chart, missing, N), missing)


def test_the_sides_of_the_page_do_not_touch():
    """The last texel of a row and the first of the next are no neighbours."""
    pixels, chart = page((0, 0, 1, N), (N - 1, 0, N, N))
    chart[chart == 1] = 0
    missing = hole(N - 1, 0, N, N)
    np.testing.assert_array_equal(fill_inside_charts(pixels, chart, missing, N), missing)


def test_nothing_missing_changes_nothing():
    pixels, chart = page((2, 2, 20, 20))
    before = pixels.copy()
    assert not len(fill_inside_charts(pixels, chart, np.zeros(0, np.int64), N))
    np.testing.assert_array_equal(pixels, before)


def test_filling_does_not_depend_on_where_the_page_lies():
    """The same charts a few texels on have the same bits."""
    random = np.random.default_rng(2)
    values = random.random((9, 9)).astype(np.float32)
    lacking = random.random((9, 9)) < 0.6
    found = []
    for x, y in ((3, 3), (14, 17)):
        pixels, chart = np.zeros((N, N, 1), np.float32), np.full((N, N), -1, np.int32)
        pixels[y : y + 9, x : x + 9, 0], chart[y : y + 9, x : x + 9] = values, 0
        unknown = np.zeros((N, N), bool)
        unknown[y : y + 9, x : x + 9] = lacking
        pixels, chart = pixels.reshape(-1, 1), chart.ravel()
        fill_inside_charts(pixels, chart, np.flatnonzero(unknown), N)
        dilate(pixels, chart, N, 3)
        found.append(pixels.reshape(N, N)[y - 3 : y + 12, x - 3 : x + 12])
    np.testing.assert_array_equal(*found)
