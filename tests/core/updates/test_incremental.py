"""After any change, an incremental bake has the values of a full bake, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.scene.objects import join_objects
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import box, floor, grid, icosphere, mesh
from tests.core.updates.changing_scenes import assert_equals_full_bake, furniture, objects_of, scene_object, turned

SETTINGS = BakeSettings(16, distance=0.2, threads=2)


def start(settings=SETTINGS, movers=("other", "ball"), **kw):
    meshes = furniture()
    bake = IncrementalBake(objects_of(meshes), settings, movers=frozenset(movers), **kw)
    assert_equals_full_bake(bake, settings)
    return meshes, bake


def wander(meshes, bake, settings, keys, steps, rng, size=0.12):
    """Move one or all of some objects at random, and compare after each step."""
    ids = {key: 1000 * i for i, key in enumerate(meshes)}
    for step in range(steps):
        moving = keys if step % 3 == 2 else [keys[step % len(keys)]]
        for key in moving:
            meshes[key] = turned(meshes[key], rng, size, 2.0 ** rng.uniform(-0.2, 0.2))
        bake.update({key: scene_object(meshes[key], ids[key]) for key in moving})
        assert bake.last.reason is None
        assert_equals_full_bake(bake, settings)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("use_bleeding", [True, False])
def test_movers_of_all_kinds(falloff, use_bleeding, seed):
    settings = replace(SETTINGS, falloff=falloff, use_bleeding=use_bleeding)
    movers = (["other", "ball"], ["decal", "sheet"], ["octagon", "crate", "ball"])[seed]
    meshes, bake = start(settings, movers)
    wander(meshes, bake, settings, movers, 6, np.random.default_rng(seed))


def test_a_decal_that_slides():
    """Two ray offsets over the floor, whose rays pass through it; then at rest, while something passes over it."""
    meshes, bake = start(movers={"decal"})
    for x in (0.1, 0.3, 0.31, 0.55, 0.0):
        bake.update({"decal": scene_object(meshes["decal"].moved(offset=(x, -0.1, 0.0)), 3000)})
        assert_equals_full_bake(bake, SETTINGS)
    meshes, bake = start(movers={"ball"})
    wander(meshes, bake, SETTINGS, ["ball"], 6, np.random.default_rng(10))


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("rays", [1, 7, 100, 1500])
def test_any_number_of_rays(rays, falloff):
    """More than 1,024 rays come in several passes, of cells some of which lie within one."""
    settings = replace(SETTINGS, rays=rays, falloff=falloff)
    meshes, bake = start(settings, ["other", "octagon"])
    wander(meshes, bake, settings, ["other", "octagon"], 3, np.random.default_rng(rays))


@pytest.mark.parametrize("distance", [0.01, 1.0, np.inf, None])
@pytest.mark.parametrize("falloff", [Falloff.LINEAR, Falloff.STEP])
def test_any_distance(distance, falloff):
    settings = replace(SETTINGS, distance=distance, falloff=falloff)
    meshes, bake = start(settings, ["other", "ball"])
    wander(meshes, bake, settings, ["other", "ball"], 6, np.random.default_rng(1))


@pytest.mark.parametrize("ceiling_bytes", [0, 4000, 24000])
def test_any_room_for_kept_hits(ceiling_bytes):
    meshes, bake = start(ceiling_bytes=ceiling_bytes)
    was_full = []
    for seed in range(12):
        wander(meshes, bake, SETTINGS, ["other", "ball"][: 1 + seed % 2], 1, np.random.default_rng(seed))
        was_full.append(bake.last.cache_is_full)
        assert bake.cache_bytes <= ceiling_bytes
    assert any(was_full)


def test_objects_that_nobody_expected_to_move():
    """Each in turn leaves what stands still, with hits of it in the cache."""
    meshes, bake = start(movers=())
    wander(meshes, bake, SETTINGS, [*list(meshes)[1:], "room"], 14, np.random.default_rng(3), size=0.05)


@pytest.mark.parametrize("distance", [0.2, np.inf])
@pytest.mark.parametrize("falloff", [Falloff.CBRT, Falloff.STEP])
def test_coming_and_going(falloff, distance):
    """Objects vanish and appear, movers or not, several at once, and those of other shape under the same name."""
    settings, rng = replace(SETTINGS, falloff=falloff, distance=distance), np.random.default_rng(4)
    meshes, bake = start(settings)
    everything = objects_of(meshes)
    for _ in range(16):
        changes = {}
        for key in rng.choice(list(meshes), 2, replace=False):
            other = everything[rng.choice(["crate", "ball", "sheet", "octagon"])]
            changes[key] = None if key in bake.objects and rng.random() < 0.6 else rng.choice([everything[key], other])
        bake.update(changes)
        assert_equals_full_bake(bake, settings)


def test_the_last_solid_goes():
    """STEP asks for first hits only where there are solids: all is baked anew when that changes."""
    settings = replace(SETTINGS, falloff=Falloff.STEP)
    meshes = {key: furniture()[key] for key in ("room", "sheet", "ball")}
    objects = objects_of(meshes)
    bake = IncrementalBake(objects, settings, movers={"ball"})
    for source, anew in ((None, True), (objects["ball"], True), (objects["sheet"], True), (objects["sheet"], False)):
        bake.update({"ball": source})
        assert (bake.last.reason is not None) == anew
        assert_equals_full_bake(bake, settings)


def test_a_ray_budget():
    """Rays per patch are held while patches change shape, and are shared out anew when their number changes."""
    settings = replace(SETTINGS, ray_budget=6000)
    meshes, bake = start(settings)
    wander(meshes, bake, settings, ["other", "ball"], 4, np.random.default_rng(5), size=0.2)
    bake.update({"sheet": None})
    assert "number of patches" in bake.last.reason
    assert_equals_full_bake(bake, settings)
    assert bake.held.rays.sum() <= 6000
    wander(meshes, bake, settings, ["other"], 2, np.random.default_rng(6))


@pytest.mark.parametrize("use_bleeding", [True, False])
@pytest.mark.parametrize("key", ["room", "ball", "decal"])
def test_colours(key, use_bleeding):
    """A new colour of a mover or of what stands still bleeds, and changes R_ave; no ray is lost from the cache."""
    settings = replace(SETTINGS, use_bleeding=use_bleeding)
    meshes, bake = start(settings)
    rng = np.random.default_rng(7)
    wander(meshes, bake, settings, ["ball"], 2, rng)
    kept = bake.cache_bytes
    for _ in range(2):
        colours = rng.uniform(0, 0.9, (meshes[key].faces, 3)).astype(np.float32)
        meshes[key] = replace(meshes[key], reflectance=colours)
        bake.update({key: scene_object(meshes[key], 1000 * list(meshes).index(key))})
        assert bake.cache_bytes >= kept
        assert_equals_full_bake(bake, settings)
    wander(meshes, bake, settings, ["ball"], 2, rng)


def test_everything_moves():
    """Nothing stands still, from the start on."""
    meshes, bake = start(movers=furniture())
    wander(meshes, bake, SETTINGS, list(meshes), 4, np.random.default_rng(11))


def test_the_way_home():
    """Away by small steps and by a jump, and back: the values of the start."""
    meshes, bake = start()
    objects = bake.objects
    before = {key: bake.values(key) for key in objects}
    wander(meshes, bake, SETTINGS, ["other", "ball"], 3, np.random.default_rng(8))
    bake.update({"ball": scene_object(meshes["ball"].moved(offset=(40.0, 3.0, 0.0)), 6000)})
    assert_equals_full_bake(bake, SETTINGS)
    bake.update({key: objects[key] for key in ("other", "ball")})
    for key, values in before.items():
        np.testing.assert_array_equal(bake.values(key).coloured, values.coloured)
        np.testing.assert_array_equal(bake.values(key).grey, values.grey)


def test_objects_that_come_into_reach():
    """What is out of reach of all patches is not traced, not even without limit; a mover may bring it into reach."""
    meshes = {
        "floor": floor((0, 0), (1, 1), 5, 5),
        "mover": box((0.2, 0.2, 0.1), (0.4, 0.4, 0.3), 2),
        "hull": box((-3, -3, -3), (3, 3, 3)),
        "stone": box((1.9, 0.1, 0.1), (2.3, 0.9, 0.5)),
        "far": grid((2.6, 0, -1), (0, 1, 0), (0, 0, 2)),
    }
    objects = objects_of(meshes, ["hull", "stone", "far"])
    bake = IncrementalBake(objects, SETTINGS, movers={"mover"})
    for x in (0.1, 1.5, 2.0, 1.2, 0.0, -2.9, -3.5, 0.2):
        bake.update({"mover": scene_object(meshes["mover"].moved(offset=(x, 0.1, 0.1)), 1000)})
        assert_equals_full_bake(bake, SETTINGS)
    bake.update({"stone": None})
    assert_equals_full_bake(bake, SETTINGS)


@pytest.mark.parametrize("expected", [True, False])
def test_the_inside_of_large_solids(expected):
    """Patches deep in a solid, farther than d_max from its walls, that a passing object uncovers or hides."""
    meshes = {
        "floor": floor((-0.5, -0.5), (0.5, 0.5), 6, 6),
        "hull": box((-2, -2, -2), (2, 2, 2), 1, (0.2, 0.4, 0.6)),
        "lid": grid((-1, -1, 1.2), (2, 0, 0), (0, 2, 0), 1, 1, (0.9, 0.1, 0.1)),
        "stone": box((-0.1, -0.1, 0.5), (0.1, 0.1, 0.7), 2),
    }
    movers = {"hull", "lid", "stone"} if expected else set()
    bake = IncrementalBake(objects_of(meshes, ["hull", "lid"]), SETTINGS, movers=movers)
    assert_equals_full_bake(bake, SETTINGS)
    rng = np.random.default_rng(9)
    for step in range(18):
        key = ("lid", "stone", "hull")[step % 3]
        moved = meshes[key].moved(offset=rng.uniform(-1.5, 1.5, 3))
        bake.update({key: scene_object(moved, 3000, baked=key == "stone")})
        assert_equals_full_bake(bake, SETTINGS)


def test_nothing_hides_the_inside_of_a_solid():
    """A sheet between a post's foot, deep in a solid, and the walls of it changes nothing."""
    meshes = {
        "post": box((-1, -1, 0), (1, 1, 400), 9),
        "hull": box((-100, -100, -100), (100, 100, 100)),
        "lid": grid((-90, -90, 1), (180, 0, 0), (0, 180, 0)),
    }
    inside = meshes["post"].centres()[:, 2] < 88.0
    bake = IncrementalBake(objects_of(meshes, ["hull", "lid"]), SETTINGS, movers={"lid"})
    for z in (0.05, 20.0, 0.0):
        bake.update({"lid": scene_object(meshes["lid"].moved(offset=(0, 0, z)), baked=False)})
        assert_equals_full_bake(bake, SETTINGS)
        assert not bake.values("post").valid[inside].any()


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("expected", [True, False])
def test_rooms_that_fill_and_empty(expected, falloff):
    """Things move into a box, a crate without its lid and out again, through their walls; the boxes move as well."""
    settings = replace(SETTINGS, falloff=falloff, distance=0.3)
    crate = box((1.5, 0, 0), (2.5, 1, 1), 2, (0.1, 0.6, 0.3))
    meshes = {
        "ground": floor((-0.5, -0.5), (3, 1.5), 6, 4, z=0.02),
        "hall": box((0, 0, 0), (1, 1, 1), 2, (0.7, 0.3, 0.2)),
        "crate": mesh(crate.vertices, crate.triangles[:-8], crate.face[:-8], (0.1, 0.6, 0.3)),
        "ball": icosphere(1).moved(0.1, (0.3, 0.4, 0.2)),
        "sheet": grid((0.6, 0.6, 0.3), (0.2, 0, 0.05), (0, 0.2, 0)),
    }
    bake = IncrementalBake(objects_of(meshes), settings, movers={"ball", "crate"} if expected else set())
    assert_equals_full_bake(bake, settings)
    steps = [
        ("ball", (0.75, 0, 0)), ("ball", (1.6, 0.1, 0.2)), ("crate", (0.1, 0.1, 0.1)), ("ball", (3.0, 0, 0)),
        ("sheet", (1.2, 0, 0)), ("hall", (0.0, 0.0, 3.0)), ("ball", (0.1, 0.1, 0.1)), ("hall", (0.0, 0.0, 0.0)),
        ("ball", (0.0, 0.0, 3.0)), ("crate", (-1.37, 0.13, 0.06)), ("sheet", (0.0, 0.0, 0.0)),
    ]  # fmt: skip
    were_rooms = set()
    for key, offset in steps:
        meshes[key + " moved"] = meshes[key].moved(offset=offset)
        bake.update({key: scene_object(meshes[key + " moved"], 1000 * list(objects_of(meshes)).index(key))})
        assert_equals_full_bake(bake, settings)
        joined = join_objects(bake.objects.values())
        were_rooms.add(tuple(build_scene(joined.surfaces, joined.patches, settings, held=bake.held).rooms.body))
    assert len(were_rooms) > 3


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("key", ["room", "crate", "ball", "decal"])
def test_what_rays_meet_and_what_they_see_changes(key, falloff):
    """An object stops to occlude, or its colour is no longer seen, and back; then others move."""
    settings = replace(SETTINGS, falloff=falloff)
    meshes, bake = start(settings, ["other", "ball"])
    first_id = 1000 * list(meshes).index(key)
    plain = scene_object(meshes[key], first_id)
    n = len(plain.surfaces.triangles)
    unmet = replace(plain, surfaces=replace(plain.surfaces, occludes=np.zeros(n, bool)))
    nan = np.full((n, 3), np.nan, np.float32)
    unseen = replace(
        plain,
        surfaces=replace(plain.surfaces, reflectance=nan),
        reflectance=np.full_like(plain.reflectance, np.nan),
    )
    for changed in (unmet, plain, unseen, unmet, unseen, plain, unmet):
        bake.update({key: changed})
        assert_equals_full_bake(bake, settings)
        assert bake.update({key: replace(changed)}).patches == 0
    wander(meshes, bake, settings, [other for other in ("other", "ball") if other != key], 3, np.random.default_rng(3))
