"""What updates cost, in rays and bytes, and what becomes of those that do not finish."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.errors import BakeCancelledError, GeometryError, ObscuranceError
from obscurance_addon.core.monitor import Monitor
from obscurance_addon.core.scene.objects import SceneObject
from obscurance_addon.core.scene.solids import Shells
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.updates.hit_cache import SUMS
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import box, floor, grid
from tests.core.updates.changing_scenes import assert_equals_full_bake, furniture, objects_of, scene_object

SETTINGS = BakeSettings(32, distance=0.3, threads=2)
CUBE = box((0.2, 0.2, 0.5), (0.4, 0.4, 0.7), 2)


def on_a_floor(cells=10, **others):
    meshes = {"cube": CUBE, "floor": floor((0, 0), (1, 1), cells, cells), **others}
    return IncrementalBake(objects_of(meshes), SETTINGS, movers={"cube"})


def lift(bake, *offset):
    return bake.update({"cube": scene_object(CUBE.moved(offset=offset))})


def test_a_mover_far_from_everything_costs_its_own_rays():
    bake = on_a_floor()
    for z in (5.0, 5.1, 9.0):
        update = lift(bake, 0, 0, z)
    assert update.keys == {"cube"}
    assert (update.patches, update.cached) == (CUBE.faces, 0)
    assert update.rays == CUBE.faces * (SETTINGS.rays + 1)  # one asks whether the patch is within a solid
    assert bake.cache_bytes == 0  # the floor has never been in reach of it


def test_nothing_changed_costs_nothing():
    bake = on_a_floor()
    for changes in ({}, bake.objects, {"cube": scene_object(CUBE)}):
        update = bake.update(changes)
        assert (update.keys, update.patches, update.rays) == (frozenset(), 0, 0)


def test_rays_do_not_grow_with_what_is_far_away():
    distant = {str(i): floor((3 * i, 3), (3 * i + 1, 4), 8, 8, z=0.1) for i in range(30)}
    held = on_a_floor().held
    counts = []
    for others in ({}, distant):
        meshes = {"cube": CUBE, "floor": floor((0, 0), (1, 1), 10, 10), **others}
        bake = IncrementalBake(objects_of(meshes), SETTINGS, movers={"cube"}, held=held)
        updates = [lift(bake, x, 0, -0.2) for x in (0.1, 0.2, 0.3)]
        counts.append([(u.patches, u.rays, u.cached) for u in updates] + [bake.cache_bytes])
    assert counts[0] == counts[1]
    assert len(distant) * 64 + 100 > 10 * counts[0][0][0]


def test_the_cache_holds_eight_bytes_a_ray_of_what_was_in_reach():
    bake = on_a_floor()
    first = lift(bake, 0.1, 0, -0.2)
    of_floor = first.patches - CUBE.faces
    assert 0 < of_floor < 100
    assert bake.cache_bytes == 8 * (SETTINGS.rays + 2 * SUMS) * of_floor  # two cells in each of its patches
    again = lift(bake, 0.1, 0, -0.19)
    assert again.cached == SETTINGS.rays * (again.patches - CUBE.faces) > 0


def test_patches_that_turn_their_back_are_left_alone():
    """A sheet that looks down, below the cube, and one that looks up."""
    down, up = (grid((0.1, 0.1, 0.45), u, v, 4, 4) for u, v in (((0, 0.4, 0), (0.4, 0, 0)), ((0.4, 0, 0), (0, 0.4, 0))))
    for sheet, is_influenced in ((down, False), (up, True)):
        bake = IncrementalBake(objects_of({"cube": CUBE, "sheet": sheet}), SETTINGS, movers={"cube"})
        assert ("sheet" in lift(bake, 0, 0, 0.01).keys) == is_influenced


def test_ray_tracers_are_built_over_what_moves_alone():
    built = []

    def spy(vertices, triangles, progress):
        built.append(len(triangles))
        return EmbreeIntersector(vertices, triangles, progress)

    meshes = furniture()
    bake = IncrementalBake(objects_of(meshes), SETTINGS, movers={"ball", "crate"}, intersector=spy)
    of = {key: len(m.triangles) for key, m in meshes.items()}
    still = sum(of.values()) - of["ball"] - of["crate"]
    assert built == [still, of["ball"] + of["crate"]]
    for expected in ([of["crate"], of["ball"]], [of["ball"]]):
        built.clear()
        meshes["ball"] = meshes["ball"].moved(offset=(0.01, 0, 0))
        bake.update({"ball": scene_object(meshes["ball"], 6000)})
        assert built == expected
    built.clear()
    bake.update({"other": scene_object(meshes["other"].moved(offset=(0.01, 0, 0)), 2000)})
    assert built == [still - of["other"], of["ball"] + of["crate"], of["other"]]
    assert_equals_full_bake(bake, SETTINGS)


def test_a_turning_mover_changes_no_r_ave():
    bake = on_a_floor()
    before = bake.r_ave
    for seed in range(20):
        angle = 0.1 + seed
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        update = bake.update({"cube": scene_object(CUBE.moved(turn, (3.0, 0, 3.0)))})
        np.testing.assert_array_equal(bake.r_ave, before)
    assert update.keys == {"cube"}


class Impatient(Monitor):
    def advance(self, amount: int) -> None:
        raise BakeCancelledError


def test_a_cancelled_update_cannot_be_mistaken_for_a_finished_one():
    bake = on_a_floor()
    with pytest.raises(BakeCancelledError):
        bake.update({"cube": scene_object(CUBE.moved(offset=(0, 0, -0.1)))}, Impatient())
    for use in (lambda: bake.update({}), lambda: bake.values("cube")):
        with pytest.raises(ObscuranceError, match="not finished"):
            use()


def test_unknown_objects():
    bake = on_a_floor()
    with pytest.raises(KeyError, match="nobody"):
        bake.update({"cube": None, "nobody": None})
    assert set(bake.update({}).keys) == set()
    assert set(bake.objects) == {"cube", "floor"}


def test_nothing_to_bake():
    with pytest.raises(GeometryError, match="no face"):
        IncrementalBake({"cube": scene_object(CUBE, baked=False)}, SETTINGS)


@pytest.mark.parametrize("use_bleeding", [True, False])
def test_everything_goes_and_comes(use_bleeding):
    """Without any patch there is no value, and R_ave is that of what is left."""
    settings = replace(SETTINGS, use_bleeding=use_bleeding)
    objects = objects_of({"cube": CUBE, "floor": floor((0, 0), (1, 1), 3, 3)})
    bake = IncrementalBake(objects, settings)
    bake.update(dict.fromkeys(objects))
    assert not bake.objects
    np.testing.assert_array_equal(bake.r_ave, 0.0)
    bake.update(objects)
    assert_equals_full_bake(bake, settings)


def test_broken_geometry():
    """Vertices that are not finite, triangles without area, objects without any triangle or usable patch."""
    broken = CUBE.moved()
    broken.vertices[0] = np.nan
    flat = grid((0.5, 0.5, 0.1), (0.1, 0, 0), (0.1, 0, 0), 2, 2)
    bake = on_a_floor()
    empty = scene_object(CUBE)
    none = SceneObject(
        replace(
            empty.surfaces,
            triangles=np.zeros((0, 3), np.int32),
            shells=Shells.none(0),
            reflectance=np.zeros((0, 3), np.float32),
        ),
        empty.patches,
        empty.reflectance,
    )
    for source in (scene_object(broken), scene_object(flat), none, scene_object(CUBE)):
        with np.errstate(invalid="ignore"):
            bake.update({"cube": source})
            assert_equals_full_bake(bake, SETTINGS)
