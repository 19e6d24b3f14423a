"""Live Preview in renders: every frame of an animation carries its own values, told by its pixels."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.live_preview import PREVIEW
from tests.blender.helpers import colors, cube, floor

FRAMES = (1, 2, 3)
SIZE = 8


@pytest.fixture
def stage(empty_scene):
    """A floor of one face that shows its value, a block that comes down towards it, and a camera above."""
    ground = floor(size=2.0)
    block = cube("Block", 0.5)
    for frame, height in ((1, 3.0), (3, 0.7)):
        block.location = (0, 0, height)
        block.keyframe_insert("location", frame=frame)
    block.visible_camera = False
    shown = bpy.data.materials.new("Shown")
    if bpy.app.version < (5, 0, 0):
        shown.use_nodes = True
    nodes, links = shown.node_tree.nodes, shown.node_tree.links
    nodes.clear()
    value, light, end = (nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "Emission", "OutputMaterial"))
    value.attribute_name = "Obscurance"
    links.new(value.outputs["Color"], light.inputs["Color"])
    links.new(light.outputs["Emission"], end.inputs["Surface"])
    ground.data.materials.append(shown)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location = (0, 0, 5)
    empty_scene.collection.objects.link(camera)
    scene = empty_scene
    scene.camera = camera
    scene.frame_start, scene.frame_end = FRAMES[0], FRAMES[-1]
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.device = 1, False, "CPU"
    render.resolution_x = render.resolution_y = SIZE
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.obscurance.rays, scene.obscurance.use_bleeding = 64, False
    scene.obscurance.distance_mode, scene.obscurance.distance = "METRES", 4.0
    yield ground
    PREVIEW.stop()


def rendered(folder):
    """The mean colour of every frame of an animation."""
    bpy.context.scene.render.filepath = str(folder / "frame_")
    bpy.ops.render.render(animation=True)
    found = []
    for frame in FRAMES:
        image = bpy.data.images.load(str(folder / f"frame_{frame:04d}.exr"))
        pixels = np.empty(SIZE * SIZE * 4, np.float32)
        image.pixels.foreach_get(pixels)
        found.append(pixels.reshape(-1, 4)[:, 0])
        bpy.data.images.remove(image)
    return found


def previewed(ground):
    """The value of the floor at every frame, by setting frames."""
    values = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        values.append(float(colors(ground)[0, 0]))
    return values


@pytest.mark.parametrize("options", [{}, {"use_persistent_data": True}, {"use_motion_blur": True}])
def test_every_rendered_frame_has_its_own_values(stage, tmp_path, options):
    scene = bpy.context.scene
    scene.obscurance.live_preview = True
    expected = previewed(stage)
    assert max(expected) - min(expected) > 0.1
    for name, value in options.items():
        setattr(scene.render, name, value)
    for pixels, value in zip(rendered(tmp_path), expected, strict=True):
        np.testing.assert_allclose(pixels, value, rtol=1e-6)


def test_light_that_is_animated_has_its_values_when_a_frame_renders(stage, tmp_path):
    scene = bpy.context.scene
    bpy.data.objects["Block"].animation_data_clear()  # nothing changes but the lamp
    lit = floor("Lit", size=1.0)
    lit.location = (0, 0, 1.5)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    scene.collection.objects.link(lamp)
    lamp.location = (0.5, 0, 3.5)
    for frame, energy in ((FRAMES[0], 10.0), (FRAMES[-1], 100.0)):
        lamp.data.energy = energy
        lamp.data.keyframe_insert("energy", frame=frame)
    scene.obscurance.quantity = "DIRECT"
    scene.obscurance.live_preview = True
    expected = previewed(lit)
    assert max(expected) > 2.0 * min(expected)
    found = []
    handlers = bpy.app.handlers.render_post
    handlers.append(lambda *_: found.append(float(colors(lit)[0, 0])))
    try:
        rendered(tmp_path)
    finally:
        handlers.pop()
    assert found == expected


def test_a_render_starts_the_preview_by_itself(stage, tmp_path):
    """A file that was saved with Live Preview on, rendered in the background."""
    scene = bpy.context.scene
    scene.obscurance.live_preview = True
    expected = previewed(stage)
    path = str(tmp_path / "stage.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    for pixels, value in zip(rendered(tmp_path), expected, strict=True):
        np.testing.assert_allclose(pixels, value, rtol=1e-6)
