"""Which layers are known as results, so that another bake may replace them; all others are the user's."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.writing.export_copy import ExportFormat, copy_for_export
from obscurance_addon.blender.writing.layers import AttributeNameError
from obscurance_addon.core.order import OutputSettings
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    cube,
    file_state,
    floor,
    job,
    put,
    read,
    select,
)
from tests.blender.jobs.test_lightmap_bake import bake_map

pytestmark = pytest.mark.usefixtures("empty_scene")
TAKEN = "'{}' has a color attribute named '{}', which a bake must not replace"


@pytest.fixture
def ob(empty_scene):
    """A selected cube with a result."""
    made = cube("Thing")
    bake(made)
    select(made)
    return made


def refuses(ob, name=FACE_LAYER, **changes):
    """The bake fails before it starts, for a layer of this name, and the file is as it was."""
    before = file_state()
    with pytest.raises(AttributeNameError, match=TAKEN.format(ob.name, name)):
        job(ob, **changes)
    assert file_state() == before


def overwrite(mesh, name):
    """Paint over a layer."""
    mesh.attributes[name].data.foreach_set("color", np.full(len(mesh.attributes[name].data) * 4, 0.25, np.float32))


# ----------------------------------------------------------------------------------------------------- what users do


def test_a_result_that_was_painted_over_is_still_one(ob):
    """Alpha and all."""
    expected = read(ob.data, FACE_LAYER)
    for name in (FACE_LAYER, CORNER_LAYER):
        overwrite(ob.data, name)
    bake(ob)
    assert np.array_equal(read(ob.data, FACE_LAYER), expected)


def test_a_result_that_was_renamed_is_the_users(ob):
    """Another bake makes a new one beside it; one that is told to go there is refused."""
    for name, new in ((FACE_LAYER, "Mine"), (CORNER_LAYER, "Mine Color")):
        ob.data.attributes[name].name = new
        overwrite(ob.data, new)
    kept = [read(ob.data, name) for name in ("Mine", "Mine Color")]
    bake(ob)
    refuses(ob, "Mine", attribute_name="Mine", corner_copy=False)
    ob.data.attributes["Mine"].name = "Kept"
    refuses(ob, "Mine Color", attribute_name="Mine")
    assert np.array_equal(read(ob.data, "Kept"), kept[0])
    assert np.array_equal(read(ob.data, "Mine Color"), kept[1])
    assert {FACE_LAYER, CORNER_LAYER} <= set(ob.data.attributes.keys())


def test_renamed_as_it_was_baked_it_is_the_users_too(ob):
    """Although it looks like a result of version 0.1.0."""
    for name, new in ((FACE_LAYER, "Mine"), (CORNER_LAYER, "Mine Color")):
        ob.data.attributes[name].name = new
    ob.data.attributes.new("Other", "FLOAT", "FACE")
    ob.data.update()
    bpy.context.view_layer.update()
    assert not len(ob.data.obscurance_layers)
    refuses(ob, "Mine", attribute_name="Mine")


@pytest.mark.parametrize(("data_type", "domain"), [("BYTE_COLOR", "FACE"), ("FLOAT_COLOR", "POINT")])
def test_a_result_of_which_type_or_domain_were_changed_is_the_users(ob, data_type, domain):
    ob.data.attributes.active = ob.data.attributes[FACE_LAYER]
    bpy.ops.geometry.attribute_convert(mode="GENERIC", domain=domain, data_type=data_type)
    refuses(ob)


def test_a_layer_that_gets_the_name_of_a_removed_result_is_the_users(ob):
    """Of the same type and domain; also once results have other names."""
    bake(ob, attribute_name="Other")
    for name in (FACE_LAYER, CORNER_LAYER):
        ob.data.attributes.remove(ob.data.attributes[name])
    bpy.context.view_layer.update()
    put(ob.data, CORNER_LAYER, "FLOAT_COLOR", "CORNER")
    refuses(ob, CORNER_LAYER)
    bake(ob, attribute_name="Other")


def test_a_result_that_was_removed_is_back_after_undo(ob):
    """And still known as one."""
    bpy.ops.ed.undo_push(message="baked")
    ob.data.attributes.remove(ob.data.attributes[FACE_LAYER])
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="removed")
    bpy.ops.ed.undo()
    ob = bpy.data.objects["Thing"]
    assert FACE_LAYER in ob.data.attributes
    bake(ob)
    bpy.ops.ed.undo_push(message="baked again")
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    bake(bpy.data.objects["Thing"])


# ------------------------------------------------------------------------------------------------ what carries it along


def duplicated(_ob, _tmp_path):
    bpy.ops.object.duplicate()
    return bpy.context.object


def shared(ob, _tmp_path):
    twin = bpy.data.objects.new("Twin", ob.data)
    bpy.context.scene.collection.objects.link(twin)
    return twin


def reloaded(_ob, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    return bpy.data.objects["Thing"]


def appended(_ob, tmp_path, link=False):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "file.blend"), link=link) as (_, found):
        found.objects = ["Thing"]
    bpy.context.scene.collection.objects.link(found.objects[0])
    return found.objects[0]


def linked_and_made_local(ob, tmp_path):
    made = appended(ob, tmp_path, link=True)
    select(made)
    bpy.ops.object.make_local(type="SELECT_OBDATA")
    return bpy.data.objects["Thing"]


def subdivided(ob, _tmp_path):
    ob.modifiers.new("Subdivision", "SUBSURF")
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    return ob


def converted(ob, _tmp_path):
    ob.modifiers.new("Array", "ARRAY")
    bpy.ops.object.convert(target="MESH")
    return bpy.context.object


def edited(ob, _tmp_path):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    return ob


def separated(ob, _tmp_path):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.bisect(plane_co=(0, 0, 0), plane_no=(0, 0, 1))
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.mesh.separate(type="LOOSE")
    bpy.ops.object.mode_set(mode="OBJECT")
    return next(other for other in bpy.data.objects if other != ob)


def joined(ob, _tmp_path):
    select(ob, cube("Other"))
    bpy.ops.object.join()
    return ob


@pytest.mark.parametrize(
    "change",
    [
        duplicated,
        shared,
        reloaded,
        appended,
        linked_and_made_local,
        subdivided,
        converted,
        edited,
        separated,
        joined,
    ],
)
def test_a_result_stays_known(ob, tmp_path, change):
    """Another bake fills it, for each target, and a copy for export made of it before."""
    copy_for_export([ob], OutputSettings(), ExportFormat.USD)
    ob = change(ob, tmp_path)
    for target in ("FACE", "CORNER", "POINT"):
        bake(ob, target=target)
        assert (ob.data.attributes[FACE_LAYER].data_type, ob.data.attributes[FACE_LAYER].domain) == (
            "FLOAT_COLOR",
            target,
        )
        assert (read(ob.data, FACE_LAYER)[:, 3] == 1.0).all()
    assert copy_for_export([ob], OutputSettings(target="POINT"), ExportFormat.USD)[0] == [ob.name]


@pytest.mark.parametrize("painted", [False, True])
def test_joined_to_an_object_without_a_record(ob, painted):
    """A viewport copy still tells the result by its values; one that was painted over is the user's from then on."""
    if painted:
        ob.data.attributes[CORNER_LAYER].data[2].color = (0.5, 0.5, 0.5, 1.0)
    other = cube("Other")
    select(other, ob)
    bpy.ops.object.join()
    if painted:
        refuses(other)
    else:
        bake(other)


@pytest.mark.parametrize("shared_meshes", ["SEPARATE", "AVERAGE"])
@pytest.mark.parametrize("both", [False, True])
def test_a_shared_mesh_with_a_layer_of_the_users(shared_meshes, both):
    """Refused whether the bake would copy it or not."""
    one = floor("One", n=2)
    two = bpy.data.objects.new("Two", one.data)
    bpy.context.scene.collection.objects.link(two)
    put(one.data, FACE_LAYER, "FLOAT_COLOR", "FACE")
    before = file_state()
    with pytest.raises(AttributeNameError, match=TAKEN.format("One", FACE_LAYER)):
        job(*([one, two] if both else [one]), shared_meshes=shared_meshes)
    assert file_state() == before


# ------------------------------------------------------------------------------------------------------- lightmaps


def test_colors_beside_a_lightmap_on_a_kept_uv_map_stay_a_result(ob):
    """Both have one name, and one record."""
    ob.data.uv_layers.new(name="Mine")
    bake_map(ob, uv_mode="KEEP", uv_map="Mine")
    bake(ob)
    bake_map(ob)
    assert ob.data.uv_layers.keys() == ["Mine", FACE_LAYER]


def test_a_uv_map_that_was_renamed_is_the_users():
    """The next bake makes another one, and may not go where that is."""
    ob = floor()
    bake_map(ob)
    ob.data.uv_layers[FACE_LAYER].name = "Mine"
    bake_map(ob)
    assert ob.data.uv_layers.keys() == ["Mine", FACE_LAYER]
    with pytest.raises(AttributeNameError, match="has a UV map named 'Mine'"):
        bake_map(ob, attribute_name="Mine")


# ---------------------------------------------------------------------------------------------------- earlier versions


@pytest.fixture
def first_release(ob):
    """The result as version 0.1.0 left it, without a record."""
    ob.data.property_unset("obscurance_layers")
    return ob


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT", "LIGHTMAP"])
def test_results_of_the_first_release_are_told(first_release, target):
    """By a viewport copy that equals the faces; both stay results whatever the first bake fills."""
    bake_map(first_release) if target == "LIGHTMAP" else bake(first_release, target=target)
    bake(first_release)
    bake(first_release, attribute_name=CORNER_LAYER, corner_copy=False)


def test_results_of_the_first_release_are_told_after_a_copy(first_release):
    copy_for_export([first_release], OutputSettings(), ExportFormat.GLTF)
    bake(first_release)


@pytest.mark.parametrize("name", [FACE_LAYER, CORNER_LAYER])
def test_results_of_the_first_release_that_were_painted_over_are_not_told(first_release, name):
    first_release.data.attributes[name].data[2].color = (0.5, 0.5, 0.5, 1.0)
    refuses(first_release)
    refuses(first_release, CORNER_LAYER, attribute_name=CORNER_LAYER, target="CORNER")


def test_records_without_a_type_are_those_of_colors_or_of_a_uv_map(ob):
    """As they were kept before they had one."""
    for found in ob.data.obscurance_layers:
        found.data_type = found.domain = ""
    bake(ob)
    bake_map(ob)
    found = ob.data.obscurance_layers[FACE_LAYER]
    found.data_type, found.domain, found.made_uv_map = "", "", True
    bake_map(ob)
    bake(ob)
