"""The Bake button, from a fresh installation to the saved file."""

from pathlib import Path

import bpy

CORNER_LAYER = "Obscurance Color"
LONG = 1 << 16  # rays per face: a bake that lasts until it is cancelled


def _is_baked():
    return all(CORNER_LAYER in ob.data.attributes for ob in bpy.data.objects if ob.type == "MESH")


def _is_running():
    return not bpy.ops.obscurance.bake.poll()


def bake_by_the_button(window):
    """Select all, press Bake, see the colours, undo, redo, save, load."""
    yield from window.open("cornell_box.blend")
    yield from window.look_from_camera()
    yield from window.sidebar()
    yield from window.select_all()
    yield from window.picture("bake_1_before")
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(_is_baked, "the result")
    yield from window.press("bpy.ops.obscurance.show_result")
    yield from window.picture("bake_2_result")
    shading = window.area().spaces.active.shading
    assert (shading.type, shading.light, shading.color_type) == ("SOLID", "FLAT", "VERTEX")

    yield from window.key("Z", ctrl=True)
    yield from window.until(lambda: not _is_baked(), "undo")
    yield from window.key("Z", ctrl=True, shift=True)
    yield from window.until(_is_baked, "redo")

    yield from window.press("bpy.ops.obscurance.show_result")
    yield from window.picture("bake_3_former_shading")
    assert (shading.type, shading.light, shading.color_type) == ("SOLID", "STUDIO", "MATERIAL")

    path = str(Path(bpy.data.filepath))
    values = _values()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile()
    yield 1.0
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    assert _values() == values


def _values():
    return {
        ob.name: [c for corner in ob.data.attributes[CORNER_LAYER].data for c in corner.color]
        for ob in bpy.data.objects
        if ob.type == "MESH"
    }


def cancel_by_escape(window):
    """Progress is shown; Esc stops it and leaves the file as it was; then a bake goes through."""
    yield from window.open("cornell_box.blend")
    yield from window.look_from_camera()
    yield from window.sidebar()
    yield from window.select_all()
    bpy.context.scene.obscurance.rays = LONG
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(_is_running, "the bake to begin")
    yield 2.0
    yield from window.picture("cancel_1_progress")
    yield from window.key("ESC")
    yield from window.until(lambda: not _is_running(), "the bake to end")
    yield from window.picture("cancel_2_cancelled")
    assert not any(CORNER_LAYER in ob.data.attributes for ob in bpy.data.objects if ob.type == "MESH")
    bpy.context.scene.obscurance.rays = 16
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(_is_baked, "the second bake")
