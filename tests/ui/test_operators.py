"""The operator as scripts and background mode call it."""

import bmesh
import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.ui import operators
from tests.blender.helpers import CORNER_LAYER, FACE_LAYER, colors, cube, file_state, select, sheet

pytestmark = pytest.mark.usefixtures("empty_scene")
UNDO = True


@pytest.fixture
def scene(empty_scene):
    """A floor with a red wall on its edge; the floor is selected and active."""
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=(0.8, 0.1, 0.1))
    empty_scene.obscurance.rays = 16
    select(ob)
    return ob


def wall():
    return bpy.data.objects["Wall"]


# ------------------------------------------------------------------------------------------------------ runs or fails


@pytest.mark.parametrize("context", ["EXEC_DEFAULT", "INVOKE_DEFAULT"])
def test_it_blocks_and_finishes(scene, context):
    """The values are there when it returns, also when a button's way of calling is used in background mode."""
    assert bpy.ops.obscurance.bake(context) == {"FINISHED"}
    assert colors(scene)[0, 0] != 1.0
    assert FACE_LAYER not in wall().data.attributes


def test_it_bakes_all_selected_objects(scene):
    """And only these."""
    other = cube("Other")
    select(scene, wall())
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert FACE_LAYER in scene.data.attributes
    assert FACE_LAYER in wall().data.attributes
    assert FACE_LAYER not in other.data.attributes


def test_its_values_are_those_of_a_job(scene):
    """Bit for bit, with the scene's settings."""
    bpy.context.scene.obscurance.seed = 5
    bpy.ops.obscurance.bake()
    found = colors(scene)
    group = bpy.context.scene.obscurance
    BakeJob(bpy.context, [scene], group.to_settings(), group.to_output()).run()
    assert np.array_equal(colors(scene), found)


def test_poll_says_what_is_missing(scene):
    """Nothing selected, or no mesh: it cannot be called, and the message tells the cure."""
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    for selection in ([], [lamp]):
        select(*selection)
        assert not bpy.ops.obscurance.bake.poll()
        with pytest.raises(RuntimeError, match="Select at least one mesh object"):
            bpy.ops.obscurance.bake()
    select(lamp, scene)
    assert bpy.ops.obscurance.bake.poll()


def test_an_empty_scene_cannot_be_baked(empty_scene):
    """There is nothing to select."""
    assert not bpy.ops.obscurance.bake.poll()


def no_distance(_ob):
    bpy.context.scene.obscurance.distance_mode = "METRES"
    bpy.context.scene.obscurance.distance = 0.0


def taken_name(ob):
    ob.data.uv_layers.new(name=FACE_LAYER)


def painted(ob):
    ob.data.attributes.new(FACE_LAYER, "FLOAT_COLOR", "FACE")


def empty_name(_ob):
    bpy.context.scene.obscurance.attribute_name = ""


def hidden(ob):
    ob.hide_render = True


def no_faces(ob):
    ob.data.clear_geometry()


def flat_point(ob):
    ob.scale = (0.0, 0.0, 0.0)
    wall().hide_render = True


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (no_distance, "Distance is 0 m"),
        (taken_name, "Object 'Floor' has a UV map named 'Obscurance'"),
        (painted, "Object 'Floor' has a color attribute named 'Obscurance'.*choose another.*rename or remove"),
        (empty_name, "needs a name"),
        (hidden, "'Floor'"),
        (no_faces, "without faces.*'Floor'"),
        (flat_point, "no extent"),
    ],
)
def test_it_raises_what_is_wrong(scene, spoil, words):
    """As a RuntimeError that names it; the file stays as it was, the mode too."""
    spoil(scene)
    before = file_state()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.obscurance.bake()
    assert file_state() == before


# --------------------------------------------------------------------------------------------------------------- undo


def test_one_undo_restores_the_scene(scene):
    """And one redo brings the values back."""
    scene.data.color_attributes.new("Mine", "BYTE_COLOR", "CORNER")
    before = file_state()
    bpy.ops.ed.undo_push(message="Before")
    bpy.ops.obscurance.bake("EXEC_DEFAULT", UNDO)
    after = file_state()
    assert before != after
    bpy.ops.ed.undo()
    assert file_state() == before
    bpy.ops.ed.redo()
    assert file_state() == after


def test_one_undo_takes_copies_of_shared_meshes_back(scene):
    """Both objects use the one mesh again."""
    other = bpy.data.objects.new("Other", scene.data)
    bpy.context.scene.collection.objects.link(other)
    select(scene, other)
    before = file_state()
    bpy.ops.ed.undo_push(message="Before")
    bpy.ops.obscurance.bake("EXEC_DEFAULT", UNDO)
    assert scene.data != other.data
    bpy.ops.ed.undo()
    assert file_state() == before


# -------------------------------------------------------------------------------------------------------------- modes


def edit(*objects):
    select(*objects)
    bpy.ops.object.mode_set(mode="EDIT")


def picked(ob):
    """Selected vertices, edges and faces in Edit Mode."""
    mesh = bmesh.from_edit_mesh(ob.data)
    return [[x.select for x in domain] for domain in (mesh.verts, mesh.edges, mesh.faces)]


def test_edit_mode_is_left_and_entered_again(scene):
    """With edits that were not yet in the mesh, the elements selected in it, and select mode."""
    edit(scene)
    bpy.ops.mesh.select_mode(type="FACE")
    bpy.ops.mesh.select_all(action="DESELECT")
    mesh = bmesh.from_edit_mesh(scene.data)
    mesh.faces.ensure_lookup_table()
    mesh.faces[2].select_set(True)
    for vertex in mesh.verts:
        vertex.co.z += 0.25
    bmesh.update_edit_mesh(scene.data)
    before = picked(scene)
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert scene.mode == "EDIT"
    assert picked(scene) == before
    assert tuple(bpy.context.tool_settings.mesh_select_mode) == (False, False, True)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert {v.co.z for v in scene.data.vertices} == {0.25}
    assert len(colors(scene)) == 4
    assert len(np.unique(colors(scene)[:, 0])) > 1


def test_several_objects_in_edit_mode_come_back_with_the_same_selection(scene):
    """Two are edited, a third one is selected along; modes, selection and active object are as before."""
    other, third = cube("Other"), cube("Third")
    edit(wall(), scene)
    third.select_set(True)
    before = {ob.name: (ob.mode, ob.select_get()) for ob in bpy.context.view_layer.objects}
    assert {name for name, (mode, _) in before.items() if mode == "EDIT"} == {"Floor", "Wall"}
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert {ob.name: (ob.mode, ob.select_get()) for ob in bpy.context.view_layer.objects} == before
    assert bpy.context.view_layer.objects.active == wall()
    bpy.ops.object.mode_set(mode="OBJECT")
    for ob in (scene, wall(), third):
        assert FACE_LAYER in ob.data.attributes
    assert FACE_LAYER not in other.data.attributes


def test_an_edited_object_that_is_not_selected_stays_in_edit_mode(scene):
    """It occludes as it is being edited."""
    edit(wall())
    wall().select_set(False)
    scene.select_set(True)
    before = {ob.name: (ob.mode, ob.select_get()) for ob in bpy.context.view_layer.objects}
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert {ob.name: (ob.mode, ob.select_get()) for ob in bpy.context.view_layer.objects} == before


@pytest.mark.parametrize("mode", ["SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT", "EDIT"])
@pytest.mark.parametrize("fails", [False, True])
def test_the_mode_comes_back_after_success_and_failure(scene, mode, fails):
    """Whatever the mode was, it is entered again."""
    bpy.ops.object.mode_set(mode=mode)
    if fails:
        no_distance(scene)
        with pytest.raises(RuntimeError, match="Distance is 0 m"):
            bpy.ops.obscurance.bake()
    else:
        bpy.ops.obscurance.bake()
    assert scene.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (FACE_LAYER in scene.data.attributes) == (not fails)


def test_pose_mode_of_another_object_comes_back(scene):
    """The rig is active and posed, the floor is selected beside it."""
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    edit(rig)
    rig.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="POSE")
    scene.select_set(True)
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert rig.mode == "POSE"
    assert scene.select_get()
    assert bpy.context.view_layer.objects.active == rig
    assert FACE_LAYER in scene.data.attributes


# ---------------------------------------------------------------------------------------------------- around the file


def test_it_is_in_the_object_menu_once():
    """Registering put one entry there."""
    drawn = [f for f in bpy.types.VIEW3D_MT_object._dyn_ui_initialize() if "obscurance_addon" in f.__module__]
    assert len(drawn) == 1


def test_values_are_in_the_saved_file(scene, tmp_path):
    """Saved and loaded, the attributes are bit for bit the same."""
    bpy.ops.obscurance.bake()
    face, corner = colors(scene), colors(scene, CORNER_LAYER)
    path = str(tmp_path / "baked.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    again = bpy.data.objects["Floor"]
    assert np.array_equal(colors(again), face)
    assert np.array_equal(colors(again, CORNER_LAYER), corner)
    assert again.data.attributes.active_color_name == CORNER_LAYER


def test_unregistering_takes_everything_away_and_registering_brings_it_back(scene):
    """Twice in a row, without an error, and the operator works afterwards."""
    import obscurance_addon

    for _ in range(2):
        obscurance_addon.unregister()
        assert not hasattr(bpy.types.Scene, "obscurance")
        assert not hasattr(bpy.types, "OBSCURANCE_OT_bake")
        assert not hasattr(bpy.types, "OBSCURANCE_PT_bake")
        obscurance_addon.register()
    assert bpy.context.scene.obscurance.rays == 16
    assert bpy.ops.obscurance.bake() == {"FINISHED"}


def test_only_what_has_a_surface_is_taken_from_the_selection(scene, monkeypatch):
    """Selecting all is what artists do: a camera is passed over, while a curve goes on to be named in a warning."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    curve = bpy.data.objects.new("Curve", bpy.data.curves.new("Curve", "CURVE"))
    for ob in (camera, curve):
        bpy.context.scene.collection.objects.link(ob)
        ob.select_set(True)
    warnings = []

    def job(*arguments, **keywords):
        made = BakeJob(*arguments, **keywords)
        warnings.extend(made._warnings)
        return made

    monkeypatch.setattr(operators, "BakeJob", job)
    assert bpy.ops.obscurance.bake() == {"FINISHED"}
    assert any("'Curve'" in warning for warning in warnings)
    assert not any("Camera" in warning for warning in warnings)
    assert FACE_LAYER in scene.data.attributes
