"""Bakes the Cornell box without and with colour bleeding and renders both side by side.

    python tools/demo.py [--output-dir DIR]

writes cornell_box.blend (with bleeding) and cornell_box.png. The picture shows base colour x obscurance and nothing
else: no lamp is lit.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import obscurance_addon  # noqa: E402
from obscurance_addon.command_line import batch  # noqa: E402

SCENE = ROOT / "sample_blends" / "cornell_box.blend"
RAYS = 256
DISTANCE = "0.25"  # metres: just under half the box, so that the walls tint each other visibly
SIZE = 480
PIXEL_SAMPLES = 16  # smooths edges only: an emission shader has no noise


def main(output_dir: Path) -> None:
    """Bake, render and write the two files."""
    output_dir.mkdir(parents=True, exist_ok=True)
    obscurance_addon.register()
    with tempfile.TemporaryDirectory() as folder:
        grey = _baked(Path(folder) / "grey.blend", "--no-bleeding")
        coloured = _baked(output_dir / SCENE.name)
        pictures = [_render(baked, Path(folder) / f"{i}.png") for i, baked in enumerate((grey, coloured))]
    picture = output_dir / "cornell_box.png"
    _save_side_by_side(pictures, picture)
    print(f"wrote {output_dir / SCENE.name} and {picture}")


def _baked(output: Path, *options: str) -> Path:
    if (
        batch.main(["bake", str(SCENE), "--output", str(output), "--rays", str(RAYS), "--distance", DISTANCE, *options])
        != batch.DONE
    ):
        raise SystemExit(1)
    return output


def _render(blend: Path, png: Path) -> np.ndarray:
    """Render base colour x obscurance; returns encoded pixels (height, width, 4) float32."""
    bpy.ops.wm.open_mainfile(filepath=str(blend.resolve()), load_ui=False)
    for material in bpy.data.materials:
        _show_obscurance(material)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = PIXEL_SAMPLES
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.view_settings.exposure = 0.0
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(png)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(png))
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(SIZE, SIZE, 4)


def _show_obscurance(material: bpy.types.Material) -> None:
    """Replace a material by an emission of its base colour times the baked attribute."""
    tree = material.node_tree
    colours = [
        socket.default_value[:]
        for node in tree.nodes
        for socket in node.inputs
        if socket.identifier in {"Base Color", "Color"} and socket.type == "RGBA"
    ]
    tree.nodes.clear()
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "Obscurance"
    multiply = tree.nodes.new("ShaderNodeVectorMath")
    multiply.operation = "MULTIPLY"
    multiply.inputs[1].default_value = colours[0][:3] if colours else (0.8, 0.8, 0.8)
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(attribute.outputs["Color"], multiply.inputs[0])
    tree.links.new(multiply.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def _save_side_by_side(pictures: list[np.ndarray], path: Path) -> None:
    gap = np.ones((SIZE, SIZE // 40, 4), np.float32)
    joined = np.ascontiguousarray(np.concatenate([pictures[0], gap, pictures[1]], axis=1))
    image = bpy.data.images.new("side by side", joined.shape[1], joined.shape[0])
    image.pixels.foreach_set(joined.ravel())
    image.file_format = "PNG"
    image.filepath_raw = str(path.resolve())
    image.save()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output-dir", type=Path, default=ROOT / "demo")
    main(parser.parse_args().output_dir)
    sys.stdout.flush()
    os._exit(0)  # see obscurance_addon/__main__.py
