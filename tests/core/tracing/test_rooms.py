"""Bodies that hold others are rooms of these, and solid for everything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing import rooms as rooms_module
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.tracing.rooms import ShellPoints
from tests.core.scenes import Mesh, box, floor, grid, icosphere, join, mesh, room, rotation, scene

SETTINGS = BakeSettings(256, distance=0.6)
HALL = box((0, 0, 0), (4, 3, 2.5), 3)


def furniture(poke: float = 0.0) -> list[Mesh]:
    """A table, a rug, a picture and a lamp that touch floor and walls exactly, or stand out by `poke` metres."""
    legs = [box((x, y, -poke), (x + 0.1, y + 0.1, 0.7)) for x in (1, 2) for y in (1, 2)]
    top = box((0.95, 0.95, 0.7), (2.15, 2.15, 0.75), 2)
    rug, picture = box((0.5, 0.5, 0.0), (2.5, 2.5, 0.005), 3), grid((-poke, 1, 1), (0, 1, 0), (0, 0, 0.5), 2, 2)
    return [join([*legs, top]), rug, picture, icosphere(1).moved(0.15, (3, 1, 2.35 + poke))]


def rooms_of(*meshes: Mesh) -> tuple[set[tuple[int, int]], np.ndarray]:
    """Pairs of meshes: a shell of the first is in the second; and the meshes that are turned inside out."""
    s = scene(meshes)
    rooms = build_scene(s.surfaces, s.patches, SETTINGS).rooms
    owner = lambda number: np.searchsorted(s.surfaces.object_starts, number - 1, side="right") - 1  # noqa: E731
    return set(zip(owner(rooms.shell).tolist(), owner(rooms.body).tolist(), strict=True)), owner(rooms.turned)


@pytest.mark.parametrize("poke", [0.0, 0.001])
@pytest.mark.parametrize("turn", [np.eye(3), rotation(2)], ids=["straight", "turned"])
def test_a_furnished_room_is_the_one_with_normals_inwards(turn, poke):
    things, hall = [m.moved(turn) for m in furniture(poke)], HALL.moved(turn)
    out, inwards = (scene(things, [shell]).bake(SETTINGS) for shell in (hall, hall.flipped()))
    seen = np.concatenate([m.centres() @ turn for m in things])[:, 2] > 0.006  # but for what lies on the floor
    np.testing.assert_array_equal(out.valid[seen], inwards.valid[seen])
    assert out.valid[seen].mean() > 0.8
    assert np.abs(out.grey - inwards.grey)[out.valid & seen].max() < (0.01 if poke == 0.0 else 0.02)


def test_one_mesh_of_room_and_things():
    things = furniture()
    apart, joined = scene([*things, HALL]).bake(SETTINGS), scene([join([*things, HALL])]).bake(SETTINGS)
    np.testing.assert_allclose(joined.grey, apart.grey, atol=0.02)
    assert joined.valid.sum() == apart.valid.sum()


def test_who_is_in_which_room():
    sky, ball = icosphere(2).moved(20.0), icosphere(1).moved(0.2, (1, 1, 1))
    outside = box((6, 0, 0), (7, 1, 1))
    through = box((3, 1, 1), (9, 1.2, 1.2))
    found, turned = rooms_of(ball, HALL, outside, through, sky)
    assert found == {(0, 1), (0, 4), (1, 4), (2, 4), (3, 4)}
    assert not len(turned)


def test_a_trunk_that_crosses_a_terrain_stays_hidden_in_it():
    """And so does one that touches a wall from outside."""
    terrain, trunk = box((0, 0, 0), (10, 10, 1), 2), box((5, 5, 0.5), (5.3, 5.3, 3))
    assert rooms_of(terrain, trunk, box((10, 2, 0), (10.5, 3, 0.5)))[0] == set()
    buried = icosphere(1).moved(0.2, (3, 3, 0.5))
    assert rooms_of(terrain, trunk, buried)[0] == {(2, 0)}


def test_thick_walls_need_no_room():
    house = join([box((0, 0, 0), (4, 4, 3)), room((0.2, 0.2, 0.2), (3.8, 3.8, 2.8))])
    assert rooms_of(house, box((1, 1, 0.2), (2, 2, 1)))[0] == set()


def test_a_shell_with_holes_that_is_a_room_is_solid_for_nobody():
    """A house without most of its ground, with a lamp in it: a post through its wall is exposed in there too."""
    x, _, z = HALL.centres().T
    shell = mesh(HALL.vertices, HALL.triangles[np.repeat((x > 2.7) | (z > 1e-6), 2)])
    lamp, post = icosphere(1).moved(0.2, (2, 1.5, 1.5)), box((3, 1, 1), (9, 1.2, 1.2), 8)
    inside = post.centres()[:, 0] < 3.9
    far = BakeSettings(256, distance=8.0)
    assert (scene([post], [shell]).bake(far).sums.valid[inside] < 0.9).all()
    np.testing.assert_array_equal(scene([post], [shell, lamp]).bake(far).sums.valid, 1.0)


def test_shells_turned_inside_out():
    """A prop with normals inwards among others is one, a furnished room and an empty one alone are not."""
    assert rooms_of(HALL.flipped())[1].tolist() == []
    assert rooms_of(HALL.flipped(), *furniture())[1].tolist() == []
    assert rooms_of(floor((-5, -5), (9, 9)), box((0, 0, 0.1), (1, 1, 1)).flipped())[1].tolist() == [1]


@pytest.mark.parametrize("pairs", [1 << 20, 7])
def test_boxes_in_boxes_are_found_as_by_looking_at_all(monkeypatch, pairs):
    """However many are looked at together."""
    monkeypatch.setattr(rooms_module, "_PAIRS", pairs)
    rng = np.random.default_rng(3)
    low = rng.random((60, 3)) * [9.0, 3.0, 1.0]
    high = low + 0.2
    high[:25] += 2.0
    nothing = ShellPoints.none()
    found = rooms_module._ByPlace(replace(nothing, low=low, high=high)).fitting(low[:25], high[:25])
    poke = rooms_module._POKES * np.linalg.norm(high - low, axis=1)[:25, None, None]
    fits = (low >= low[:25, None] - poke).all(2) & (high <= high[:25, None] + poke).all(2)
    assert fits.sum() > 25 + 20  # each box is in itself
    pairs_of = [sorted(zip(*(rows.tolist() for rows in both), strict=True)) for both in (found, np.nonzero(fits))]
    assert pairs_of[0] == pairs_of[1]
