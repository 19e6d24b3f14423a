"""Scenes that the benchmarks bake, made through bpy."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np

SAMPLES = Path(__file__).resolve().parent.parent / "sample_blends"
SUZANNE_LEVELS = 4  # 500 faces become 125,952 quads


def empty_scene() -> None:
    """A new file without objects."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def suzanne_over_plane() -> list[bpy.types.Object]:
    """Suzanne, subdivided to 126k faces and smooth, above a plane of one face."""
    bpy.ops.mesh.primitive_plane_add(size=6.0)
    plane = bpy.context.object
    bpy.ops.mesh.primitive_monkey_add(location=(0.0, 0.0, 0.95))
    suzanne = bpy.context.object
    modifier = suzanne.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = SUZANNE_LEVELS
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    suzanne.data.polygons.foreach_set("use_smooth", np.ones(len(suzanne.data.polygons), bool))
    return [suzanne, plane]


def many_objects(count: int = 100, faces: int = 500) -> list[bpy.types.Object]:
    """Separate Suzannes of 500 faces each, side by side on a grid, each with a mesh of its own."""
    objects = []
    bpy.ops.mesh.primitive_monkey_add()
    first = bpy.context.object
    assert len(first.data.polygons) == faces
    side = int(np.ceil(np.sqrt(count)))
    for i in range(count):
        ob = first if i == 0 else first.copy()
        if i:
            ob.data = first.data.copy()
            bpy.context.collection.objects.link(ob)
        ob.location = (2.6 * (i % side), 2.6 * (i // side), 0.0)
        objects.append(ob)
    return objects


def solids_on_floor(count: int) -> list[bpy.types.Object]:
    """A floor of one face and flat-shaded closed solids of five kinds, 3 m apart, sunk a little into it; no UVs."""
    side = int(np.ceil(np.sqrt(count)))
    bpy.ops.mesh.primitive_plane_add(size=3.0 * side + 1.0)
    floor = bpy.context.object
    floor.name = "Floor"
    add = bpy.ops.mesh
    kinds = (
        (add.primitive_ico_sphere_add, {"subdivisions": 4, "radius": 1.0}, 0.9),
        (add.primitive_cube_add, {"size": 1.6}, 0.7),
        (add.primitive_torus_add, {"major_radius": 0.9, "minor_radius": 0.4}, 0.35),
        (add.primitive_cylinder_add, {"radius": 0.7, "depth": 2.0, "vertices": 24}, 0.9),
        (add.primitive_cone_add, {"radius1": 0.9, "depth": 1.8, "vertices": 16}, 0.8),
    )
    objects = [floor]
    for i in range(count):
        make, shape, height = kinds[i % len(kinds)]
        make(location=(3.0 * (i % side - 0.5 * (side - 1)), 3.0 * (i // side - 0.5 * (side - 1)), height), **shape)
        ob = bpy.context.object
        ob.rotation_euler.z = 0.7 * i
        objects.append(ob)
    for ob in objects:
        while ob.data.uv_layers:
            ob.data.uv_layers.remove(ob.data.uv_layers[0])
    return objects


def bumpy_terrain(faces: int) -> bpy.types.Object:
    """A square grid of about that many faces, with hills of a dozen faces: rays meet the same at any size."""
    side = round(np.sqrt(faces))
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij")
    z = 1.5 * np.sin(0.53 * x) * np.cos(0.47 * y) + 0.6 * np.sin(1.31 * x + 0.4) * np.sin(1.07 * y)
    index = np.arange((side + 1) ** 2, dtype=np.int32).reshape(side + 1, side + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1)
    mesh = bpy.data.meshes.new("Terrain")
    mesh.vertices.add(index.size)
    mesh.attributes["position"].data.foreach_set("vector", np.stack([x, y, z], -1).astype(np.float32).ravel())
    mesh.loops.add(len(quads))
    mesh.loops.foreach_set("vertex_index", quads)
    mesh.polygons.add(side * side)
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(quads), 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.validate()
    terrain = bpy.data.objects.new("Terrain", mesh)
    bpy.context.collection.objects.link(terrain)
    return terrain


TERRAIN_DISTANCE = 4.0  # metres: four faces, whatever the size of the terrain


def open_sample(name: str) -> None:
    """One of the sample scenes."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / f"{name}.blend"), load_ui=False)


def light_to_all_sides() -> None:
    """The light near the wall with a lamp that shines from all its sides, half as strong: light is spread out."""
    open_sample("light_near_wall")
    lamp = bpy.data.materials["Lamp"]
    for slot in bpy.data.objects["Lamp"].material_slots:
        slot.material = lamp
    for node in lamp.node_tree.nodes:
        if node.bl_idname == "ShaderNodeBsdfPrincipled":
            node.inputs["Emission Strength"].default_value *= 0.5


def yard() -> None:
    """An open scene: coloured blocks on a field and a wall, under a sun and a dim sky."""
    empty_scene()
    _grid("Field", (-4.0, -4.0, 0.0), (8.0, 0.0, 0.0), (0.0, 8.0, 0.0), 40, 40, (0.55, 0.5, 0.4))
    _grid("Wall", (-3.0, 3.0, 0.0), (6.0, 0.0, 0.0), (0.0, 0.0, 2.0), 30, 10, (0.7, 0.3, 0.25))
    for i, (x, y, side, turn, colour) in enumerate(
        (
            (-2.0, 0.0, 1.2, 0.3, (0.7, 0.1, 0.1)),
            (0.2, 1.6, 1.0, 0.0, (0.1, 0.5, 0.15)),
            (1.6, -0.5, 1.5, 0.7, (0.75, 0.75, 0.75)),
            (-0.6, -1.8, 0.7, 0.2, (0.8, 0.65, 0.1)),
        )
    ):
        block = _block(f"Block {i}", side, 8, colour)
        block.location, block.rotation_euler = (x, y, 0.0), (0.0, 0.0, turn)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 3.0, 0.01
    lamp = bpy.data.objects.new("Sun", sun)
    lamp.rotation_euler = (math.radians(50.0), 0.0, math.radians(30.0))
    bpy.context.scene.collection.objects.link(lamp)
    world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    background = next(n for n in world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (0.25, 0.35, 0.5, 1.0)
    bpy.context.scene.world = world
    bpy.context.view_layer.update()


def _grid(name: str, corner: tuple, u: tuple, v: tuple, nu: int, nv: int, colour: tuple) -> bpy.types.Object:
    corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
    points = [corner + u * i / nu + v * j / nv for j in range(nv + 1) for i in range(nu + 1)]
    first = [j * (nu + 1) + i for j in range(nv) for i in range(nu)]
    return _object(name, points, [(a, a + 1, a + nu + 2, a + nu + 1) for a in first], colour)


def _block(name: str, side: float, n: int, colour: tuple) -> bpy.types.Object:
    """A box on the ground, its bottom left out, cut into n x n faces a side."""
    h = 0.5 * side
    sides = [
        ((-h, -h, 0), (side, 0, 0), (0, 0, side)),
        ((h, h, 0), (-side, 0, 0), (0, 0, side)),
        ((h, -h, 0), (0, side, 0), (0, 0, side)),
        ((-h, h, 0), (0, -side, 0), (0, 0, side)),
        ((-h, -h, side), (side, 0, 0), (0, side, 0)),
    ]
    points, faces = [], []
    for corner, u, v in sides:
        corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
        base = len(points)
        points += [corner + u * i / n + v * j / n for j in range(n + 1) for i in range(n + 1)]
        first = [base + j * (n + 1) + i for j in range(n) for i in range(n)]
        faces += [(a, a + 1, a + n + 2, a + n + 1) for a in first]
    return _object(name, points, faces, colour)


def _object(name: str, points: list, faces: list, colour: tuple) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, p)) for p in points], [], faces)
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    end, shader = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (*colour, 1.0)
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    mesh.materials.append(material)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def select_only(objects: list[bpy.types.Object]) -> None:
    """Select these objects and make the first one active."""
    for ob in bpy.context.view_layer.objects:
        ob.select_set(ob in objects)
    bpy.context.view_layer.objects.active = objects[0]
