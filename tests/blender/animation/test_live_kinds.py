"""Kinds of changes that Live Preview once missed, or at which Blender crashed."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.live_preview import PREVIEW
from tests.blender.animation.preview_helpers import SETTINGS, assert_as_baked_anew, at, key
from tests.blender.helpers import FACE_LAYER, bake, colors, material, select
from tests.blender.reading.test_modifiers import replace_by_a_block
from tests.blender.reading.test_strands import emitter, hair_curves, point_cloud


def come_and_go(ob):
    for frame, hidden in ((1, False), (4, True), (7, False)):
        key(ob, frame, "hide_render", hidden)


def textured(name, seed=1):
    """A material whose colour is that of an image, and the image."""
    image = bpy.data.images.new(name, 8, 8)
    image.pixels.foreach_set(np.random.default_rng(seed).random(256).astype(np.float32))
    made = material(name, (1.0, 1.0, 1.0))
    node = made.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    made.node_tree.links.new(node.outputs[0], made.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made, image


@pytest.mark.parametrize("listens", [False, True])
@pytest.mark.parametrize("quantity", ["OBSCURANCE", "COMBINED"])
def test_keyed_visibility_beside_modifiers_and_light(room, empty_scene, quantity, listens):
    """Blender 4.5 and later crash where a frame handler tags and then evaluates; other handlers may tag."""
    come_and_go(room["Mover"])
    room["Mover"].modifiers.new("Subdivision", "SUBSURF")
    key(room["Block"], 1, "location", (1.2, -1.2, 0.3))
    key(room["Block"], 10, "location", (0.9, 0.2, 0.5))
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.location, lamp.data.energy = (0, 0, 1.5), 50.0
    empty_scene.collection.objects.link(lamp)
    empty_scene.obscurance.quantity = quantity

    def edit(scene, _depsgraph):
        room["Floor"].data.vertices[0].co.z = 0.01 * (scene.frame_current % 3)
        room["Floor"].data.update()

    at(1)
    empty_scene.obscurance.live_preview = True
    handlers = bpy.app.handlers.frame_change_post
    if listens:
        handlers.insert(0, edit)
    try:
        for frame in (2, 3, 4, 6, 7, 8, 3, 1):
            at(frame)
            if frame % 3 == 0:
                assert_as_baked_anew(room.values(), quantity=quantity)
    finally:
        if listens:
            handlers.remove(edit)


def test_a_handler_of_no_module(preview):
    """As of functions that `exec` makes, and of methods of lists."""
    bpy.app.handlers.frame_change_post.append([].count)
    try:
        preview["Mover"].location.x += 0.2
        at(2)
    finally:
        bpy.app.handlers.frame_change_post.pop()
    assert_as_baked_anew(preview.values())


def test_undo_after_objects_came_to_share_a_mesh(preview):
    bpy.ops.ed.undo_push(message="start")
    preview["Mover"].location.x += 0.1
    at(5)
    bpy.ops.ed.undo_push(message="moved")
    preview["Block"].data = preview["Mover"].data
    select(preview["Mover"])
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")  # which pushes a step by itself
    at(6)
    bpy.ops.object.mode_set(mode="OBJECT")
    at(2)
    bpy.ops.ed.undo()
    at(3)
    assert_as_baked_anew([ob for ob in bpy.data.objects if ob.type == "MESH"], shared_meshes="AVERAGE")


def test_a_shape_that_repeats_below_a_subdivision_that_appears_later(room, empty_scene):
    mover = room["Mover"]
    mover.location.z = 0.8
    mover.modifiers.new("Subdivision", "SUBSURF").levels = 1
    mover.shape_key_add(name="Basis")
    bulge = mover.shape_key_add(name="Bulge")
    for point in bulge.data:
        point.co = point.co * 2.0
    for frame, value in ((3, 0.0), (4, 1.0), (5, 0.0), (6, 1.0)):
        bulge.value = value
        bulge.keyframe_insert("value", frame=frame)
    for frame, hidden in ((1, True), (3, False)):
        key(mover, frame, "hide_render", hidden)
    at(1)
    empty_scene.obscurance.live_preview = True
    for frame in (1, 3, 4, 5, 6):
        at(frame)
        assert_as_baked_anew(room.values())


@pytest.mark.parametrize("kind", [None, "SUBSURF", "ARMATURE"])
def test_a_new_uv_map_and_texture(preview, kind):
    mover = preview["Mover"]
    if kind:
        mover.modifiers.new("Modifier", kind)
    at(2)
    made, _image = textured("Texture")
    mover.data.uv_layers.new(name="UV")
    mover.data.materials[0] = made
    at(3)
    assert_as_baked_anew(preview.values())


@pytest.mark.parametrize("edit", ["set", "set and packed", "scaled"])
def test_pixels_of_which_blender_tells_nobody(preview, edit):
    made, image = textured("Texture")
    preview["Floor"].data.uv_layers.new(name="UV")
    preview["Floor"].data.materials[0] = made
    at(2)
    at(3)
    before = colors(preview["Wall"]).copy()
    if edit == "scaled":
        image.scale(2, 2)
    else:
        image.pixels.foreach_set(np.random.default_rng(2).random(256).astype(np.float32))
    if edit == "set and packed":
        image.pack()
    at(4)
    assert not np.array_equal(colors(preview["Wall"]), before)
    assert_as_baked_anew(preview.values())
    at(5)
    assert PREVIEW.status == "Up to date"


@pytest.mark.parametrize("rename", [False, True])
def test_results_that_are_gone_are_made_again(preview, rename):
    attributes = preview["Floor"].data.attributes
    if rename:
        attributes[FACE_LAYER].name = "Kept"
    else:
        attributes.remove(attributes[FACE_LAYER])
    at(2)
    assert_as_baked_anew(preview.values())
    assert ("Kept" in attributes) == rename


def test_a_render_shows_what_the_viewport_hides_at_its_frame(room, empty_scene, tmp_path):
    """As renders do, and bakes of that frame."""
    for frame, hidden in ((1, True), (2, False), (3, True)):
        key(room["Mover"], frame, "hide_viewport", hidden)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    render = empty_scene.render
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 4, 4
    empty_scene.cycles.samples, render.filepath = 1, str(tmp_path / "frame_")
    empty_scene.frame_start, empty_scene.frame_end = 1, 3
    at(1)
    empty_scene.obscurance.live_preview = True
    found = []
    bpy.app.handlers.render_post.append(lambda *_: found.append(colors(room["Floor"]).copy()))
    try:
        bpy.ops.render.render(animation=True)
    finally:
        bpy.app.handlers.render_post.pop()
    empty_scene.obscurance.live_preview = False
    for frame, values in zip((1, 2, 3), found, strict=True):
        at(frame)
        report = bake(*room.values(), **SETTINGS)
        assert not report.warnings
        assert np.array_equal(colors(room["Floor"]), values)
    assert np.array_equal(found[0], found[1])
    room["Mover"].hide_render = True
    bake(room["Floor"], **SETTINGS)
    assert not np.array_equal(colors(room["Floor"]), found[0])


def test_a_render_shows_values_of_what_it_renders(room, empty_scene, tmp_path):
    """The render levels of a subdivision, below which the floor is lighter."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    render = empty_scene.render
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 4, 4
    empty_scene.cycles.samples, render.filepath = 1, str(tmp_path / "frame_")
    empty_scene.frame_start = empty_scene.frame_end = 1
    levels = room["Mover"].modifiers.new("Subdivision", "SUBSURF")
    levels.levels, levels.render_levels = 0, 2
    empty_scene.obscurance.live_preview = True
    found = []
    bpy.app.handlers.render_post.append(lambda *_: found.append(colors(room["Floor"]).copy()))
    try:
        bpy.ops.render.render(animation=True)
    finally:
        bpy.app.handlers.render_post.pop()
    empty_scene.obscurance.live_preview = False
    bake(*room.values(), **SETTINGS)
    assert not np.array_equal(colors(room["Floor"]), found[0])
    levels.levels = 2
    bake(*room.values(), **SETTINGS)
    assert np.array_equal(colors(room["Floor"]), found[0])


def test_what_nodes_make_elsewhere_is_followed(preview):
    """A block that nodes make beside what is baked, where it goes with its object, grows, and goes away."""
    made = replace_by_a_block(preview["Mover"], (0.4, 0.4, 0.4), (0.9, 0.0, 0.2))
    edits = [
        lambda: None,
        lambda: setattr(preview["Mover"].location, "y", 0.5),
        lambda: setattr(made.inputs["Size"], "default_value", (0.9, 0.5, 0.3)),
        lambda: setattr(preview["Mover"], "visible_shadow", False),
        lambda: setattr(preview["Mover"], "visible_shadow", True),
        lambda: setattr(made.inputs["Size"], "default_value", (0.9, 0.5, 0.6)),
        lambda: preview["Mover"].modifiers.clear(),
    ]
    seen = []
    for frame, edit in enumerate(edits, 2):
        edit()
        at(frame)
        assert_as_baked_anew(preview.values())
        seen.append(colors(preview["Floor"]).tobytes())
    assert len(set(seen)) == len(edits) - 1  # without a shadow and with it again


@pytest.mark.parametrize("build", [emitter, hair_curves, point_cloud])
def test_hair_and_points_are_followed(preview, build):
    """They come, go with what carries them, and vanish."""
    hairy = build()
    edits = [
        lambda: None,
        lambda: setattr(hairy.location, "x", 1.5),
        lambda: setattr(hairy, "visible_shadow", False),
        lambda: setattr(hairy, "visible_shadow", True),
        lambda: setattr(hairy, "hide_render", True),
    ]
    seen = [colors(preview["Floor"]).tobytes()]
    for frame, edit in enumerate(edits, 2):
        edit()
        at(frame)
        assert_as_baked_anew(preview.values())
        seen.append(colors(preview["Floor"]).tobytes())
    assert len(set(seen)) == 4  # without, here, there, and not met, but still in R_ave
