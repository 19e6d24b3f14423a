"""Triangles that float32 cannot trace whole: their pieces cover them, meet, and answer with the whole triangle."""

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene.patches import triangle_areas, usable_triangles
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.tracing.splitting import LARGE, WholeTriangles, cut_large, cut_needles, make_intersector
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import box, floor, icosphere, mesh, rotation, scene
from tests.core.updates.changing_scenes import assert_equals_full_bake, objects_of

SIZES = [1e3, 1e5, 1e6, 1e8, 1e12]
GROUND = floor((0, 0), (1, 1), 4, 4)


def plane(size, z=0.0):
    """Two triangles, of which the near edge passes beside the unit square."""
    return floor((-0.37 * size, -0.41 * size), (0.63 * size, 0.59 * size), z=z)


def needles(slenderness, n=50, seed=0):
    """Corners (n, 3, 3) of needles of length 1 anywhere in a cube; the third corner is anywhere along them."""
    rng = np.random.default_rng(seed)
    start, along = rng.uniform(-1, 1, (n, 3)), rng.normal(size=(n, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.cross(along, rng.normal(size=(n, 3)))
    across *= slenderness / np.linalg.norm(across, axis=1)[:, None]
    foot = rng.uniform(0, 1, (n, 1))
    foot[1:3, 0] = np.array([0.0, 1.0])[: max(n - 1, 0)]
    corners = np.stack([start, start + along, start + foot * along + across], 1)
    return np.stack([np.roll(triangle, k % 3, axis=0) for k, triangle in enumerate(corners)])


def assert_covers(pieces, owner, corners, rounding):
    """Areas add up, and every piece looks as its triangle does and lies in its plane."""
    area = triangle_areas(corners)
    np.testing.assert_allclose(np.bincount(owner, triangle_areas(pieces), len(corners)), area, rtol=1e-6)
    normal, whole = (np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (pieces, corners))
    assert (np.einsum("ij,ij->i", normal, whole[owner]) > 0.0).all()
    unit = whole / np.linalg.norm(whole, axis=1)[:, None]
    height = np.einsum("ikj,ij->ik", pieces - corners[owner][:, :1], unit[owner])
    assert np.abs(height).max() < rounding


@pytest.mark.parametrize("size", SIZES)
def test_pieces_of_a_large_plane(size):
    """Each is at most as long as it is far away, or short; they cover the plane."""
    corners = plane(size).moved(rotation(1), (0, 0, 0.3)).corners()
    pieces, owner = cut_large(corners)
    assert_covers(pieces, owner, corners, 1e-12 * size)
    length = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
    distance = np.linalg.norm(0.5 * (np.roll(pieces, -1, axis=1) + pieces), axis=2)
    assert ((length <= LARGE) | (distance >= 1.5 * length)).all()
    assert len(pieces) < 100 * np.log2(size)


def test_pieces_of_neighbours_meet():
    """Every edge within the plane has a piece on both sides: none ends within another's edge."""
    pieces, _ = cut_large(plane(1e6).moved(rotation(2), (3, 1, 0.3)).corners())
    edges = np.concatenate([pieces[:, [k, (k + 1) % 3]] for k in range(3)])
    flipped = edges[:, ::-1]
    one, other = ({edge.tobytes() for edge in np.ascontiguousarray(e)} for e in (edges, flipped))
    border = np.array([np.frombuffer(edge).reshape(2, 3) for edge in one - other])
    length = np.linalg.norm(border[:, 1] - border[:, 0], axis=1).sum()
    assert length == pytest.approx(4e6, rel=1e-9)


@pytest.mark.parametrize("slenderness", [1e-3, 1e-4, 1e-5, 2e-6])
def test_pieces_of_needles(slenderness):
    corners = needles(slenderness)
    pieces, owner = cut_needles(corners)
    assert_covers(pieces, owner, corners, 8.0 * np.finfo(float).eps / slenderness)
    assert len(pieces) > len(corners)
    assert len(pieces) < 4 * len(corners) / np.sqrt(slenderness)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("turn", [0, 1, 2])
def test_a_ceiling_stays_where_it_is_however_large(size, turn):
    """What lies 0.1 m below it has the values that a ceiling of 20 m gives."""
    settings, q = BakeSettings(64, distance=0.5, falloff=Falloff.LINEAR), rotation(turn)

    def below(ceiling):
        return scene([GROUND.moved(q)], [ceiling.flipped().moved(q)]).bake(settings).grey

    near = below(floor((-10, -10), (10, 10), z=0.1))
    assert np.ptp(near) < 0.05
    np.testing.assert_allclose(below(plane(size, 0.1)), near, atol=1e-4)


@pytest.mark.parametrize("slenderness", [2.9e-4, 1e-4, 3e-5, 1e-5, 2e-6])
def test_a_needle_does_not_shade_itself(slenderness):
    """Alone it is open; 3 m away is another face, so that the scene is larger than it."""
    other = mesh(np.array([(3, 3, 3), (3.5, 3, 3), (3, 3.5, 3)]), [(0, 1, 2)])
    for corners in needles(slenderness, 12):
        baked = scene([mesh(corners, [(0, 1, 2)]), other]).bake(BakeSettings(64, distance=0.5))
        np.testing.assert_array_equal(baked.grey, 1.0)


def test_a_fan_of_needles_casts_the_shadow_of_a_disk():
    """40,000 needles of slenderness 1.6e-4 above a floor, and a disk of 400 triangles."""

    def disk(n):
        angle = 2.0 * np.pi * np.arange(n) / n
        rim = np.stack([0.5 + np.cos(angle), 0.5 + np.sin(angle), np.full(n, 0.2)], 1)
        k = np.arange(n)
        return mesh(np.vstack([[(0.5, 0.5, 0.2)], rim]), np.stack([np.zeros(n, int), 1 + k, 1 + (k + 1) % n], 1))

    fine, coarse = (scene([GROUND], [disk(n)]).bake(BakeSettings(64, distance=0.5)).grey for n in (40000, 400))
    assert coarse.max() < 0.9
    np.testing.assert_allclose(fine, coarse, atol=1e-3)


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("has_solid", [False, True])
def test_updates_equal_full_bakes(falloff, has_solid):
    """With a plane of 1e6 m that moves, and needles."""
    needle = needles(1e-4, 1)[0]
    meshes = {
        "ground": GROUND.coloured((0.8, 0.3, 0.1)),
        "plane": plane(1e6, 0.2).flipped().coloured((0.1, 0.3, 0.8)),
        "needle": mesh(needle - needle.mean(0) + (0.5, 0.5, 0.1), [(0, 1, 2)]),
    }
    if has_solid:
        meshes["box"] = box((0.2, 0.2, 0.01), (0.5, 0.5, 0.1))
    objects = objects_of(meshes, unbaked=["plane"])
    settings = BakeSettings(32, distance=0.5, falloff=falloff)
    bake = IncrementalBake(objects, settings, movers={"plane"})
    assert_equals_full_bake(bake, settings)
    meshes["plane"] = meshes["plane"].moved(offset=(0, 0, -0.05))
    meshes["needle"] = meshes["needle"].moved(offset=(0, 0, 0.03))
    changed = objects_of(meshes, unbaked=["plane"])
    bake.update({name: changed[name] for name in ("plane", "needle")})
    assert_equals_full_bake(bake, settings)


def test_hits_name_the_whole_triangle():
    """Rays down from all over a plane, beside a needle and a small face; hits and normals are those of whole ones."""
    parts = [plane(1e5, -1.0), mesh(needles(1e-4, 1)[0], [(0, 1, 2)]), floor((0, 0), (1, 1), z=0.5)]
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    triangles = np.concatenate([part.triangles + first for part, first in zip(parts, starts[:-1], strict=True)])
    usable, slender = usable_triangles(vertices, triangles)
    assert usable.all()
    np.testing.assert_array_equal(slender, [False, False, True, False, False])
    tracer = make_intersector(EmbreeIntersector, vertices, triangles, slender, lambda _: None)
    assert isinstance(tracer, WholeTriangles)
    xy = np.random.default_rng(0).uniform(-3e4, 3e4, (2000, 2))
    xy[:1000] = np.random.default_rng(1).uniform(0, 1, (1000, 2))
    origins = np.column_stack([xy, np.full(2000, 2.0)]).astype(np.float32)
    down = np.tile(np.float32([0, 0, -1]), (2000, 1))
    hits = tracer.intersect(origins, down, np.full(2000, 10.0, np.float32))
    assert set(hits.triangle[:1000]) <= {2, 3, 4}
    np.testing.assert_array_equal(np.unique(hits.triangle[1000:]), [0, 1])
    np.testing.assert_allclose(hits.distance[1000:], 3.0, rtol=1e-6)
    assert tracer.occluded(origins, down, np.full(2000, 10.0, np.float32)).all()
    up = tracer.intersect(origins, -down, np.full(2000, 10.0, np.float32))
    assert (up.triangle < 0).all()


def test_ordinary_triangles_are_traced_as_they_are():
    """The tracer is the one that was given, over the very arrays."""
    ball = icosphere(3)
    slender = usable_triangles(ball.vertices, ball.triangles)[1]
    given = []
    tracer = make_intersector(lambda *arrays: given.append(arrays), ball.vertices, ball.triangles, slender, None)
    assert tracer is None
    assert given[0][0] is ball.vertices
    assert given[0][1] is ball.triangles
