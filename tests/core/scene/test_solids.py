"""Which shells count as closed solids, by topology and volume."""

import numpy as np
import pytest

from obscurance_addon.core.scene.components import connected_components
from obscurance_addon.core.scene.solids import Shells, find_shells
from tests.core.scenes import Mesh, box, floor, grid, icosphere, join, mesh, room, rotation


def solid(m: Mesh) -> np.ndarray:
    return find_shells(m.vertices, m.triangles)[0].solid


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


def split(m: Mesh) -> Mesh:
    """The mesh with vertices of its own for each triangle, as files for games have them at hard edges."""
    return mesh(m.corners(), np.arange(3 * len(m.triangles)), m.face)


def bowl(share: float) -> Mesh:
    """A sphere whose triangles above some share of its height are missing."""
    ball = icosphere(3)
    return mesh(ball.vertices, ball.triangles[ball.corners().mean(1)[:, 2] < 2.0 * share - 1.0])


@pytest.mark.parametrize("shell", [BOX, icosphere(2)], ids=["box", "ball"])
def test_vertices_in_one_place_are_one(shell):
    """Whatever the sign of their zeros."""
    apart = split(shell)
    signs = np.where(np.random.default_rng(1).random(apart.vertices.shape) < 0.5, -1.0, 1.0)
    apart.vertices[apart.vertices == 0.0] *= signs[apart.vertices == 0.0]
    assert solid(apart).all()


def test_boxes_that_touch_stay_apart():
    both = join([BOX, BOX.moved(offset=(1, 0, 0))])
    shells, _ = find_shells(both.vertices, both.triangles)
    np.testing.assert_array_equal(shells.body, np.repeat([1, 1 + len(BOX.triangles)], len(BOX.triangles)))


@pytest.mark.parametrize(("shell", "expected"), [
    (mesh(BOX.vertices, BOX.triangles[1:]), True),
    (mesh(BOX.vertices, BOX.triangles[:-8]), True),
    (box((0, 0, 0), (1, 1, 4)), True),
    (bowl(0.9), True), (bowl(0.5), False), (bowl(0.6), False),
    (floor((0, 0), (1, 1), 4, 4), False),
])  # fmt: skip
def test_small_holes_leave_a_solid_and_large_ones_a_sheet(shell, expected):
    """A bowl of half a sphere would need a lid of half its area."""
    shells, _ = find_shells(shell.vertices, shell.triangles)
    np.testing.assert_array_equal(shells.solid, expected)
    closed = len(shell.triangles) == 12
    np.testing.assert_array_equal(shells.has_holes, expected and not closed)


def test_an_edge_that_meets_two_shorter_ones_is_no_hole():
    """A corner in the middle of an edge of the next face, as remeshing leaves them."""
    vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0, 0)]
    shells, _ = find_shells(
        np.array(vertices, float), np.array([(0, 2, 1), (0, 4, 3), (4, 1, 3), (1, 2, 3), (0, 3, 2)])
    )
    assert shells.solid.all()
    assert not shells.has_holes.any()


@pytest.mark.parametrize("make", [lambda m: m, split])
@pytest.mark.parametrize("shell", [BOX, icosphere(2), floor((0, 0), (1, 1), 6, 6)], ids=["box", "ball", "terrain"])
def test_a_minority_of_flipped_faces_is_found(shell, make):
    turned = np.random.default_rng(5).random(len(shell.triangles)) < 0.25
    triangles = np.where(turned[:, None], shell.triangles[:, ::-1], shell.triangles)
    mended = make(mesh(shell.vertices, triangles))
    shells, flipped = find_shells(mended.vertices, mended.triangles)
    np.testing.assert_array_equal(flipped, turned)
    np.testing.assert_array_equal(shells.solid, solid(shell))
    assert len(np.unique(shells.shell)) == 1


def test_two_equal_sides_of_a_box_are_turned_outwards_and_those_of_a_sheet_left():
    cube = box((0, 0, 0), (1, 1, 1))
    half = np.isin(cube.face, [0, 2, 4])
    for turned in (half, ~half):
        shells, flipped = find_shells(cube.vertices, np.where(turned[:, None], cube.triangles[:, ::-1], cube.triangles))
        np.testing.assert_array_equal(flipped, turned)
        assert shells.solid.all()
    sheet = mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 3, 2)])
    assert not find_shells(sheet.vertices, sheet.triangles)[1].any()


def test_a_strip_of_one_side_has_no_flipped_faces():
    """Moebius."""
    turn = np.linspace(0, 2 * np.pi, 25)[:-1]
    rim = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
    half = 0.3 * np.stack([np.cos(turn) * np.cos(turn / 2), np.sin(turn) * np.cos(turn / 2), np.sin(turn / 2)], -1)
    a, n = np.arange(24), 24
    b = np.where(a == 23, 24, a + 1)  # the other edge, behind the turn
    c = np.where(a == 23, 0, a + 25)
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, a + n], -1)])
    shells, flipped = find_shells(np.concatenate([rim - half, rim + half]), triangles)
    assert not flipped.any()
    assert not shells.solid.any()
    assert len(np.unique(shells.shell)) == 1


def test_a_cavity_belongs_to_the_body_around_it_and_a_room_to_none():
    hollow = [box((0, 0, 0), (4, 4, 4)), room((1, 1, 1), (3, 3, 3)), box((1.5, 1.5, 1.5), (2, 2, 2))]
    everything = join([*hollow, room((5, 5, 5), (6, 6, 6))])
    shells, _ = find_shells(everything.vertices, everything.triangles)
    outer, cavity, block, lone = (shells.only(np.arange(12 * i, 12 * i + 12)) for i in range(4))
    assert set(outer.body) == set(cavity.body) == {1}
    assert set(block.body) == {25}
    assert set(lone.body) == {0}
    np.testing.assert_array_equal(shells.inward, np.arange(48) >= 36)
    np.testing.assert_array_equal(shells.shell, np.repeat([1, 13, 25, 37], 12))


def test_shells_of_several_meshes_are_numbered_on():
    one, _ = find_shells(BOX.vertices, BOX.triangles)
    both = Shells.joined([Shells.none(3), one])
    np.testing.assert_array_equal(both.shell, [1, 2, 3, *[4] * len(BOX.triangles)])
    np.testing.assert_array_equal(both.body, [0, 0, 0, *[4] * len(BOX.triangles)])


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
def test_a_vertex_that_is_not_finite_leaves_a_hole(bad):
    """The other shell of the mesh is not affected."""
    vertices = BOX.vertices.copy()
    vertices[3, 1] = bad
    both = join([mesh(vertices, BOX.triangles), icosphere(0)])
    np.testing.assert_array_equal(solid(both), np.isfinite(both.corners()).all((1, 2)))
    assert find_shells(both.vertices, both.triangles)[0].has_holes.sum() == solid(both).sum() - 20


def test_flat_closed_shells_are_not_solids():
    """Two sides of one sheet enclose nothing."""
    sheet = mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 1, 2), (2, 1, 0)])
    assert not solid(sheet).any()


def test_no_triangles():
    shells, flipped = find_shells(np.zeros((4, 3)), np.zeros((0, 3), np.int32))
    assert shells.solid.shape == flipped.shape == (0,)


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


def test_shells_with_windows():
    """A transparent face opens its own shell, also where vertices are split, and no other."""
    both = join([box((0, 0, 0), (1, 1, 1)), box((2, 0, 0), (3, 1, 1))])
    split = both.vertices[both.triangles].reshape(-1, 3), np.arange(3 * len(both.triangles)).reshape(-1, 3)
    transparent = np.zeros(24, bool)
    transparent[5] = True
    for vertices, triangles in ((both.vertices, both.triangles), split):
        shells = find_shells(vertices, triangles)[0].without_windows(transparent)
        assert shells.solid.tolist() == [False] * 12 + [True] * 12
