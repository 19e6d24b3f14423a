"""One mesh as plain arrays."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.order import MeshArrays


def read_attribute(mesh: bpy.types.Mesh, name: str, field_name: str, dtype: str, width: int) -> np.ndarray:
    """All values of an attribute as (n, width), or (n,) for width 1."""
    data = mesh.attributes[name].data
    values = np.empty(len(data) * width, dtype)
    data.foreach_get(field_name, values)
    return values.reshape(-1, width) if width > 1 else values


def read_face_start(mesh: bpy.types.Mesh) -> np.ndarray:
    """First corner of each face, and the number of corners, (f + 1,) int32."""
    face_start = np.empty(len(mesh.polygons) + 1, np.int32)
    mesh.polygons.foreach_get("loop_start", face_start[:-1])
    face_start[-1] = len(mesh.loops)
    return face_start


def read_mesh(mesh: bpy.types.Mesh, uv_map: str | None = None) -> MeshArrays:
    """Arrays of a mesh that has at least one face, and a UV map ('' for the one that renders); main thread."""
    mesh.calc_loop_triangles()
    n_faces, n_triangles = len(mesh.polygons), len(mesh.loop_triangles)
    triangle_corners = np.empty(n_triangles * 3, np.int32)
    mesh.loop_triangles.foreach_get("loops", triangle_corners)
    triangle_face = np.empty(n_triangles, np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", triangle_face)
    if uv_map == "":
        uv_map = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    has_uv = bool(uv_map) and uv_map in mesh.uv_layers
    return MeshArrays(
        positions=read_attribute(mesh, "position", "vector", "f4", 3),
        corner_vertex=read_attribute(mesh, ".corner_vert", "value", "i4", 1),
        face_start=read_face_start(mesh),
        triangle_corners=triangle_corners.reshape(-1, 3),
        triangle_face=triangle_face,
        face_material=_optional(mesh, "material_index", "i4", n_faces),
        corner_edge=read_attribute(mesh, ".corner_edge", "value", "i4", 1),
        sharp_edge=_optional(mesh, "sharp_edge", "?", len(mesh.edges)),
        sharp_face=_optional(mesh, "sharp_face", "?", n_faces),
        uv=read_attribute(mesh, uv_map, "vector", "f4", 2) if has_uv else None,
        uv_map=uv_map or "",
    )


def same_faces(mesh: bpy.types.Mesh, arrays: MeshArrays) -> bool:
    """Whether a mesh still has the vertices, corners and faces of these arrays, wherever its vertices are now."""
    counts = (len(arrays.positions), len(arrays.corner_vertex), len(arrays.face_start) - 1)
    if (len(mesh.vertices), len(mesh.loops), len(mesh.polygons)) != counts:
        return False
    return np.array_equal(read_face_start(mesh), arrays.face_start) and np.array_equal(
        read_attribute(mesh, ".corner_vert", "value", "i4", 1), arrays.corner_vertex
    )


def _optional(mesh: bpy.types.Mesh, name: str, dtype: str, n: int) -> np.ndarray:
    """Values (n,) of an attribute that Blender leaves out while all of them are 0."""
    return read_attribute(mesh, name, "value", dtype, 1) if name in mesh.attributes else np.zeros(n, dtype)
