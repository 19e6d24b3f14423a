"""Scenes that the benchmarks bake, made through bpy."""

from __future__ import annotations

import bpy
import numpy as np

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


def select_only(objects: list[bpy.types.Object]) -> None:
    """Select these objects and make the first one active."""
    for ob in bpy.context.view_layer.objects:
        ob.select_set(ob in objects)
    bpy.context.view_layer.objects.active = objects[0]
