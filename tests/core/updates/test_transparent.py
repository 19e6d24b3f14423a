"""With transparent objects, too, an incremental bake has the values of a full bake, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import Mesh, box, floor, grid, icosphere
from tests.core.updates.changing_scenes import assert_equals_full_bake, furniture, objects_of, scene_object
from tests.core.updates.test_incremental import wander

SETTINGS = BakeSettings(16, distance=0.2, threads=2)


def holes(triangles: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A red filter with holes, on the half of each triangle near its first corner."""
    return np.where(places[:, :1] > 0.5, np.float32([1.0, 1.0, 1.0]), np.float32([0.6, 0.1, 0.1]))


def glasshouse() -> dict[str, Mesh]:
    """The furniture, with a crate of glass, leaves with holes beside each other, and a pane before a wall."""
    meshes = furniture()
    meshes["other"] = meshes["other"].letting_through((0.9, 0.6, 0.4))
    meshes["sheet"] = meshes["sheet"].letting_through((0.7, 0.325, 0.325), holes)
    pane = grid((0.1, 0.02, 0.1), (0.5, 0, 0), (0, 0, 0.5), 2, 2, colour=(0.2, 0.7, 0.3)).letting_through(0.5)
    return meshes | {"pane": pane, "leaf": pane.moved(0.6, (0.3, 0.5, 0.2)).letting_through((0.7, 0.325, 0.325), holes)}


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("use_bleeding", [True, False])
@pytest.mark.parametrize(
    "movers", [("other", "leaf"), ("ball",), ("pane", "ball", "sheet"), ("crate", "leaf")], ids="-".join
)
def test_movers_before_and_behind_what_is_transparent(movers, falloff, use_bleeding):
    settings = replace(SETTINGS, falloff=falloff, use_bleeding=use_bleeding)
    meshes = glasshouse()
    bake = IncrementalBake(objects_of(meshes), settings, movers=frozenset(movers))
    assert_equals_full_bake(bake, settings)
    wander(meshes, bake, settings, list(movers), 6, np.random.default_rng(3))
    assert bake.last.cached > 0  # some cells are still kept


def test_objects_that_nobody_expected_to_move():
    meshes = glasshouse()
    bake = IncrementalBake(objects_of(meshes), SETTINGS)
    wander(meshes, bake, SETTINGS, ["sheet", "ball", "pane", "room", "other"], 8, np.random.default_rng(4), size=0.05)


@pytest.mark.parametrize("falloff", [Falloff.LINEAR, Falloff.STEP])
def test_more_or_less_light_passes(falloff):
    """An object that becomes transparent, has other holes and becomes opaque again; the first one, and among others."""
    settings = replace(SETTINGS, falloff=falloff)
    for meshes in (furniture(), glasshouse()):
        bake = IncrementalBake(objects_of(meshes), settings, movers={"ball"})
        for key in ("ball", "decal", "crate"):
            mesh, first_id = meshes[key], 1000 * list(meshes).index(key)
            for other in (mesh.letting_through(0.3), mesh.letting_through((0.7, 0.325, 0.325), holes), mesh):
                bake.update({key: scene_object(other, first_id)})
                assert_equals_full_bake(bake, settings)
                bake.update({"ball": scene_object(meshes["ball"].moved(offset=(0.01, 0.0, 0.0)), 6000)})
                assert_equals_full_bake(bake, settings)


def test_colours_of_transparent_objects():
    """R_ave follows, and hits stay known."""
    meshes = glasshouse()
    bake = IncrementalBake(objects_of(meshes), SETTINGS, movers={"ball"})
    for key, colour in (("pane", (0.1, 0.2, 0.3)), ("crate", (0.4, 0.4, 0.1))):
        bake.update({key: scene_object(meshes[key].coloured(colour), 1000 * list(meshes).index(key))})
        assert_equals_full_bake(bake, SETTINGS)


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_what_moves_behind_a_leaf_inside_of_a_solid(falloff):
    """Whether rays of a patch start inside of a block does not depend on what moves in there, behind glass or not."""
    settings = BakeSettings(64, distance=0.02, falloff=falloff, threads=1)
    ball = icosphere(1).moved(0.1, (3.0, 3.0, 0.0))
    meshes = {
        "patch": floor((-0.2, -0.02), (3.8, 0.02), 20, 1, z=0.0),
        "outside": floor((2.0, 2.0), (2.5, 2.5)),
        "glass": icosphere(2).moved(0.125).letting_through(0.5),
        "block": box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
        "ball": ball,
    }
    bake = IncrementalBake(objects_of(meshes, ["glass", "block"]), settings, movers={"ball"})
    assert_equals_full_bake(bake, settings)
    valid = bake.values("patch").valid
    assert valid.any()
    assert not valid.all()
    for x, y in ((0.5, 0.0), (-0.5, 0.0), (3.0, 3.0)):
        bake.update({"ball": scene_object(ball.moved(offset=(x - 3.0, y - 3.0, 0.5)), 4000)})
        assert_equals_full_bake(bake, settings)
        np.testing.assert_array_equal(bake.values("patch").valid, valid)
