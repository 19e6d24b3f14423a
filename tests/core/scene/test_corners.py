"""Cells around corners cover each face exactly once, and fans follow the shading."""

import itertools

import numpy as np
import pytest

from obscurance_addon.core.scene.corners import corner_cells, face_of_corner, next_corner, smooth_fans

SQUARE = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
L_SHAPE = [(0, 0, 0), (3, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]
L_TRIANGLES = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
COMB = [(0, 0, 0), (5, 0, 0), (5, 3, 0), (4, 3, 0), (4, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]
COMB_TRIANGLES = [(0, 1, 4), (1, 2, 3), (1, 3, 4), (0, 4, 5), (0, 5, 6), (0, 6, 7)]
BENT = [(0, 0, 0), (2, 0, 0), (2, 2, 1), (0, 2, 0)]


def triangle_areas(triangles):
    """(n,) areas of triangles (n, 3, 3)."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def cut(points, triangles=None):
    """Cells and corners of one face; a fan from the first corner unless told how the face is triangulated."""
    points = np.array(points, float)
    n = len(points)
    triangles = np.array(triangles or [(0, i, i + 1) for i in range(1, n - 1)])
    return corner_cells(points, np.array([0, n]), triangles, np.zeros(len(triangles), int))


def area_per_corner(points, triangles=None):
    cells, corner = cut(points, triangles)
    return np.bincount(corner, triangle_areas(cells[..., :3]), len(points))


def test_corners_follow_each_other_around_their_face():
    """A triangle, an empty face and a quad."""
    start = np.array([0, 3, 3, 7])
    assert next_corner(start).tolist() == [1, 2, 0, 4, 5, 6, 3]
    assert face_of_corner(start).tolist() == [0, 0, 0, 2, 2, 2, 2]


def test_corners_of_a_square_get_a_quarter_each():
    """Corner, midpoints of its edges, centre."""
    cells, corner = cut(SQUARE)
    assert area_per_corner(SQUARE).tolist() == [1.0] * 4
    own = cells[corner == 2].reshape(-1, 3)
    assert set(map(tuple, own)) == {(2, 2, 0), (1, 2, 0), (2, 1, 0), (1, 1, 0)}


def test_corners_of_a_triangle_get_a_third_each():
    """Whatever its shape."""
    points = [(0, 0, 0), (7, 1, 2), (-1, 4, 0)]
    assert np.allclose(area_per_corner(points), triangle_areas(np.array([points], float))[0] / 3)


@pytest.mark.parametrize(
    ("points", "triangles"), [(SQUARE, None), (L_SHAPE, L_TRIANGLES), (COMB, COMB_TRIANGLES), (BENT, None)]
)
def test_cells_cover_the_face_once(points, triangles):
    """Areas add up, and every cell turns the way of the triangle it lies in: no part is missed or counted twice."""
    cells, corner = cut(points, triangles)
    flat = np.array(points, float)[np.array(triangles or [(0, 1, 2), (0, 2, 3)])]
    assert triangle_areas(cells).sum() == pytest.approx(triangle_areas(flat).sum(), rel=1e-12)
    normals = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    unit = normals / np.linalg.norm(normals, axis=1)[:, None]
    for cell in cells:
        own = np.cross(cell[1] - cell[0], cell[2] - cell[0])
        inside = [
            k
            for k in range(len(flat))
            if np.allclose((cell - flat[k, 0]) @ unit[k], 0.0, atol=1e-12) and _contains(flat[k], cell.mean(0))
        ]
        assert inside
        assert all(own @ unit[k] > 0.0 for k in inside)
    assert set(corner.tolist()) == set(range(len(points)))


def _contains(triangle, point):
    a, b, c = triangle
    weights = np.linalg.lstsq(np.stack([b - a, c - a], 1), point - a, rcond=None)[0]
    return (weights > -1e-9).all() and weights.sum() < 1.0 + 1e-9


def test_further_columns_go_along():
    """A column that is an affine function of the position stays that function in every cell, bent faces included."""
    for points in (SQUARE, BENT):
        points = np.array(points, float)
        extra = points @ [1.0, -2.0, 0.5] + 3.0
        cells, _ = cut(np.column_stack([points, extra]))
        assert np.allclose(cells[..., 3], cells[..., :3] @ [1.0, -2.0, 0.5] + 3.0)


def test_each_face_is_cut_by_itself():
    """A plain square keeps its cells whatever lies beside it in the same mesh."""
    alone, corner_alone = cut(SQUARE)
    points = np.array(SQUARE + L_SHAPE, float)
    triangles = np.array([(0, 1, 2), (0, 2, 3), *(tuple(4 + i for i in t) for t in L_TRIANGLES)])
    face = np.array([0, 0, 1, 1, 1, 1])
    cells, corner = corner_cells(points, np.array([0, 4, 10]), triangles, face)
    assert np.array_equal(cells[corner < 4], alone)
    assert np.array_equal(corner[corner < 4], corner_alone)
    assert triangle_areas(cells[corner >= 4]).sum() == pytest.approx(5.0)


def test_vertices_that_are_not_finite_spoil_their_own_face_only():
    """The square beside a face with a NaN is cut as ever."""
    points = np.array(SQUARE * 2, float)
    points[5] = np.nan
    triangles = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    cells, corner = corner_cells(points, np.array([0, 4, 8]), triangles, np.array([0, 0, 1, 1]))
    assert np.bincount(corner[corner < 4], triangle_areas(cells[corner < 4])).tolist() == [1.0] * 4


# -------------------------------------------------------------------------------------------------------------- fans


class Mesh:
    """Corners and edges of faces, with shading; arguments for `smooth_fans`."""

    def __init__(self, points, faces, sharp=(), flat=()):
        self.faces = faces
        self.vertex = np.array([v for f in faces for v in f])
        self.start = np.cumsum([0] + [len(f) for f in faces])
        pairs = [tuple(sorted(p)) for f in faces for p in zip(f, (*f[1:], f[0]), strict=True)]
        self.edges = sorted(set(pairs))
        self.edge = np.array([self.edges.index(p) for p in pairs])
        self.points = np.array(points, float)[self.vertex]
        self.sharp = np.array([e in {tuple(sorted(s)) for s in sharp} for e in self.edges])
        self.flat = np.isin(np.arange(len(faces)), flat)

    def fans(self):
        triangles = [
            (a, a + i, a + i + 1) for a, f in zip(self.start, self.faces, strict=False) for i in range(1, len(f) - 1)
        ]
        owner = np.repeat(np.arange(len(self.faces)), [len(f) - 2 for f in self.faces])
        return smooth_fans(
            self.points, self.start, np.array(triangles), owner, self.vertex, self.edge, self.sharp, self.flat
        )

    def fans_at(self, vertex):
        """The corners of a vertex, by fan, as sets of faces."""
        labels, face = self.fans(), face_of_corner(self.start)
        at = np.flatnonzero(self.vertex == vertex)
        return {frozenset(face[at[labels[at] == label]].tolist()) for label in set(labels[at].tolist())}


CUBE_POINTS = list(itertools.product((0, 1), repeat=3))
CUBE = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE_EDGES = [(a, b) for a, b in itertools.combinations(range(8), 2) if bin(a ^ b).count("1") == 1]
GRID_POINTS = [(x, y, 0) for y in range(3) for x in range(3)]
GRID = [(0, 1, 4, 3), (1, 2, 5, 4), (3, 4, 7, 6), (4, 5, 8, 7)]


def test_a_smooth_cube_has_a_fan_for_each_vertex():
    """Eight labels, one per vertex, each the smallest of its corners."""
    mesh = Mesh(CUBE_POINTS, CUBE)
    labels = mesh.fans()
    assert len(set(labels.tolist())) == 8
    for vertex in range(8):
        at = np.flatnonzero(mesh.vertex == vertex)
        assert (labels[at] == at.min()).all()


@pytest.mark.parametrize("shading", [{"sharp": CUBE_EDGES}, {"flat": range(6)}])
def test_a_hard_cube_has_a_fan_for_each_corner(shading):
    """Sharp edges and flat faces part all 24 corners."""
    assert Mesh(CUBE_POINTS, CUBE, **shading).fans().tolist() == list(range(24))


def test_one_flat_face_parts_from_smooth_neighbours():
    """The other two faces at its vertices stay together."""
    mesh = Mesh(CUBE_POINTS, CUBE, flat=[5])
    assert mesh.fans_at(7) == {frozenset({5}), frozenset({1, 3})}
    assert mesh.fans_at(0) == {frozenset({0, 2, 4})}


def test_a_sharp_edge_that_ends_does_not_part_the_fan_at_its_end():
    """One sharp edge of four leaves the faces connected the other way round; two opposite ones part them."""
    assert Mesh(GRID_POINTS, GRID, sharp=[(1, 4)]).fans_at(4) == {frozenset({0, 1, 2, 3})}
    assert Mesh(GRID_POINTS, GRID, sharp=[(1, 4)]).fans_at(1) == {frozenset({0}), frozenset({1})}
    assert Mesh(GRID_POINTS, GRID, sharp=[(1, 4), (4, 7)]).fans_at(4) == {frozenset({0, 2}), frozenset({1, 3})}


def test_flat_faces_in_one_plane_show_no_crease():
    """A flat-shaded plane is one surface unless its edges are marked; folded by 2 degrees it is two."""
    assert Mesh(GRID_POINTS, GRID, flat=range(4)).fans_at(4) == {frozenset({0, 1, 2, 3})}
    assert Mesh(GRID_POINTS, GRID, flat=range(4), sharp=[(3, 4), (4, 5)]).fans_at(4) == {
        frozenset({0, 1}),
        frozenset({2, 3}),
    }
    lift = np.tan(np.radians(2.0))
    folded = [(x, y, lift * max(y - 1, 0)) for x, y, _ in GRID_POINTS]
    assert Mesh(folded, GRID, flat=range(4)).fans_at(4) == {frozenset({0, 1}), frozenset({2, 3})}


def test_faces_that_only_touch_at_a_vertex_are_parted():
    """No edge joins them."""
    faces = [GRID[0], GRID[3]]
    assert Mesh(GRID_POINTS, faces).fans_at(4) == {frozenset({0}), frozenset({1})}


def test_edges_of_three_faces_or_of_opposite_turn_are_sharp():
    """There is no smooth shading over a non-manifold edge, nor between faces of opposite normals."""
    points = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)]
    three = Mesh(points, [(0, 2, 1), (1, 3, 0), (0, 1, 4)])
    assert three.fans().tolist() == list(range(9))
    turned = Mesh(points, [(0, 2, 1), (0, 3, 1)])
    assert turned.fans().tolist() == list(range(6))
