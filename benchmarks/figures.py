"""Renders the 2003 paper's figures 1 to 11 from the sample scenes, by this add-on's own bakes.

    python benchmarks/figures.py [--output-dir DIR] [NAME...]

writes docs/images/cornell_methods.jpg (figures 1 to 4), near_wall_methods.jpg (5 to 7), room_light.jpg (8, 9) and
infinite_light.jpg (10, 11). Every face's value is averaged over the smooth part of the surface around each of its
corners, the same for all methods, and shown by an Emission node: no light of the renderer takes part.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from light_scene import LightScene  # noqa: E402
from scenes import open_sample  # noqa: E402

from obscurance_addon.core.order.patch_parts import corner_fans  # noqa: E402
from obscurance_addon.core.scene.corners import face_of_corner  # noqa: E402

RAYS = 256
REFERENCE_RAYS = 2048
WALKS = 400_000
PIXEL_SAMPLES = 16  # smooths edges only
HEIGHT = 330  # pixels
LAYER = "Figure"
GAP = 8


def main(output_dir: Path, names: list[str]) -> None:
    """Bake, render, and write the pictures."""
    output_dir.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in names or FIGURES:
            sample, exposure, methods = FIGURES[name]
            open_sample(sample)
            scene = LightScene()
            pictures = []
            for number, method in enumerate(methods):
                _store(scene, method(scene))
                pictures.append(_render(Path(folder) / f"{number}.png", exposure))
            path = output_dir / f"{name}.jpg"
            _save_row(pictures, path)
            print(f"wrote {path}", flush=True)


def _combined(**light: object) -> Callable[[LightScene], np.ndarray]:
    return lambda scene: scene.bake(RAYS, quantity="COMBINED", **light).radiance


def _radiosity(scene: LightScene) -> np.ndarray:
    return scene.bake(REFERENCE_RAYS, quantity="RADIOSITY").radiance


def _random_walk(scene: LightScene) -> np.ndarray:
    emitted = scene.arrays.materials.emission / np.pi
    return scene.bake(RAYS, quantity="DIRECT").radiance + scene.walk(WALKS)[0] + emitted


def _constant_ambient(scene: LightScene) -> np.ndarray:
    """Direct light and the same ambient light everywhere: obscurances of a reach of nothing."""
    return scene.bake(RAYS, quantity="COMBINED", reflectors=0, distance=1e-6).radiance


# Sample scene, stops, and what is shown from left to right.
FIGURES: dict[str, tuple[str, float, list[Callable[[LightScene], np.ndarray]]]] = {
    "cornell_methods": (
        "cornell_box",
        1.2,
        [_combined(bleeding=False), _combined(), _random_walk, _radiosity],
    ),
    "near_wall_methods": ("light_near_wall", 1.0, [_combined(reflectors=0), _radiosity, _combined()]),
    "room_light": ("room_4016", 0.0, [_constant_ambient, _combined()]),
    "infinite_light": ("infinite_13824", 0.0, [_constant_ambient, _combined()]),
}


def _store(scene: LightScene, radiance: np.ndarray) -> None:
    """Write values of patches, smoothed, as a face corner attribute that all materials show."""
    for ob, part, baked in zip(scene.objects, scene.arrays.ranges, scene.snapshot.baked, strict=True):
        base, faces = baked.base, radiance[part.first : part.end][part.element_patch]
        fan = corner_fans(base)
        corner = faces[face_of_corner(base.face_start)]
        mean = np.stack([np.bincount(fan, column) for column in corner.T], -1) / np.bincount(fan)[:, None]
        colors = np.ones((len(fan), 4), np.float32)
        colors[:, :3] = mean[fan]
        attribute = ob.data.attributes.get(LAYER) or ob.data.attributes.new(LAYER, "FLOAT_COLOR", "CORNER")
        attribute.data.foreach_set("color", colors.ravel())
        ob.data.update()


def _render(png: Path, exposure: float) -> np.ndarray:
    """Render the stored values; encoded pixels (height, width, 4) float32."""
    for material in bpy.data.materials:
        tree = material.node_tree
        tree.nodes.clear()
        attribute, emission = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeEmission")
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        attribute.attribute_name = LAYER
        tree.links.new(attribute.outputs["Color"], emission.inputs["Color"])
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", PIXEL_SAMPLES, False
    scene.cycles.max_bounces = 0
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    scene.view_settings.exposure = exposure
    scene.render.resolution_x = round(HEIGHT * scene.render.resolution_x / scene.render.resolution_y)
    scene.render.resolution_y, scene.render.resolution_percentage = HEIGHT, 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(png)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(png))
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    shaped = pixels.reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    return shaped


def _save_row(pictures: list[np.ndarray], path: Path) -> None:
    gap = np.ones((HEIGHT, GAP, 4), np.float32)
    row = [part for picture in pictures for part in (gap, picture)][1:]
    joined = np.ascontiguousarray(np.concatenate(row, axis=1))
    image = bpy.data.images.new("row", joined.shape[1], joined.shape[0])
    image.pixels.foreach_set(joined.ravel())
    image.file_format = "JPEG"
    image.filepath_raw = str(path.resolve())
    image.save()
    bpy.data.images.remove(image)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output-dir", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("names", nargs="*", choices=[*FIGURES, []], metavar="NAME")
    options = parser.parse_args()
    main(options.output_dir, options.names)
    sys.stdout.flush()
    os._exit(0)  # see obscurance_addon/__main__.py
