"""What transparent surfaces cost: a floor below layers of leaf cards, opaque, half transparent and cut out."""

from __future__ import annotations

import bpy
import numpy as np
from scenes import empty_scene

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.core.order.output import OutputSettings
from obscurance_addon.core.settings import BakeSettings

LAYERS = (1, 5, 30)
SIDE, HEIGHT = 16, 2.0  # leaves along each side of a layer, and metres up to the last layer
TEXELS = 256
KINDS = ("opaque", "half", "cut-out")


def run(repeats: int) -> list[dict]:
    """Bake the floor under each number of layers and kind of leaf."""
    results = []
    for layers in LAYERS:
        seconds: dict[str, list[float]] = {kind: [] for kind in KINDS}
        means = {}
        for _ in range(repeats):
            for kind in KINDS:  # side by side, so that ratios hold
                empty_scene()
                floor = _foliage(layers, kind)
                report = BakeJob(bpy.context, [floor], BakeSettings(rays=64, distance=4.0), OutputSettings()).run()
                seconds[kind].append(report.seconds["trace"])
                means[kind] = _mean(floor)
        results.append({"layers": layers, "rays": report.rays, "seconds": seconds, "means": means})
    return results


def _foliage(layers: int, kind: str) -> bpy.types.Object:
    """A floor of 48 x 48 faces below tilted leaves of 0.25 m; returns the floor."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=48, y_subdivisions=48, size=4.0)
    floor = bpy.context.object
    rng = np.random.default_rng(0)
    count = layers * SIDE * SIDE
    i, j, k = np.unravel_index(np.arange(count), (layers, SIDE, SIDE))
    centre = np.stack([(j + 0.5) / SIDE, (k + 0.5) / SIDE, (i + 1.0) / layers], -1) * (4.0, 4.0, HEIGHT) - (
        2.0,
        2.0,
        0.0,
    )
    u, v = rng.normal(size=(2, count, 3)) * (1.0, 1.0, 0.4)
    u *= 0.125 / np.linalg.norm(u, axis=1, keepdims=True)
    v -= u * (u * v).sum(1, keepdims=True) / (u * u).sum(1, keepdims=True)
    v *= 0.125 / np.linalg.norm(v, axis=1, keepdims=True)
    corners = np.stack([centre - u - v, centre + u - v, centre + u + v, centre - u + v], 1)
    mesh = bpy.data.meshes.new("Leaves")
    mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], np.arange(4 * count).reshape(-1, 4).tolist())
    square = np.tile(np.float32([0, 0, 1, 0, 1, 1, 0, 1]), count)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", square)
    mesh.materials.append(_leaf(kind))
    bpy.context.collection.objects.link(bpy.data.objects.new("Leaves", mesh))
    return floor


def _leaf(kind: str) -> bpy.types.Material:
    """Green; half transparent, or cut out to a disc that covers half of the card."""
    made = bpy.data.materials.new("Leaf")
    if bpy.app.version < (5, 0, 0):
        made.use_nodes = True
    tree = made.node_tree
    node = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Base Color"].default_value = (0.2, 0.5, 0.1, 1.0)
    if kind == "half":
        node.inputs["Alpha"].default_value = 0.5
    elif kind == "cut-out":
        at = (np.arange(TEXELS) + 0.5) / TEXELS - 0.5
        pixels = np.ones((TEXELS, TEXELS, 4), np.float32)
        pixels[..., 3] = at[:, None] ** 2 + at**2 < 0.5 / np.pi
        image = bpy.data.images.new("Leaf", TEXELS, TEXELS, alpha=True, float_buffer=True)
        image.pixels.foreach_set(pixels.ravel())
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = image
        tree.links.new(texture.outputs["Alpha"], node.inputs["Alpha"])
    return made


def _mean(floor: bpy.types.Object) -> float:
    data = floor.data.attributes["Obscurance"].data
    colors = np.empty(4 * len(data), np.float32)
    data.foreach_get("color", colors)
    return float(colors.reshape(-1, 4)[:, 1].mean())
