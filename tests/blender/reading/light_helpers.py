"""Lamps, and what Cycles makes of them."""

from __future__ import annotations

import bpy
import numpy as np

from tests.blender.helpers import bake, colors, new_object, read

LAYER = "Cycles"
CYCLES_SAMPLES = 1024


def lamp(
    kind: str,
    location: tuple[float, float, float] = (0.0, 0.0, 1.0),
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    name: str = "Lamp",
    **values: object,
) -> bpy.types.Object:
    """A light object in the scene; the values are those of its data."""
    light = bpy.data.lights.new(name, kind)
    for key, value in values.items():
        setattr(light, key, value)
    made = bpy.data.objects.new(name, light)
    bpy.context.scene.collection.objects.link(made)
    made.location, made.rotation_euler, made.scale = location, rotation, scale
    return made


def set_world(color: tuple[float, float, float], strength: float = 1.0) -> None:
    """A world with a Background node."""
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    background = next(n for n in world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = world


def diffuse(
    name: str, color: tuple[float, float, float], emission: tuple[float, float, float] | None = None
) -> bpy.types.Material:
    """A Lambertian material; one that shines adds an Emission node."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    end, shader = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (*color, 1.0)
    out = shader.outputs[0]
    if emission is not None:
        shine, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
        shine.inputs["Color"].default_value = (*emission, 1.0)
        tree.links.new(out, both.inputs[0])
        tree.links.new(shine.outputs[0], both.inputs[1])
        out = both.outputs[0]
    tree.links.new(out, end.inputs["Surface"])
    return made


def cycles_direct(ob: bpy.types.Object, samples: int = CYCLES_SAMPLES) -> np.ndarray:
    """Cycles' direct diffuse bake at the face corners of an object, (c, 3): outgoing radiance."""
    return _cycles_bake(ob, samples, type="DIFFUSE", pass_filter={"DIRECT", "COLOR"})


def cycles_ao_on_faces(ob: bpy.types.Object, distance: float, samples: int = CYCLES_SAMPLES) -> np.ndarray:
    """Cycles' ambient occlusion up to a distance: the mean over the corners of each face, (f,)."""
    world = bpy.context.scene.world or bpy.data.worlds.new("World")
    bpy.context.scene.world, world.light_settings.distance = world, distance
    corners = _cycles_bake(ob, samples, type="AO")[:, 0]
    return np.add.reduceat(corners, [face.loop_start for face in ob.data.polygons]) / [
        len(face.vertices) for face in ob.data.polygons
    ]


def _cycles_bake(ob: bpy.types.Object, samples: int, **what: object) -> np.ndarray:
    """A bake by Cycles at the face corners of an object, (c, 3)."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.samples = "CPU", False, samples
    scene.cycles.use_adaptive_sampling = False
    mesh = ob.data
    if LAYER not in mesh.color_attributes:
        mesh.color_attributes.new(LAYER, "FLOAT_COLOR", "CORNER")
    mesh.color_attributes.active_color = mesh.color_attributes[LAYER]
    for other in bpy.context.view_layer.objects:
        other.select_set(other == ob)
    bpy.context.view_layer.objects.active = ob
    bpy.ops.object.bake(target="VERTEX_COLORS", **what)
    return read(mesh, LAYER)[:, :3].astype(np.float64)


def relative_rmse(found: np.ndarray, exact: np.ndarray) -> float:
    """Root mean square difference relative to the root mean square of what is exact."""
    return float(np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum()))


def probes(n: int = 24, size: float = 4.0, side: float = 0.002, **kw: object) -> bpy.types.Object:
    """n x n tiny squares, spread over a horizontal square and looking up, so small that light on each is even."""
    at = (np.arange(n) + 0.5) / n * size - 0.5 * size
    corners = 0.5 * side * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    vertices = np.concatenate([corners + np.array((x, y, 0.0)) for y in at for x in at])
    return new_object("Probes", vertices, np.arange(4 * n * n).reshape(-1, 4), **kw)


def cycles_on_faces(ob: bpy.types.Object, samples: int = CYCLES_SAMPLES) -> np.ndarray:
    """`cycles_direct` averaged over the corners of each face of a mesh of squares, (f, 3)."""
    return cycles_direct(ob, samples).reshape(-1, 4, 3).mean(1)


def direct_on_faces(ob: bpy.types.Object, rays: int = 1024) -> np.ndarray:
    """Our direct light on the faces of an object, (f, 3)."""
    bake(ob, rays=rays, quantity="DIRECT", threads=0)
    return colors(ob).astype(np.float64)
