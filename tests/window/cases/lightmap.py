"""A lightmap baked by the button, seen in the 3D view and in the UV editor."""

from pathlib import Path

import bpy
import numpy as np

SAMPLE = "room_1423.blend"
LONG = 1 << 14  # rays from each texel: a bake that lasts until it is cancelled


def _meshes():
    return [ob for ob in bpy.context.scene.objects if ob.type == "MESH"]


def _lightmaps():
    return [image for image in bpy.data.images if "obscurance_lightmap" in image]


def _is_baked():
    return bool(_lightmaps()) and all("Obscurance" in ob.data.uv_layers for ob in _meshes())


def _pixels(image):
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(*image.size, 4)


def bake_lightmap_by_the_button(window):
    """Choose Lightmap, press Bake, see it on the room, undo, redo, see it in the UV editor, save, load."""
    yield from window.open(SAMPLE)
    yield from window.look_from_camera()
    yield from window.sidebar()
    yield from window.select_all()
    settings = bpy.context.scene.obscurance
    settings.target, settings.lightmap_size = "LIGHTMAP", 512
    yield 0.5
    yield from window.picture("lightmap_1_before")
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(_is_baked, "the lightmap")
    (image,) = _lightmaps()
    assert (image.name, *image.size, len(image.packed_files)) == ("Obscurance", 512, 512, 1)
    pixels = _pixels(image)
    shown = pixels[..., 3] > 0.0
    assert shown.mean() > 0.5
    assert pixels[shown][:, :3].std() > 0.05

    yield from window.key("Z", ctrl=True)
    yield from window.until(lambda: not any("Obscurance" in ob.data.uv_layers for ob in _meshes()), "undo")
    yield from window.key("Z", ctrl=True, shift=True)
    yield from window.until(_is_baked, "redo")

    yield from window.press("bpy.ops.obscurance.show_result")
    yield 3.0
    yield from window.picture("lightmap_2_result")
    shading = window.area().spaces.active.shading
    assert (shading.type, shading.light, shading.color_type) == ("SOLID", "FLAT", "TEXTURE")
    yield from window.press("bpy.ops.obscurance.show_result")
    yield 1.0
    assert (shading.type, shading.light, shading.color_type) == ("SOLID", "STUDIO", "MATERIAL")

    area = window.area()
    area.type = "IMAGE_EDITOR"
    area.ui_type = "UV"
    area.spaces.active.image = _lightmaps()[0]
    bpy.context.view_layer.objects.active = _meshes()[0]
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area, region=region):
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.image.view_all(fit_view=True)
    yield 2.0
    yield from window.picture("lightmap_3_uv_editor")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area, region=region):
        bpy.ops.object.mode_set(mode="OBJECT")
    area.type = "VIEW_3D"
    yield 1.0

    path, before = str(Path(bpy.data.filepath)), _pixels(_lightmaps()[0])
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile()
    yield 1.0
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    assert _is_baked()
    assert np.array_equal(_pixels(_lightmaps()[0]), before)


def cancel_lightmap_by_escape(window):
    """Esc while texels are traced leaves no image and no UV map behind; the next bake works."""
    yield from window.open(SAMPLE)
    yield from window.sidebar()
    yield from window.select_all()
    settings = bpy.context.scene.obscurance
    settings.target, settings.lightmap_size, settings.rays = "LIGHTMAP", 512, LONG
    yield 0.5
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(lambda: not bpy.ops.obscurance.bake.poll(), "the bake to run")
    yield 6.0
    yield from window.picture("lightmap_4_progress")
    yield from window.key("ESC")
    yield from window.until(bpy.ops.obscurance.bake.poll, "the bake to end")
    assert not _lightmaps()
    assert not any("Obscurance" in ob.data.uv_layers for ob in _meshes())
    settings.rays = 4
    yield 0.5
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(_is_baked, "the lightmap")
