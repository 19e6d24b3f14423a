"""Bakes 300 objects of mixed sizes into one lightmap by one command, and renders what came of it.

    python benchmarks/lightmap_pictures.py [--output-dir DIR] [--blend FILE]

writes docs/images/lightmap_300.jpg, the scene shown by its lightmap alone, and docs/images/lightmap_300_atlas.jpg, the
lightmap. With --blend the baked scene is kept as well.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parent.parent

OBJECTS = 299  # and a floor
SIZE, RAYS = 2048, 256
SPACING = 1.3  # metres between the places of objects
COLOURS = ((0.8, 0.8, 0.78), (0.75, 0.08, 0.06), (0.08, 0.35, 0.75), (0.8, 0.6, 0.08), (0.12, 0.55, 0.15))
KINDS = ("cube", "uv_sphere", "ico_sphere", "cylinder", "cone", "torus", "monkey")
PICTURE = (1280, 800)
EXPOSURE = -0.4  # stops, so that open ground is not as bright as paper


def main(output_dir: Path, blend: Path | None) -> None:
    """Make, bake, render."""
    with tempfile.TemporaryDirectory() as folder:
        scene, baked = Path(folder) / "scene.blend", (blend or Path(folder) / "baked.blend").resolve()
        image = Path(folder) / "lightmap.png"
        make_scene(random.Random(7))
        bpy.ops.wm.save_as_mainfile(filepath=str(scene))
        command = [sys.executable, "-m", "obscurance_addon", "bake", scene, "--output", baked, "--target", "LIGHTMAP"]
        command += ["--size", SIZE, "--rays", RAYS, "--distance", 1.0, "--image", image, "--image-format", "PNG_8"]
        subprocess.run(list(map(str, command)), check=True, cwd=ROOT)
        bpy.ops.wm.open_mainfile(filepath=str(baked))
        output_dir.mkdir(parents=True, exist_ok=True)
        _save_atlas(image, output_dir / "lightmap_300_atlas.jpg")
        _render(output_dir / "lightmap_300.jpg")


def make_scene(dice: random.Random) -> None:
    """A floor with solids of all sizes on it, some of them shaded smooth, some upside down or on their side."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    materials = [_material(f"Colour {i}", colour) for i, colour in enumerate(COLOURS)]
    columns = math.ceil(math.sqrt(OBJECTS))
    bpy.ops.mesh.primitive_plane_add(size=SPACING * (columns + 1))
    bpy.context.object.data.materials.append(materials[0])
    for number in range(OBJECTS):
        x, y = ((k + 0.5 - columns / 2) * SPACING for k in divmod(number, columns))
        radius = 0.5 * SPACING * dice.uniform(0.12, 1.0) ** 1.2
        kind = dice.choice(KINDS)
        getattr(bpy.ops.mesh, f"primitive_{kind}_add")(
            location=(x + dice.uniform(-0.2, 0.2), y + dice.uniform(-0.2, 0.2), 0.0)
        )
        ob = bpy.context.object
        ob.rotation_euler = (dice.choice((0.0, 0.5 * math.pi, math.pi)), 0.0, dice.uniform(0.0, math.pi))
        ob.scale = [radius * dice.uniform(0.6, 1.0) for _ in range(3)]
        ob.data.materials.append(dice.choice(materials))
        bpy.context.view_layer.update()
        ob.location.z -= min((ob.matrix_world @ vertex.co).z for vertex in ob.data.vertices)


def _material(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        made.use_nodes = True
    node = next(node for node in made.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    node.inputs["Base Color"].default_value = (*colour, 1.0)
    return made


def _save_atlas(image: Path, path: Path) -> None:
    atlas = bpy.data.images.load(str(image))
    atlas.scale(SIZE // 2, SIZE // 2)
    atlas.file_format = "JPEG"
    atlas.save(filepath=str(path), quality=85)


def _render(path: Path) -> None:
    """The scene with nothing but its lightmap on it."""
    scene = bpy.context.scene
    image = next(image for image in bpy.data.images if "obscurance_lightmap" in image)
    shown = bpy.data.materials.new("Lightmap")
    if bpy.app.version < (5, 0, 0):
        shown.use_nodes = True
    tree = shown.node_tree
    tree.nodes.clear()
    kinds = ("UVMap", "TexImage", "Emission", "OutputMaterial")
    uv, texture, emission, end = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    uv.uv_map, texture.image = "Obscurance", image
    for source, target in ((uv, texture), (texture, emission), (emission, end)):
        tree.links.new(source.outputs[0], target.inputs[0])
    for ob in scene.objects:
        ob.data.materials.clear()
        ob.data.materials.append(shown)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (0.0, -17.0, 12.0), (math.radians(56.0), 0.0, 0.0)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_denoising = 16, 0, False
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", EXPOSURE
    scene.render.resolution_x, scene.render.resolution_y = PICTURE
    scene.render.image_settings.file_format = "JPEG"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output-dir", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("--blend", type=Path, help="keep the baked scene")
    options = parser.parse_args()
    main(options.output_dir, options.blend)
    sys.stdout.flush()
    os._exit(0)  # see obscurance_addon/__main__.py
