"""Meshes that several objects use: a copy for each, or the mean."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.writing import color_attribute
from obscurance_addon.blender.writing.layers import AttributeNameError
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    baked,
    colors,
    file_state,
    floor,
    job,
    mesh_state,
    notes_about,
    subset,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def pair():
    """Two floors of one mesh: 'Open' in the open, 'Covered' below a ceiling."""
    covered = floor("Covered", n=2)
    open_ = bpy.data.objects.new("Open", covered.data)
    open_.location = (20.0, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(open_)
    floor("Ceiling", size=1.5, z=0.2)
    return covered, open_


def alone(name):
    """The values that this object of the pair has by itself."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    covered, open_ = pair()
    ob = {"Covered": covered, "Open": open_}[name]
    ob.data = ob.data.copy()
    return baked(ob)


def test_separate_gives_each_object_its_own_values():
    """Those that it has alone with a mesh of its own; the copy is reported, by mesh and object.

    Rays start 1e-5 of the extent of all that is baked, here 20 m, above their face: hence the tolerance.
    """
    expected = {name: alone(name) for name in ("Covered", "Open")}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    covered, open_ = pair()
    mesh = covered.data
    report = bake(covered, open_)
    assert covered.data == mesh
    assert open_.data != mesh
    assert np.allclose(colors(covered), expected["Covered"], atol=2e-4)
    assert np.allclose(colors(open_), expected["Open"], atol=1e-6)
    assert colors(covered).max() < 0.9 < colors(open_).min()
    (note,) = report.warnings
    assert "their mesh was shared, so these got a copy of their own: 'Open'; " in note


def test_an_object_that_is_not_baked_keeps_the_original_mesh():
    """The baked one gets the copy; the mesh that both had is untouched."""
    covered, open_ = pair()
    mesh = covered.data
    before = mesh_state(mesh)
    report = bake(covered)
    assert open_.data == mesh
    assert covered.data != mesh
    assert mesh_state(mesh) == before | {"users": 1}
    assert FACE_LAYER in covered.data.attributes
    assert notes_about(report.warnings, "mesh was shared", "'Covered'")


def test_baking_again_makes_no_more_copies():
    """After the first bake nothing is shared any more."""
    covered, open_ = pair()
    bake(covered, open_)
    meshes = bpy.data.meshes.keys()
    report = bake(covered, open_)
    assert bpy.data.meshes.keys() == meshes
    assert not notes_about(report.warnings, "shared")


def test_copies_keep_everything_that_the_mesh_had():
    """Shape keys, UV maps, materials and custom properties are those of the original."""
    covered, open_ = pair()
    mesh = covered.data
    mesh.uv_layers.new(name="Map")
    mesh["note"] = "mine"
    mesh.materials.append(bpy.data.materials.new("Paint"))
    covered.shape_key_add(name="Basis")
    before = mesh_state(mesh)
    bake(covered, open_)
    written = (FACE_LAYER, CORNER_LAYER)
    for ob in (covered, open_):
        assert subset(mesh_state(ob.data, without=written)) == subset(before)


def test_average_keeps_the_mesh_shared():
    """Its values are the mean of what each object would get."""
    covered, open_ = pair()
    mesh = covered.data
    bake(covered, open_, shared_meshes="SEPARATE")
    mean = 0.5 * (colors(covered) + colors(open_))
    other = open_.data
    open_.data = mesh
    bpy.data.meshes.remove(other)
    meshes = bpy.data.meshes.keys()
    report = bake(covered, open_, shared_meshes="AVERAGE")
    assert covered.data == open_.data == mesh
    assert bpy.data.meshes.keys() == meshes
    assert np.allclose(colors(covered), mean, atol=1e-6)
    assert not notes_about(report.warnings, "copy")


def test_average_of_one_user_is_its_value():
    """The user that is not baked shares the result."""
    covered, open_ = pair()
    expected = baked(covered, shared_meshes="AVERAGE")
    assert covered.data == open_.data
    assert expected.max() < 0.9


def test_copies_are_taken_back_when_writing_fails(monkeypatch):
    """The second mesh cannot take the attribute: both objects have the one mesh again, and no copy is left."""
    covered, open_ = pair()
    covered.shape_key_add(name="Basis")
    running = job(covered, open_)
    while not running.step(1.0):
        pass
    before = file_state()
    prepare, calls = color_attribute.prepare, []

    def fails_later(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise AttributeNameError("no room")
        return prepare(*arguments)

    monkeypatch.setattr(color_attribute, "prepare", fails_later)
    with pytest.raises(AttributeNameError):
        running.commit()
    assert len(calls) == 3
    assert covered.data == open_.data
    assert file_state() == before
