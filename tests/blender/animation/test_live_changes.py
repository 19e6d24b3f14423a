"""Changes that Live Preview might miss, or never be done with."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.live_preview import PREVIEW
from tests.blender.animation.preview_helpers import SETTINGS, assert_as_baked_anew, at, baked_anew, counted, key
from tests.blender.helpers import FACE_LAYER, bake, colors, floor, job, new_object


def idle(monkeypatch, frames=(20, 21, 22)):
    """Patches that are baked again in frames in which nothing changes."""
    with counted(monkeypatch) as reports:
        for frame in frames:
            at(frame)
    return [report.patches for report in reports]


def test_another_scene_is_not_taken_for_this_one(preview):
    bpy.ops.scene.new(type="FULL_COPY")
    other = bpy.context.scene
    assert other.obscurance.live_preview
    next(ob for ob in other.objects if ob.name.startswith("Mover")).location.x += 0.6
    at(2)
    assert_as_baked_anew([ob for ob in other.objects if ob.type == "MESH"])


def test_a_copy_of_an_object_is_followed_too(preview):
    twin = preview["Block"].copy()
    twin.data = preview["Block"].data.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.location = (-1.0, -1.0, 0.3)
    at(2)
    assert_as_baked_anew([*preview.values(), twin])
    twin.location.x += 0.4
    at(3)
    assert_as_baked_anew([*preview.values(), twin])


def test_objects_that_share_a_mesh_get_meshes_of_their_own_when_it_is_switched_on(room, empty_scene):
    twin = room["Block"].copy()
    empty_scene.collection.objects.link(twin)
    twin.location = (-1.0, -1.0, 0.3)
    empty_scene.obscurance.live_preview = True
    assert twin.data != room["Block"].data
    at(2)
    assert_as_baked_anew([*room.values(), twin])


def test_objects_that_come_to_share_a_mesh_show_the_mean_and_are_named(preview, caplog):
    """A mesh that is made within a frame change would be in no undo step, where Blender crashes at the next undo."""
    twin = preview["Block"].copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.location = (-1.0, -1.0, 0.3)
    with caplog.at_level("INFO"):
        for frame in (2, 3, 4):
            at(frame)
    assert twin.data == preview["Block"].data
    assert_as_baked_anew([*preview.values(), twin], shared_meshes="AVERAGE")
    (told,) = [record.message for record in caplog.records if "mean" in record.message]
    assert "'Block', 'Block.001'" in told


def test_an_object_that_is_renamed_casts_the_rays_of_its_new_name(preview):
    preview["Block"].name = "Renamed"
    at(2)
    assert_as_baked_anew(preview.values())


def test_a_mesh_that_is_exchanged_for_an_equal_one_gets_values(preview):
    mesh = preview["Block"].data.copy()
    for name in [attribute.name for attribute in mesh.attributes if attribute.name.startswith(FACE_LAYER)]:
        mesh.attributes.remove(mesh.attributes[name])
    preview["Block"].data = mesh
    at(2)
    assert_as_baked_anew(preview.values())


def test_faces_that_hang_together_alike_are_told_apart(room, empty_scene):
    """A mask that shows one half of a grid, then the other."""
    ground = room["Floor"]
    for name, half in (("Low", range(0, 36)), ("High", range(45, 81))):
        ground.vertex_groups.new(name=name).add(list(half), 1.0, "REPLACE")
    mask = ground.modifiers.new("Mask", "MASK")
    mask.vertex_group = "Low"
    empty_scene.obscurance.live_preview = True
    at(1)
    mask.vertex_group = "High"
    at(2)
    full = baked_anew(room.values())
    for name, ob in room.items():  # the recentring is that of the other half
        np.testing.assert_allclose(colors(ob), full[name], atol=1e-5)


def test_vertices_below_a_subdivision_may_move(room, empty_scene):
    empty_scene.obscurance.target = "POINT"
    room["Mover"].location.z = 1.0
    room["Mover"].modifiers.new("Subdivision", "SUBSURF").levels = 1
    empty_scene.obscurance.live_preview = True
    at(1)
    room["Mover"].data.vertices[0].co *= 0.5
    room["Mover"].data.update()
    at(2)
    assert_as_baked_anew(room.values(), target="POINT")


def test_what_other_handlers_do_to_meshes_is_seen(preview):
    def edit(_scene, _depsgraph):
        mesh = preview["Mover"].data
        mesh.vertices[7].co.z = 0.2
        mesh.update()

    handlers = bpy.app.handlers.frame_change_post
    handlers.insert(0, edit)
    try:
        at(2)
    finally:
        handlers.remove(edit)
    assert_as_baked_anew(preview.values())


def test_an_edit_during_a_bake_that_is_cancelled_is_seen(preview):
    running = job(*preview.values(), **SETTINGS | {"rays": 64})
    preview["Mover"].data.vertices[7].co.z = 0.2
    preview["Mover"].data.update()
    at(2)
    running.cancel()
    at(3)
    assert_as_baked_anew(preview.values())


@pytest.mark.parametrize("quantity", ["OBSCURANCE", "DIRECT"])
def test_modifiers_that_keep_no_link_do_not_bake_for_ever(room, empty_scene, monkeypatch, quantity):
    remesh = room["Mover"].modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.2
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    empty_scene.collection.objects.link(lamp)
    lamp.location = (0, 0, 1.5)
    empty_scene.obscurance.quantity = quantity
    empty_scene.obscurance.live_preview = True
    for frame in (1, 2):
        at(frame)
    if quantity == "DIRECT":
        with monkeypatch.context() as patch:
            patch.setattr("obscurance_addon.blender.animation.full_update.BakeJob", None)
            at(3)
        assert PREVIEW.status == "Up to date"
        return
    assert idle(monkeypatch) == [0, 0, 0]
    room["Mover"].location.x += 0.3
    at(30)
    assert_as_baked_anew(room.values())


def test_a_vertex_without_a_place_does_not_bake_for_ever(room, empty_scene, monkeypatch):
    broken = new_object("Broken", [(0, 0, 1), (1, 0, 1), (np.nan, 1, 1), (0, 1, 1)], [(0, 1, 2), (0, 1, 3)])
    empty_scene.obscurance.live_preview = True
    at(1)
    for frame in (2, 3):
        broken.data.update()
        at(frame)
    assert idle(monkeypatch) == [0, 0, 0]
    assert_as_baked_anew([*room.values(), broken])


def test_what_depends_on_a_baked_mesh_does_not_bake_light_for_ever(room, empty_scene, monkeypatch):
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    empty_scene.collection.objects.link(lamp)
    follower = new_object("Follower", [(0, 0, 1)], [])
    follower.modifiers.new("Shrinkwrap", "SHRINKWRAP").target = room["Floor"]
    lamp.location = (0, 0, 1.5)
    empty_scene.obscurance.quantity = "DIRECT"
    empty_scene.obscurance.live_preview = True
    at(1)
    with monkeypatch.context() as patch:
        patch.setattr("obscurance_addon.blender.animation.full_update.BakeJob", None)
        at(2)
    assert PREVIEW.status == "Up to date"


def test_settings_of_a_layer_are_noted_anew(preview):
    """Another quantity of the same name must not be taken for what is there now."""
    preview["Floor"].data.obscurance_layers[FACE_LAYER].quantity = "INDIRECT"
    preview["Mover"].location.x += 0.1
    at(2)
    assert preview["Floor"].data.obscurance_layers[FACE_LAYER].quantity == "OBSCURANCE"


def test_an_object_that_is_baked_later_is_followed(room, empty_scene):
    bake(room["Floor"], **SETTINGS)
    empty_scene.obscurance.live_preview = True
    at(1)
    bake(room["Wall"], **SETTINGS)
    key(room["Mover"], 3, "location", (0.3, 1.2, 0.5))
    at(3)
    assert_as_baked_anew([room["Floor"], room["Wall"]])


def test_everything_hidden_and_back(preview):
    for ob in preview.values():
        ob.hide_render = True
    at(2)
    for ob in preview.values():
        ob.hide_render = False
    at(3)
    assert_as_baked_anew(preview.values())
    ground = floor("Late")
    bpy.data.objects.remove(ground)
    at(4)
    assert np.isfinite(colors(preview["Floor"])).all()


@pytest.mark.parametrize("kind", ["SUBSURF", "SOLIDIFY", "TRIANGULATE"])
def test_modifiers_over_a_shape_that_changes(room, empty_scene, monkeypatch, kind):
    """Those that choose faces by where vertices are may choose others, though these hang together as before."""
    mover = room["Mover"]
    mover.location.z = 1.0
    mover.shape_key_add(name="Basis")
    bulge = mover.shape_key_add(name="Bulge")
    for i, point in enumerate(bulge.data):
        point.co = point.co * (1.0 + 0.2 * (i % 3))
    for frame, value in ((1, 0.0), (10, 1.0)):
        bulge.value = value
        bulge.keyframe_insert("value", frame=frame)
    mover.modifiers.new("Modifier", kind)
    empty_scene.obscurance.live_preview = True
    at(1)
    with counted(monkeypatch) as reports:
        for frame in (4, 8):
            at(frame)
            assert_as_baked_anew(room.values())
    assert not any(report.full for report in reports)


@pytest.mark.parametrize("flag", ["visible_shadow", "visible_diffuse"])
@pytest.mark.parametrize("name", ["Mover", "Wall"])
def test_ray_visibility_is_followed(preview, monkeypatch, name, flag):
    """Switched off and on again by the user, then by keys; nothing is baked while it stays."""
    before = colors(preview["Floor"]).copy()
    for frame, value in ((2, False), (3, True)):
        setattr(preview[name], flag, value)
        at(frame)
        assert_as_baked_anew(preview.values())
        assert np.array_equal(colors(preview["Floor"]), before) == value
    for frame, value in ((4, True), (5, False), (8, True)):
        key(preview[name], frame, flag, value)
    for frame in (5, 6, 8):
        at(frame)
        assert_as_baked_anew(preview.values())
    assert idle(monkeypatch) == [0, 0, 0]
