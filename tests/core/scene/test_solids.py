"""Which shells count as closed solids, by topology and volume."""

import numpy as np
import pytest

from obscurance_addon.core.scene.solids import connected_components, solid_triangles
from tests.core.scenes import Mesh, box, floor, grid, icosphere, join, mesh, room, rotation


def solid(m: Mesh) -> np.ndarray:
    return solid_triangles(m.vertices, m.triangles)


BOX = box((0, 0, 0), (1, 2, 3), 2)


@pytest.mark.parametrize("shell", [BOX, icosphere(2), mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [
    (0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])], ids=["box", "icosphere", "tetrahedron"])  # fmt: skip
def test_closed_outward_shells_are_solids(shell):
    assert solid(shell).all()


@pytest.mark.parametrize("shell", [room((0, 0, 0), (1, 1, 1), 2), icosphere(1).flipped()], ids=["room", "sphere"])
def test_rooms_with_inward_normals_are_not_solids(shell):
    """Negative volume."""
    assert not solid(shell).any()


def test_open_sheets_are_not_solids():
    assert not solid(floor((0, 0), (1, 1), 3, 3)).any()
    assert not solid(grid((0, 0, 0), (0, 1, 0), (0, 0, 1))).any()


def test_a_box_that_lacks_one_triangle_is_not_a_solid():
    opened = mesh(BOX.vertices, BOX.triangles[1:])
    assert not solid(opened).any()


def test_a_box_with_one_triangle_turned_is_not_a_solid():
    turned = BOX.triangles.copy()
    turned[5] = turned[5][::-1]
    assert not solid(mesh(BOX.vertices, turned)).any()


def test_a_box_with_a_doubled_triangle_is_not_a_solid():
    """Four triangles at an edge do not say where inside is."""
    assert not solid(mesh(BOX.vertices, np.concatenate([BOX.triangles, BOX.triangles[:1]]))).any()


def test_each_shell_of_one_object_is_judged_by_itself():
    parts = [BOX, floor((5, 5), (6, 6)), room((9, 9, 9), (10, 10, 10)), icosphere(1)]
    expected = np.repeat([True, False, False, True], [len(p.triangles) for p in parts])
    np.testing.assert_array_equal(solid(join(parts)), expected)


def test_mirroring_turns_a_solid_inside_out_unless_its_corners_are_reversed():
    mirrored = BOX.moved(np.diag([-1.0, 1.0, 1.0]))
    assert not solid(mirrored).any()
    assert solid(mirrored.flipped()).all()


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
def test_place_turn_and_size_do_not_matter(scale):
    far = BOX.moved(rotation(1) * scale, np.array([1e5, -1e5, 1e5]) * scale)
    assert solid(far).all()
    assert not solid(far.flipped()).any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_shells_with_vertices_that_are_not_finite_are_not_solids(bad):
    """The other shell of the mesh is not affected."""
    vertices = BOX.vertices.copy()
    vertices[3, 1] = bad
    both = join([mesh(vertices, BOX.triangles), icosphere(0)])
    np.testing.assert_array_equal(solid(both), np.repeat([False, True], [len(BOX.triangles), 20]))


def test_flat_closed_shells_are_not_solids():
    """Two sides of one sheet enclose nothing."""
    sheet = mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 1, 2), (2, 1, 0)])
    assert not solid(sheet).any()


def test_no_triangles():
    assert solid_triangles(np.zeros((4, 3)), np.zeros((0, 3), np.int32)).shape == (0,)


def test_components_of_random_graphs_equal_a_search():
    rng = np.random.default_rng(3)
    for links in (0, 10, 60, 200):
        pairs = rng.integers(0, 120, (links, 2))
        label = np.arange(120)
        for _ in range(120):
            for a, b in pairs:
                label[a] = label[b] = min(label[a], label[b])
        np.testing.assert_array_equal(connected_components(120, pairs), label)


def test_components_of_a_long_chain():
    chain = np.random.default_rng(4).permutation(20000)
    label = connected_components(20000, np.stack([chain[:-1], chain[1:]], -1))
    np.testing.assert_array_equal(label, 0)
