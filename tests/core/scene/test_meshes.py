"""Plain triangle meshes as objects of a scene, by the front door of the core."""

import numpy as np
import pytest

from obscurance_addon import core
from obscurance_addon.core import (
    BakeSettings,
    GeometryError,
    IncrementalBake,
    Patches,
    SettingsError,
    bake_objects,
    mesh_object,
)
from obscurance_addon.core.light import LightSettings, LightSources, PatchMaterials, bake_light
from tests.core.scenes import box, floor, scene

FLOOR = floor((-2, -2), (2, 2), 8, 8, colour=(0.75, 0.25, 0.5))
BOX = box((-0.5, -0.5, 0), (0.5, 0.5, 1), 2, colour=(0.25, 0.5, 0.75))
SETTINGS = BakeSettings(rays=64, distance=1.0)


def as_object(m, **kw):
    return mesh_object(m.vertices, m.triangles, m.reflectance, face=m.face, **kw)


def test_it_gives_what_the_steps_by_hand_give():
    """Bit for bit: the floor is baked, the box occludes."""
    objects = [as_object(FLOOR, name="floor"), as_object(BOX, receives=False)]
    by_hand = scene([FLOOR], [BOX], ids=objects[0].patches.ids)
    expected = by_hand.bake(SETTINGS, neighbours=objects[0].neighbours, patch_reflectance=by_hand.patch_reflectance)
    baked = bake_objects(objects, SETTINGS)
    np.testing.assert_array_equal(baked.coloured, expected.coloured)
    np.testing.assert_array_equal(baked.r_ave, expected.r_ave)
    assert np.count_nonzero(~baked.valid) == 4, "the faces that lie wholly below the box"
    assert np.isfinite(baked.white).all()


def test_faces_in_any_order_keep_their_values_apart():
    """The triangles of a mesh shuffled: each face has its own triangles, whatever their order."""
    order = np.random.default_rng(0).permutation(len(BOX.triangles))
    ordered = as_object(BOX)
    shuffled = mesh_object(BOX.vertices, BOX.triangles[order], BOX.reflectance, face=BOX.face[order])
    assert (np.diff(shuffled.patches.patch) >= 0).all()
    for face in range(BOX.faces):
        one, other = (
            {tuple(map(tuple, c)) for c in o.patches.corners[o.patches.patch == face]} for o in (ordered, shuffled)
        )
        assert one == other


@pytest.mark.parametrize("reflectance", [0.5, (0.5, 0.5, 0.5), np.full((48, 3), 0.5)])
def test_reflectance_of_everything_or_of_each_face(reflectance):
    made = mesh_object(BOX.vertices, BOX.triangles, reflectance)
    np.testing.assert_array_equal(made.reflectance, np.full((48, 3), 0.5))
    np.testing.assert_array_equal(made.surfaces.reflectance, np.full((48, 3), np.float32(0.5)))
    assert made.surfaces.shells.solid.all()


def test_names_tell_rays_apart():
    one, same, other = (as_object(BOX, name=name).patches.ids for name in ("one", "one", "other"))
    np.testing.assert_array_equal(one, same)
    assert not np.isin(one, other).any()


def test_it_feeds_the_bake_of_a_changing_scene():
    objects = {"floor": as_object(FLOOR, name="floor"), "box": as_object(BOX, name="box")}
    whole = bake_objects(objects.values(), SETTINGS)
    assert IncrementalBake(objects, SETTINGS).patches == len(whole.grey)


@pytest.mark.parametrize("quantity", ["DIRECT", "COMBINED", "RADIOSITY"])
def test_it_feeds_the_bake_of_light(quantity):
    """Without anything that shines but the world: an open floor scatters its reflectance times the world's radiance."""
    made, world = as_object(FLOOR), np.array([1.0, 2.0, 3.0])
    materials = PatchMaterials(made.reflectance, np.zeros_like(made.reflectance))
    sources, light = LightSources(world=world), LightSettings(quantity)
    baked = bake_light(made.surfaces, made.patches, Patches.none(), materials, sources, SETTINGS, light)
    np.testing.assert_allclose(baked.radiance, made.reflectance * world, rtol=1e-6)


TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        (([0, 0, 0], [(0, 1, 2)]), {}, GeometryError, r"vertices have shape \(3,\): give \(v, 3\)"),
        ((TRIANGLE[0], [0, 1, 2]), {}, GeometryError, r"triangles has shape \(3,\): give \(t, 3\)"),
        ((TRIANGLE[0], [(0.0, 1.0, 2.0)]), {}, GeometryError, "triangles has dtype float64: give whole numbers"),
        ((TRIANGLE[0], [(0, 1, 3)]), {}, GeometryError, "triangles names 3: indices go from 0 to 3 - 1"),
        ((TRIANGLE[0], [(0, 1, -1)]), {}, GeometryError, "triangles names -1"),
        (TRIANGLE, {"face": [0, 1]}, GeometryError, r"face has shape \(2,\): give \(1\)"),
        (TRIANGLE, {"face": []}, GeometryError, r"face has shape \(0,\): give \(1\)"),
        (TRIANGLE, {"face": [-1]}, GeometryError, "face names -1: indices go from 0 to f - 1"),
        ((*TRIANGLE, np.zeros((2, 3))), {}, GeometryError, r"give a number, \(3,\) or \(1, 3\)"),
        ((*TRIANGLE, (255, 0, 0)), {}, SettingsError, "divide colours of 8 bits by 255"),
        ((*TRIANGLE, np.nan), {}, SettingsError, "reflectance goes from 0 to 1"),
    ],
)
def test_wrong_arrays_are_named(arguments, options, error, message):
    with pytest.raises(error, match=message):
        mesh_object(*arguments, **options)


def test_nothing_to_bake():
    for nothing in ([], [mesh_object(np.zeros((0, 3)), [])], [mesh_object(*TRIANGLE, receives=False)]):
        with pytest.raises(GeometryError, match="no face to bake"):
            bake_objects(nothing)


def test_the_front_door_has_all_that_it_names():
    assert all(hasattr(core, name) for name in core.__all__)
    assert len(core.__doc__.split("\n\n")) == 2
