"""Texels as patches: exactly what triangles cover of each, whatever their size, shape and place."""

import itertools

import numpy as np
import pytest

from obscurance_addon.core.lightmap.texels import MIN_COVER, covered_texels
from obscurance_addon.core.lightmap.triangles import AtlasTriangles, charts_of
from obscurance_addon.core.scene.patches import Normalisation
from tests.core.scenes import rotation

SIZE = 64
DENSITY = 10.0  # texels per metre of the flat maps here
ROUNDING = 1e-9  # of areas in texels, whose corners have coordinates up to 64


def atlas(uv, corners=None, *, chart=0, face=None, page=0):
    """Triangles (t, 3, 2) of an atlas; without corners they lie in the plane z = 0.3."""
    uv = np.asarray(uv, float).reshape(-1, 3, 2)
    if corners is None:
        corners = np.concatenate([uv / DENSITY, np.full((*uv.shape[:2], 1), 0.3)], -1)
    n = len(uv)
    chart, page = np.broadcast_to(chart, n), np.broadcast_to(page, n)
    face = np.arange(n) if face is None else np.broadcast_to(face, n)
    return AtlasTriangles.of(corners, uv, page, chart, face, Normalisation(np.zeros(3), 1.0))


def texels(triangles, rows=(0, SIZE), page=0):
    return covered_texels(triangles, SIZE, page, rows)


def positions(found):
    return found.positions(np.arange(len(found)))


def uneven_grid(low, high, n, seed=0):
    """n x n quads of two triangles over a square of the map, their inner corners moved at random; (2 n n, 3, 2)."""
    step = (high - low) / n
    y, x = np.mgrid[: n + 1, : n + 1]
    node = np.stack([x, y], -1).astype(float)
    node[1:-1, 1:-1] += np.random.default_rng(seed).uniform(-0.3, 0.3, (n - 1, n - 1, 2))
    node = low + step * node
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]
    return np.stack([a, b, c, a, c, d], 2).reshape(-1, 3, 2)


def rectangle(x0, y0, x1, y1):
    return [[(x0, y0), (x1, y0), (x1, y1)], [(x0, y0), (x1, y1), (x0, y1)]]


def clipped_area(triangle, x, y):
    """Area of a counter-clockwise triangle within the texel (x, y), after Sutherland and Hodgman."""
    polygon = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        away = [(b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) for p in polygon]
        clipped = []
        for (p, u), (q, v) in zip(zip(polygon, away, strict=True), _rolled(polygon, away), strict=True):
            if u >= 0:
                clipped.append(p)
            if (u >= 0) != (v >= 0):
                clipped.append(tuple(np.add(p, np.subtract(q, p) * (u / (u - v)))))
        polygon = clipped
        if not polygon:
            return 0.0
    px, py = np.array(polygon).T
    return 0.5 * float(px @ np.roll(py, -1) - py @ np.roll(px, -1))


def _rolled(polygon, away):
    return zip(polygon[1:] + polygon[:1], away[1:] + away[:1], strict=True)


RANDOM = np.random.default_rng(1)
SHAPES = {
    "large": RANDOM.uniform(2, 30, (20, 3, 2)),
    "smaller than a texel": RANDOM.uniform(2, 30, (40, 1, 2)) + RANDOM.uniform(0, 0.4, (40, 3, 2)),
    "slivers": np.cumsum(RANDOM.uniform(0, 12, (20, 3, 2)) + RANDOM.uniform(0, 1e-3, (20, 3, 2)) * [[[1, -1]]], 1),
    "thin and level": np.add(RANDOM.uniform(0, 0.001, (20, 3, 2)), [[3, 7], [25, 7], [14, 7]]),
    "thin and upright": np.add(RANDOM.uniform(0, 0.001, (20, 3, 2)), [[7, 3], [7, 25], [7, 14]]),
    "with corners on texel corners": RANDOM.integers(0, 12, (40, 3, 2)).astype(float),
    "partly off the page": RANDOM.uniform(-12, 12, (20, 3, 2)),
    "partly off the far side": RANDOM.uniform(SIZE - 12, SIZE + 12, (20, 3, 2)),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_covers_are_those_of_clipping_one_texel_after_the_other(shape):
    for triangle in SHAPES[shape]:
        signed = np.cross(*(triangle[1:] - triangle[0]))
        if abs(signed) < 1e-6:
            continue
        found = texels(atlas(triangle))
        uv = triangle if signed > 0 else triangle[::-1]
        low = np.clip(np.floor(uv.min(0)).astype(int), 0, SIZE)
        high = np.clip(np.ceil(uv.max(0)).astype(int), 0, SIZE)
        exact = np.zeros(SIZE * SIZE)
        for y, x in itertools.product(range(low[1], high[1]), range(low[0], high[0])):
            exact[y * SIZE + x] = clipped_area(uv, x, y)
        cover = np.zeros(SIZE * SIZE)
        cover[found.index] = found.cover
        np.testing.assert_allclose(cover, np.where(exact > MIN_COVER, exact, 0.0), rtol=0, atol=ROUNDING)


GRIDS = {"hundreds in a texel": (3.3, 6.7, 60), "a texel each": (2.2, 40.9, 40), "many texels each": (1.6, 60.3, 3)}


@pytest.mark.parametrize("kind", GRIDS)
def test_a_chart_is_covered_once_and_no_more(kind):
    """Covers add up to the area of the map and areas to that of a bumpy surface; inside the chart they are 1."""
    uv = uneven_grid(*GRIDS[kind])
    corners = np.concatenate([uv / DENSITY, np.sin(uv.sum(-1, keepdims=True))], -1)
    found = texels(atlas(uv, corners))
    low, high, n = GRIDS[kind]
    dropped = MIN_COVER * 4 * len(uv)  # a triangle no larger than a texel has four parts or less
    assert found.cover.sum() == pytest.approx((high - low) ** 2, rel=0, abs=dropped)
    side = corners[:, 1:] - corners[:, :1]
    surface = 0.5 * np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1)
    uv_area = 0.5 * ((high - low) / n) ** 2
    assert found.area.sum() == pytest.approx(surface.sum(), rel=0, abs=dropped * surface.max() / uv_area * 10)
    inside = np.arange(int(np.ceil(low)), int(high))
    middle = np.isin(found.index, (inside[:, None] * SIZE + inside).ravel())
    assert np.count_nonzero(middle) == len(inside) ** 2
    np.testing.assert_allclose(found.cover[middle], 1.0, rtol=0, atol=MIN_COVER * 2 * len(uv) / len(inside) ** 2 + 1e-9)
    assert not len(found.overlap)


@pytest.mark.parametrize("kind", GRIDS)
def test_cells_of_a_texel_share_it_out(kind):
    """Weights add up to 1, cells come in the order of their texels, and each texel has cells of one kind."""
    found = texels(atlas(uneven_grid(*GRIDS[kind])))
    for cells in (found.whole, found.parts):
        assert (np.diff(cells.patch) >= 0).all()
        np.testing.assert_allclose(np.bincount(cells.patch, cells.weight)[np.unique(cells.patch)], 1.0, rtol=1e-12)
    assert found.whole.are_parallelograms
    assert not found.parts.are_parallelograms
    np.testing.assert_array_equal(
        np.sort(np.concatenate([found.whole.patch, np.unique(found.parts.patch)])), np.arange(len(found))
    )
    assert (np.diff(found.index) > 0).all()
    assert len(np.unique(found.ids)) == len(found)


def cell_areas(cells):
    edge = cells.frames[:, :2, :3].astype(float)
    area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)
    return area if cells.are_parallelograms else 0.5 * area


def test_the_areas_of_cells_are_those_of_their_texels():
    found = texels(atlas(uneven_grid(2.2, 40.9, 7)))
    area = sum(np.bincount(c.patch, cell_areas(c), len(found)) for c in (found.whole, found.parts))
    np.testing.assert_allclose(area, found.area, rtol=1e-5)  # float32 frames; the smallest parts lose most digits


@pytest.mark.parametrize("cuts", [[0, 16, 32, SIZE], [0, 1, 2, 3, 40, 41, SIZE], range(SIZE + 1)])
def test_bands_hold_the_same_texels(cuts):
    """Bit for bit, for two charts that touch."""
    uv = np.concatenate([uneven_grid(2.2, 30.9, 12), np.add(uneven_grid(2.2, 30.9, 9, 1), [28.7, 0])])
    triangles = atlas(uv, chart=np.repeat([0, 1], [288, 162]))
    whole = texels(triangles)
    bands = [texels(triangles, rows) for rows in itertools.pairwise(cuts)]
    for name in ("index", "chart", "face", "cover", "area", "normal"):
        np.testing.assert_array_equal(np.concatenate([getattr(band, name) for band in bands]), getattr(whole, name))
    for name in ("whole", "parts"):
        frames = np.concatenate([getattr(band, name).frames for band in bands])
        np.testing.assert_array_equal(frames, getattr(whole, name).frames)


def test_positions_lie_on_the_surface_where_the_map_says():
    """A tilted plane: each place is the image of its covered part's centre; cells lie a ray offset above it."""
    turn = rotation(3)
    uv = uneven_grid(2.2, 40.9, 8)
    flat = np.concatenate([uv / DENSITY, np.full((*uv.shape[:2], 1), 0.3)], -1)
    triangles = atlas(uv, flat @ turn.T)
    found = texels(triangles)
    x, y = found.index % SIZE, found.index // SIZE
    low, high = (np.clip([x + k, y + k], 2.2, 40.9) for k in (0, 1))  # what the chart's outline leaves of a texel
    exact = np.stack([*((low + high) / 2 / DENSITY), np.full(len(found), 0.3)], -1)
    np.testing.assert_allclose(positions(found) @ turn, exact, rtol=0, atol=1e-6)  # parts below MIN_COVER are missing
    np.testing.assert_allclose(found.normal, np.tile(turn[:, 2], (len(found), 1)), rtol=0, atol=1e-6)
    for cells in (found.whole, found.parts):
        origins = np.einsum("k,nkj->nj", [0.3, 0.2, 1.0], cells.frames[..., :3].astype(float))
        np.testing.assert_allclose(origins @ turn[:, 2], 0.3 + cells.offset, rtol=0, atol=1e-6)


@pytest.mark.parametrize("mirror", [[-1, 1], [1, -1]])
def test_mirrored_maps_give_outward_normals(mirror):
    uv = uneven_grid(2, 40, 8)
    corners = np.concatenate([uv / DENSITY, np.full((*uv.shape[:2], 1), 0.3)], -1)
    plain, mirrored = texels(atlas(uv, corners)), texels(atlas((uv - 21) * mirror + 21, corners))
    np.testing.assert_array_equal(mirrored.normal, np.tile([0.0, 0.0, 1.0], (len(mirrored), 1)))
    assert len(mirrored) == len(plain) == 38 * 38
    image = plain.index.reshape(38, 38)[:: mirror[1], :: mirror[0]].ravel() - 2 * SIZE - 2
    order = np.searchsorted(plain.index, image + 2 * SIZE + 2)
    np.testing.assert_allclose(positions(mirrored), positions(plain)[order], rtol=0, atol=1e-6)
    np.testing.assert_allclose(mirrored.area, plain.area[order], rtol=1e-4)


USELESS = {
    "not a number": [(np.nan, 1), (5, 1), (5, 5)],
    "infinite": [(1, 1), (np.inf, 1), (5, 5)],
    "no area": [(1, 1), (5, 5), (9, 9)],
    "a point": [(3.5, 3.5)] * 3,
    "less area than counts": [(1, 1), (1 + 1e-5, 1), (1, 1 + 1e-5)],
}


@pytest.mark.parametrize("kind", USELESS)
def test_triangles_without_a_map_have_no_place(kind):
    corners = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]] * 3, float)
    triangles = atlas([USELESS[kind], [(10, 10), (12, 10), (10, 12)], USELESS[kind]], corners)
    np.testing.assert_array_equal(triangles.face, [1])
    assert triangles.texels() == pytest.approx(2.0)


def test_triangles_that_cannot_be_traced_have_no_place():
    corners = np.array([[(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 0, 0), (np.nan, 0, 0), (0, 1, 0)]], float)
    assert not len(atlas(rectangle(1, 1, 5, 5), corners))


@pytest.mark.parametrize("shift", [(-SIZE, 0), (SIZE, 0), (0, -SIZE), (0, SIZE), (1e9, 0), (0, -1e12)])
def test_triangles_off_the_page_cover_nothing(shift):
    assert not len(texels(atlas(np.add(rectangle(1, 1, SIZE - 1, SIZE - 1), shift))))


def test_a_page_has_its_own_texels():
    triangles = atlas(
        [*rectangle(1, 1, 5, 5), *rectangle(2, 2, 4, 4), *rectangle(1, 1, 9, 9)], page=[0, 0, 1, 1, -1, -1]
    )
    assert [len(texels(triangles, page=page)) for page in (0, 1, 2)] == [16, 4, 0]
    assert not set(texels(triangles).ids) & set(texels(triangles, page=1).ids)


@pytest.mark.parametrize("chart", [0, [0, 0, 1, 1]])
def test_overlaps_are_named_by_face(chart):
    """Two rectangles share 3 x 2 whole texels and parts of others, where they still leave room for each other."""
    found = texels(atlas([*rectangle(2, 2, 9, 9), *rectangle(6, 7, 20, 20)], face=[4, 4, 7, 7], chart=chart))
    np.testing.assert_array_equal(found.overlap_face, np.tile([4, 7], 6))
    np.testing.assert_array_equal(
        np.unique(found.index[found.overlap]), [y * SIZE + x for y in (7, 8) for x in (6, 7, 8)]
    )
    assert found.cover.max() == 1.0


@pytest.mark.parametrize("kind", GRIDS)
def test_neighbours_do_not_overlap(kind):
    """Every triangle is a face, and half of them a chart of their own."""
    uv = uneven_grid(*GRIDS[kind])
    assert not len(texels(atlas(uv, chart=np.arange(len(uv)) // 2)).overlap)


@pytest.mark.parametrize(("border", "winner"), [(6.3, 1), (6.7, 0)])
def test_a_texel_at_the_border_of_two_charts_goes_to_the_one_that_covers_more(border, winner):
    """It is that chart's part alone, whatever number of triangles the other has."""
    left, right = rectangle(2, 2, border, 10), uneven_grid(border, border + 8, 20) - [0, border - 2]
    found = texels(atlas([*left, *right], chart=np.repeat([0, 1], [2, 800])))
    middle = found.index % SIZE == 6
    assert np.count_nonzero(middle) == 8
    np.testing.assert_array_equal(found.chart[middle], winner)
    share = max(border - 6, 7 - border)
    np.testing.assert_allclose(found.cover[middle], share, rtol=0, atol=MIN_COVER * 800)
    x = (6 + border) / 2 if winner == 0 else (7 + border) / 2
    np.testing.assert_allclose(positions(found)[middle, 0] * DENSITY, x, rtol=0, atol=MIN_COVER * 800)


def test_charts_hang_together_by_vertex_and_place():
    """A strip of four quads on a ring of eight vertices: cut once on the map it is one chart, cut twice it is two."""
    quads = np.array([(i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)])
    triangles = (np.arange(4)[:, None] * 4 + [0, 1, 2, 0, 2, 3]).reshape(-1, 3)
    uv = np.array([[(i, 0), (i + 1, 0), (i + 1, 1), (i, 1)] for i in range(4)], float)
    np.testing.assert_array_equal(charts_of(quads.ravel(), uv.reshape(-1, 2), triangles), 0)
    uv[2:] += [0, 1.0 / 8]
    np.testing.assert_array_equal(charts_of(quads.ravel(), uv.reshape(-1, 2), triangles), [0, 0, 0, 0, 1, 1, 1, 1])
    apart = np.arange(16)  # the same places, but no vertex in common
    np.testing.assert_array_equal(charts_of(apart, uv.reshape(-1, 2), triangles), np.repeat(np.arange(4), 2))


def test_charts_survive_maps_that_are_none():
    uv = np.full((6, 2), np.nan)
    uv[:3] = [(0, 0), (1, 0), (0, np.inf)]
    assert len(charts_of(np.arange(6), uv, np.arange(6).reshape(2, 3))) == 2
    assert not len(charts_of(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 3), int)))
