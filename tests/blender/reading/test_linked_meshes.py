"""Meshes from other files cannot be written: named and skipped."""

import bpy
import pytest

from obscurance_addon.core.errors import ObscuranceError
from tests.blender.helpers import FACE_LAYER, bake, colors, cube, file_state, floor, job, notes_about

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.fixture
def library(tmp_path):
    """A .blend file with a cube called 'Thing' at x = 5."""
    cube("Thing").location = (5.0, 0.0, 0.0)
    path = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def linked(path):
    with bpy.data.libraries.load(str(path), link=True) as (_, found):
        found.objects = ["Thing"]
    (ob,) = found.objects
    bpy.context.scene.collection.objects.link(ob)
    return ob


def overridden(path):
    ob = linked(path)
    made = ob.override_create(remap_local_usages=True)
    assert made.library is None
    assert made.data.library is not None
    return made


def overridden_mesh(path):
    """An override of the mesh too, which is local by name but takes no attributes to the file."""
    made = overridden(path)
    mesh = made.data.override_create(remap_local_usages=True)
    made.data = mesh
    assert mesh.override_library is not None
    return made


def local_object(path):
    """A local object that uses a linked mesh."""
    ob = bpy.data.objects.new("Local", linked(path).data)
    bpy.context.scene.collection.objects.link(ob)
    return ob


@pytest.mark.parametrize("make", [linked, overridden, overridden_mesh, local_object])
def test_linked_meshes_are_named_and_skipped(library, make):
    """The floor beside it is baked; the warning names object, reason and cure; its mesh has no new layer."""
    other, ob = make(library), floor()
    names = list(other.data.attributes.keys())
    report = bake(other, ob)
    assert report.objects == ["Floor"]
    assert FACE_LAYER in ob.data.attributes
    assert list(other.data.attributes.keys()) == names
    assert notes_about(report.warnings, f"'{other.name}'", "linked from a library", "local")


@pytest.mark.parametrize("make", [linked, overridden, overridden_mesh, local_object])
def test_linked_meshes_alone_fail_by_name(library, make):
    """There is nothing to bake, and the file stays as it was."""
    ob = make(library)
    before = file_state()
    with pytest.raises(ObscuranceError, match=rf"nothing to bake.*linked from a library.*'{ob.name}'"):
        job(ob)
    assert file_state() == before


def test_a_local_object_of_the_same_name_is_baked(library):
    """Names repeat between a file and its libraries."""
    other = linked(library)
    ob = cube("Thing")
    assert ob.name == other.name
    report = bake(other, ob)
    assert report.objects == ["Thing"]
    assert FACE_LAYER in ob.data.attributes
    assert FACE_LAYER not in other.data.attributes


def test_linked_objects_occlude(library):
    """A floor around the linked cube is darker than one in the open."""
    ob = floor(n=1)
    bake(ob)
    open_value = colors(ob)[0, 0]
    linked(library)
    ob.location = (5.0, 2.0, 0.0)
    bake(ob)
    assert colors(ob)[0, 0] < open_value - 0.02
