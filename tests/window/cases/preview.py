"""Live Preview in a window: the sample room plays, edits are followed, and frames render with their own values."""

import importlib
import sys
from pathlib import Path

import bpy
import numpy as np

LAYER, CORNER_LAYER = "Obscurance", "Obscurance Color"
SHOWN = (20, 45, 150)  # between the red and the yellow cube, beside the red one, above the table
ROOM = "room_4016.blend"


def _preview():
    name = next(name for name in sys.modules if name.endswith("obscurance_addon.blender.animation.live_preview"))
    return importlib.import_module(name).PREVIEW


def _colors(name):
    data = bpy.data.objects[name].data.attributes[LAYER].data
    values = np.empty(len(data) * 4, np.float32)
    data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3]


def _is_following():
    return _preview().status.startswith(("Following", "Up to date")) or " patches in " in _preview().status


def _start(window):
    yield from window.sidebar()
    yield from window.press(f'bpy.data.scenes["{bpy.context.scene.name}"].obscurance.live_preview')
    yield from window.until(lambda: LAYER in bpy.data.objects["Room"].data.attributes, "the first bake")
    yield from window.until(_is_following, "the preview")
    assert bpy.context.scene.render.use_lock_interface


def play_the_room(window):
    """Tick Live Preview, show the result, play, and look at three frames."""
    yield from window.open(ROOM)
    yield from window.look_from_camera()
    yield from _start(window)
    yield from window.press("bpy.ops.obscurance.show_result")
    seen = []
    bpy.app.handlers.frame_change_post.append(lambda scene, _: seen.append((scene.frame_current, _preview().status)))
    bpy.ops.screen.animation_play()
    yield from window.until(lambda: len(seen) > 30, "30 frames")
    bpy.ops.screen.animation_cancel(restore_frame=False)
    bpy.app.handlers.frame_change_post.pop()
    assert sum(" patches in " in status for _, status in seen) > 20
    values = []
    for frame in SHOWN:
        bpy.context.scene.frame_set(frame)
        yield from window.picture(f"preview_frame_{frame}")
        values.append(_colors("Room").copy())
    assert not np.array_equal(values[0], values[1])
    bpy.context.scene.frame_set(SHOWN[0])
    assert np.array_equal(values[0], _colors("Room"))


def follow_edits(window):
    """Move an object by hand, undo, redo, delete it, undo, and open the file again."""
    yield from window.open(ROOM)
    yield from _start(window)
    settled = _colors("Room").copy()
    cube = bpy.data.objects["Red Cube"]
    for ob in bpy.context.view_layer.objects:
        ob.select_set(ob == cube)
    bpy.context.view_layer.objects.active = cube
    view = window.region("WINDOW")
    with bpy.context.temp_override(window=window._window, area=window.area(), region=view):
        bpy.ops.ed.undo_push(message="before")
        bpy.ops.transform.translate(value=(0.3, -0.4, 0.0))
        bpy.ops.ed.undo_push(message="moved")
    yield from window.until(lambda: not np.array_equal(_colors("Room"), settled), "the move to be followed")
    yield 1.0
    moved = _colors("Room").copy()
    window.point(view.x + view.width // 3, view.y + view.height // 2)
    yield from window.key("Z", ctrl=True)
    yield from window.until(lambda: np.array_equal(_colors("Room"), settled), "undo to be followed")
    yield 1.0
    yield from window.key("Z", ctrl=True, shift=True)
    yield from window.until(lambda: np.array_equal(_colors("Room"), moved), "redo to be followed")
    bpy.data.objects.remove(bpy.data.objects["Red Cube"])
    yield from window.until(lambda: not np.array_equal(_colors("Room"), moved), "the deletion to be followed")
    path = bpy.data.filepath
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    yield from window.until(_is_following, "the preview of the opened file")
    before = _colors("Room").copy()
    bpy.data.objects["Moving Cube"].location.x += 0.0
    bpy.context.scene.frame_set(45)
    assert not np.array_equal(_colors("Room"), before)


def light_is_followed_without_end(window):
    """Light is baked anew after an edit, and not again because of what that wrote."""
    yield from window.open("room_1423.blend")
    bpy.context.scene.obscurance.quantity = "DIRECT"
    yield from _start(window)
    before = _colors("Room").copy()
    bpy.data.objects["Lamp"].data.energy *= 2.0
    yield from window.until(lambda: not np.array_equal(_colors("Room"), before), "the lamp to be followed")
    jobs = next(m for name, m in sys.modules.items() if name.endswith("obscurance_addon.blender.jobs.job"))
    yield 2.0
    count = jobs.commit_count()
    yield 3.0
    assert jobs.commit_count() == count
    assert _is_following()


def render_frames(window):
    """EEVEE renders three frames by F12's operator; each shows what Live Preview shows at that frame."""
    yield from window.open(ROOM)
    scene, folder = bpy.context.scene, Path(bpy.data.filepath).parent
    scene.obscurance.use_bleeding = False
    shown = _material_that_shows(CORNER_LAYER)
    for ob in scene.objects:
        if ob.type == "MESH":
            ob.data.materials.clear()
            ob.data.materials.append(shown)
    yield from _start(window)
    scene.render.engine, scene.eevee.taa_render_samples = "BLENDER_EEVEE_NEXT", 1
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 48, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / "eevee_")
    frames = range(SHOWN[0], SHOWN[0] + 3)
    scene.frame_start, scene.frame_end = frames[0], frames[-1]
    bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    last = folder / f"eevee_{frames[-1]:04d}.exr"
    yield from window.until(lambda: last.exists() and not bpy.app.is_job_running("RENDER"), "the render", 200)
    animated = [_pixels(folder / f"eevee_{frame:04d}.exr") for frame in frames]
    stills = []
    for frame in frames:
        scene.obscurance.live_preview = True
        scene.frame_set(frame)
        yield from window.until(_is_following, "the preview")
        yield 1.0
        scene.obscurance.live_preview = False  # what was shown at this frame stays on the meshes
        scene.render.filepath = str(folder / f"still_{frame}")
        bpy.ops.render.render(write_still=True)
        stills.append(_pixels(folder / f"still_{frame}.exr"))
    for one, other in zip(animated, stills, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)  # half of what a half float tells
    # The view without what moves: what stands still looks different at every frame, too.
    assert (np.abs(stills[0] - stills[2])[_STILL] > 1e-4).any()


_STILL = np.s_[: 64 * 12 * 4]  # the lowest rows of the picture: floor


def _material_that_shows(layer):
    shown = bpy.data.materials.new("Shown")
    if bpy.app.version < (5, 0, 0):
        shown.use_nodes = True
    nodes, links = shown.node_tree.nodes, shown.node_tree.links
    nodes.clear()
    value, light, end = (nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "Emission", "OutputMaterial"))
    value.attribute_name = layer
    links.new(value.outputs["Color"], light.inputs["Color"])
    links.new(light.outputs["Emission"], end.inputs["Surface"])
    return shown


def _pixels(path):
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels
