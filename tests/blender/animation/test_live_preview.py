"""Live Preview in the background: after every change the values are those of a full bake, bit for bit."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation import frame_update, full_update, handlers
from obscurance_addon.blender.animation.followed_objects import preview_objects
from obscurance_addon.blender.animation.live_preview import PREVIEW
from obscurance_addon.core.errors import ObscuranceError
from tests.blender.animation.preview_helpers import SETTINGS, assert_as_baked_anew, at, baked_anew, counted, key
from tests.blender.helpers import FACE_LAYER, bake, colors, cube, floor, job, material, new_object, select


def test_the_first_frame_is_a_full_bake(preview):
    assert_as_baked_anew(preview.values())


def test_a_moving_and_turning_object_is_followed_exactly(room, empty_scene):
    """Over 40 frames, back and forth, and home again."""
    mover = room["Mover"]
    for frame, place, turn in ((1, (0, 0, 0.6), 0.0), (20, (1.1, -1.0, 0.55), 2.0), (40, (-1.2, 1.4, 0.7), 5.0)):
        key(mover, frame, "location", place)
        key(mover, frame, "rotation_euler", (0.3 * turn, 0.0, turn))
    empty_scene.obscurance.live_preview = True
    at(1)
    first = {name: colors(ob).copy() for name, ob in room.items()}
    for frame in (*range(2, 41, 3), 7, 33, 2):
        at(frame)
        assert_as_baked_anew(room.values())
    at(1)
    assert all(np.array_equal(colors(ob), first[name]) for name, ob in room.items())


def test_only_what_is_near_is_baked_again(room, empty_scene, monkeypatch):
    far = floor("Far", 1.0, 4)
    far.location = (40.0, 0.0, 0.0)
    key(room["Mover"], 1, "location", (0, 0, 0.4))
    key(room["Mover"], 10, "location", (0.5, 0, 0.4))
    empty_scene.obscurance.live_preview = True
    at(1)
    with counted(monkeypatch) as reports:
        at(5)
    (report,) = reports
    assert 6 <= report.patches < report.all_patches - 16
    assert set(report.objects) <= {"Floor", "Wall", "Mover", "Block"}
    assert not report.full


def test_a_frame_without_change_costs_no_ray(preview, monkeypatch):
    with counted(monkeypatch) as reports:
        at(2)
    assert [(r.patches, r.rays, r.objects) for r in reports] == [(0, 0, [])]


def test_a_deforming_mesh_is_followed(room, empty_scene):
    mover = room["Mover"]
    mover.location.z = 1.0
    mover.shape_key_add(name="Basis")
    bulge = mover.shape_key_add(name="Bulge")
    for i, point in enumerate(bulge.data):
        point.co = point.co * (1.0 + 0.3 * (i % 3))
    for frame, value in ((1, 0.0), (10, 1.0)):
        bulge.value = value
        bulge.keyframe_insert("value", frame=frame)
    empty_scene.obscurance.live_preview = True
    for frame in (1, 4, 10, 2):
        at(frame)
        assert_as_baked_anew(room.values())


def test_an_armature_is_followed(room, empty_scene):
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    empty_scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    mover = room["Mover"]
    mover.vertex_groups.new(name="Bone").add([0, 2, 4], 1.0, "REPLACE")
    mover.modifiers.new("Rig", "ARMATURE").object = rig
    pose = rig.pose.bones["Bone"]
    for frame, x in ((1, 0.0), (10, 0.4)):
        pose.location = (x, 0.1, 0.0)
        pose.keyframe_insert("location", frame=frame)
    empty_scene.obscurance.live_preview = True
    for frame in (1, 5, 10):
        at(frame)
        assert_as_baked_anew(room.values())


def test_objects_that_come_and_go_are_followed(room, empty_scene):
    """Render visibility keyed, also of an object that is hidden at first."""
    mover, block = room["Mover"], room["Block"]
    for frame, hidden in ((1, False), (3, True), (5, False)):
        key(mover, frame, "hide_render", hidden)
        key(block, frame, "hide_render", not hidden)
    empty_scene.obscurance.live_preview = True
    for frame in (1, 3, 5, 3, 1):
        at(frame)
        assert_as_baked_anew(room.values())


def test_a_colour_that_is_animated_is_followed_without_rays_of_others(room, empty_scene):
    color = room["Mover"].data.materials[0].node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    for frame, value in ((1, (0.2, 0.7, 0.2, 1.0)), (10, (0.9, 0.1, 0.6, 1.0))):
        color.default_value = value
        color.keyframe_insert("default_value", frame=frame)
    empty_scene.obscurance.live_preview = True
    for frame in (1, 5, 10, 3):
        at(frame)
        assert_as_baked_anew(room.values())


def test_an_object_that_first_moves_later_needs_no_full_bake(preview, monkeypatch):
    """By a script, without any animation."""
    with counted(monkeypatch) as reports:
        preview["Block"].location.x -= 0.4
        at(2)
    assert not reports[-1].full
    assert reports[-1].patches < reports[-1].all_patches
    assert_as_baked_anew(preview.values())


def test_other_faces_are_followed_without_a_full_bake(preview, monkeypatch):
    """A modifier that makes some, a move, and the modifier applied."""
    block = preview["Block"]
    with counted(monkeypatch) as reports:
        block.modifiers.new("Cut", "SUBSURF").levels = 1
        at(2)
        assert_as_baked_anew(preview.values())
        block.location.x -= 0.2
        at(3)
        assert_as_baked_anew(preview.values())
        select(block)
        bpy.ops.object.modifier_apply(modifier="Cut")
        at(4)
        assert len(block.data.polygons) == 24
        assert_as_baked_anew(preview.values())
    assert not any(report.full for report in reports)


@pytest.mark.parametrize("target", ["CORNER", "POINT"])
def test_other_targets_are_followed(room, empty_scene, target):
    empty_scene.obscurance.target = target
    key(room["Mover"], 1, "location", (0, 0, 0.4))
    key(room["Mover"], 10, "location", (0.9, 0.2, 0.4))
    empty_scene.obscurance.live_preview = True
    for frame in (1, 6):
        at(frame)
        assert_as_baked_anew(room.values(), target=target)


def test_a_shared_mesh_has_the_mean_of_its_users(room, empty_scene):
    twin = bpy.data.objects.new("Twin", room["Block"].data)
    empty_scene.collection.objects.link(twin)
    twin.location = (-1.2, -1.2, 0.3)
    empty_scene.obscurance.shared_meshes = "AVERAGE"
    key(room["Mover"], 1, "location", (0, 0, 0.4))
    key(room["Mover"], 10, "location", (-0.8, -0.9, 0.4))
    empty_scene.obscurance.live_preview = True
    for frame in (1, 6, 10):
        at(frame)
        assert_as_baked_anew([*room.values(), twin], shared_meshes="AVERAGE")


def test_light_is_baked_in_full(room, empty_scene, caplog):
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    empty_scene.collection.objects.link(lamp)
    lamp.location = (0, 0, 1.5)
    empty_scene.obscurance.quantity = "DIRECT"
    for frame, energy in ((1, 10.0), (10, 50.0)):
        lamp.data.energy = energy
        lamp.data.keyframe_insert("energy", frame=frame)
    empty_scene.obscurance.live_preview = True
    with caplog.at_level("INFO"):
        for frame in (1, 6):
            at(frame)
            assert_as_baked_anew(room.values(), quantity="DIRECT")
    assert len([r for r in caplog.records if "direct light" in r.message]) == 1


def test_the_published_list_bakes_less_and_what_it_bakes_is_right(room, empty_scene, monkeypatch):
    """Values are those of some full bake: of this frame, or for patches that the list misses of an earlier one."""
    key(room["Mover"], 1, "location", (0, 0, 0.6))
    key(room["Mover"], 10, "location", (0.9, 0.2, 0.6))
    full = []
    for frame in (1, 4, 7, 10):
        at(frame)
        full.append(baked_anew(room.values()))
    empty_scene.obscurance.preview_mode = "LIST"
    empty_scene.obscurance.live_preview = True
    at(1)
    with counted(monkeypatch) as reports:
        for i, frame in enumerate((4, 7, 10), 1):
            at(frame)
            ours = colors(room["Floor"])
            assert all(any(np.array_equal(v, past["Floor"][j]) for past in full[: i + 1]) for j, v in enumerate(ours))
            assert np.array_equal(colors(room["Mover"]), full[i]["Mover"])
    assert all(6 < report.patches < 64 for report in reports)


def test_light_is_not_baked_again_while_nothing_changes(room, empty_scene, monkeypatch):
    empty_scene.obscurance.quantity = "DIRECT"
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    empty_scene.collection.objects.link(lamp)
    lamp.location = (0, 0, 1.5)
    empty_scene.obscurance.live_preview = True
    at(1)
    with monkeypatch.context() as patch:
        patch.setattr(full_update, "BakeJob", None)
        at(2)
        at(3)
    room["Floor"].data.vertices[0].co.z = 0.2
    room["Floor"].data.update()
    at(4)
    assert_as_baked_anew(room.values(), quantity="DIRECT")


def test_a_bake_by_the_button_with_other_settings_does_not_stay(preview):
    """Half of one and half of the other would be neither."""
    before = {name: colors(ob).copy() for name, ob in preview.items()}
    bake(*preview.values(), **SETTINGS | {"distance": 0.5})
    assert not np.array_equal(colors(preview["Floor"]), before["Floor"])
    at(2)
    assert all(np.array_equal(colors(ob), before[name]) for name, ob in preview.items())


def test_handlers_come_once_and_go():
    lists = [getattr(bpy.app.handlers, name) for name, _handler in handlers._LISTS]
    counts = [len(found) for found in lists]
    handlers.register()
    assert [len(found) for found in lists] == counts
    handlers.unregister()
    assert [len(found) for found in lists] == [count - 1 for count in counts]
    handlers.register()
    assert [len(found) for found in lists] == counts


def test_settings_that_change_are_followed(preview, empty_scene):
    empty_scene.obscurance.use_bleeding = False
    at(2)
    assert_as_baked_anew(preview.values(), use_bleeding=False)


def test_it_is_off_while_a_bake_runs(preview):
    """What a bake has read must not be changed below it, nor be written twice."""
    running = job(*preview.values(), **SETTINGS)
    before = {name: colors(ob).copy() for name, ob in preview.items()}
    preview["Mover"].location.x += 0.5
    at(2)
    assert all(np.array_equal(colors(ob), before[name]) for name, ob in preview.items())
    running.run()
    at(3)
    assert_as_baked_anew(preview.values())


def test_an_object_may_be_deleted(preview):
    block = preview.pop("Block")
    bpy.data.objects.remove(block)
    at(2)
    assert_as_baked_anew(preview.values())


def test_everything_may_be_deleted(preview):
    for ob in preview.values():
        bpy.data.objects.remove(ob)
    at(2)
    assert PREVIEW.status


def test_a_new_object_occludes_at_once(preview):
    made = cube("New", 0.2, color=(0.9, 0.9, 0.1))
    made.location = (-1.0, 0.0, 0.3)
    at(2)
    assert_as_baked_anew(preview.values())


def test_instances_that_move_are_followed(room, empty_scene):
    group = bpy.data.collections.new("Group")
    cube("Part", 0.2, color=(0.9, 0.2, 0.2), collection=group)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty_scene.collection.objects.link(empty)
    key(empty, 1, "location", (-1, 0, 0.3))
    key(empty, 10, "location", (0.8, 0.8, 0.3))
    empty_scene.obscurance.live_preview = True
    for frame in (1, 5, 10):
        at(frame)
        assert_as_baked_anew(room.values())


def test_a_lightmap_is_refused(room, empty_scene):
    empty_scene.obscurance.target = "LIGHTMAP"
    empty_scene.obscurance.live_preview = True
    at(2)
    assert "lightmap cannot follow" in PREVIEW.status
    assert FACE_LAYER not in room["Floor"].data.attributes


def test_loading_another_file_forgets_everything(preview):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert PREVIEW._updater is None
    at(2)
    assert PREVIEW.status == ""


def test_it_goes_on_after_saving_and_loading(preview, tmp_path):
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    objects = [bpy.data.objects[name] for name in ("Floor", "Wall", "Mover", "Block")]
    objects[2].location.x += 0.5
    at(2)
    assert_as_baked_anew(objects)


def test_memory_that_is_used_up_is_said_and_exact(room, empty_scene, caplog):
    empty_scene.obscurance.preview_memory = 0
    key(room["Mover"], 1, "location", (0, 0, 0.4))
    key(room["Mover"], 10, "location", (0.9, 0.2, 0.4))
    empty_scene.obscurance.live_preview = True
    with caplog.at_level("INFO"):
        for frame in (1, 4, 8):
            at(frame)
            assert_as_baked_anew(room.values())
    assert any("memory" in r.message for r in caplog.records)


def test_an_error_leaves_no_half_known_scene(preview, monkeypatch):
    """The next frame starts from a full bake."""

    def fail(*_args, **_kw):
        raise ZeroDivisionError

    with monkeypatch.context() as patch:
        patch.setattr(frame_update, "refresh_values", fail)
        preview["Mover"].location.x += 0.5
        at(2)  # Blender prints what a handler raises
    assert PREVIEW._updater is None
    at(3)
    assert_as_baked_anew(preview.values())


def test_it_waits_for_edit_mode_to_end(preview):
    before = colors(preview["Floor"]).copy()
    bpy.context.view_layer.objects.active = preview["Block"]
    bpy.ops.object.mode_set(mode="EDIT")
    preview["Mover"].location.x += 0.5
    at(2)
    assert "Edit Mode" in PREVIEW.status
    assert np.array_equal(colors(preview["Floor"]), before)
    bpy.ops.object.mode_set(mode="OBJECT")
    at(3)
    assert_as_baked_anew(preview.values())


def test_what_was_baked_before_is_what_is_followed(room, empty_scene):
    """Objects without a result of this name only occlude."""
    bake(room["Floor"], **SETTINGS)
    empty_scene.obscurance.live_preview = True
    at(2)
    assert FACE_LAYER not in room["Wall"].data.attributes
    assert [ob.name for ob in preview_objects(bpy.context, FACE_LAYER)] == ["Floor"]


def test_an_animated_mesh_without_a_finite_place_is_survived(preview):
    broken = new_object("Broken", [(0, 0, 0), (1, 0, 0), (np.nan, 1, 0)], [(0, 1, 2)])
    at(2)
    assert_as_baked_anew(preview.values())
    bpy.data.objects.remove(broken)
    at(3)
    assert_as_baked_anew(preview.values())


def test_switching_off_leaves_the_values(preview, empty_scene):
    before = colors(preview["Floor"]).copy()
    empty_scene.obscurance.live_preview = False
    preview["Mover"].location.x += 0.5
    at(2)
    assert np.array_equal(colors(preview["Floor"]), before)


def test_a_material_that_is_replaced_is_seen(preview):
    preview["Wall"].data.materials[0] = material("Blue", (0.1, 0.1, 0.9))
    at(2)
    assert_as_baked_anew(preview.values())


def test_a_slot_that_takes_the_material_of_the_object_is_seen(preview):
    """While the object moves, too: then the depsgraph says the same of both."""
    slot = preview["Mover"].material_slots[0]
    slot.link = "OBJECT"
    slot.material = material("Blue", (0.1, 0.1, 0.9))
    at(2)
    slot.link = "DATA"
    preview["Mover"].location.x += 0.2
    at(3)
    assert_as_baked_anew(preview.values())
    slot.link = "OBJECT"
    at(4)
    assert_as_baked_anew(preview.values())


def test_frames_of_the_updater_name_their_errors(room):
    with pytest.raises(ObscuranceError, match="no mesh object with faces"):
        frame_update.FrameUpdater(
            bpy.context, [], bpy.context.scene.obscurance.to_settings(), bpy.context.scene.obscurance.to_output(), 0
        )
