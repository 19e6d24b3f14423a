"""Reads from a mesh what shading needs to know of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from ...core.shading import MAX_EMISSION, NO_TRIANGLES, Shading, SurfaceArrays, tame

_FAR = 2.0**30  # of coordinates: of larger ones, products are not finite in float32
# Field and width of the attributes that can be read as colours.
ATTRIBUTE_READERS = {
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT": ("value", 1),
}


def read_surface(mesh: bpy.types.Mesh, shadings: Sequence[Shading], baked_layers: Sequence[str] = ()) -> SurfaceArrays:
    """Read from an evaluated mesh what the shadings need. Main thread only.

    Parameters
    ----------
    mesh : bpy.types.Mesh
        With `calc_loop_triangles` already called, not in Edit Mode.
    shadings : sequence of Shading
    baked_layers : sequence of str
        Colour attributes that the bake writes. They read as white, there or not: what an earlier bake left in them must
        not darken the next one.

    Returns
    -------
    SurfaceArrays
        Without triangles if no shading varies over the mesh. Triangle areas are those of the mesh's own space.
    """
    active_uv = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    active_color = mesh.attributes.default_color_name or next(iter(baked_layers), "")  # the first layer becomes default
    uv_names = {name or active_uv for shading in shadings for name in shading.uv_maps()}
    color_names = {name or active_color for shading in shadings for name in shading.color_attributes()}
    if not uv_names and not color_names:
        return NO_TRIANGLES
    corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    corners = corners.reshape(-1, 3)
    face = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", face)
    corner_vertex = np.empty(len(mesh.loops), np.int32)
    if len(corner_vertex):
        mesh.attributes[".corner_vert"].data.foreach_get("value", corner_vertex)
    return SurfaceArrays(
        triangle_corners=corners,
        triangle_face=face,
        triangle_area=_triangle_areas(mesh, corner_vertex[corners]),
        corner_vertex=corner_vertex,
        uv={name: _read_uv(mesh, name) for name in uv_names if name in mesh.uv_layers},
        color=dict(_read_colors(mesh, color_names.difference(baked_layers)))
        | {
            name: ("FACE", np.ones((len(mesh.polygons), 3), np.float32))
            for name in color_names.intersection(baked_layers)
        },
        active_uv=active_uv,
        active_color=active_color,
    )


def _triangle_areas(mesh: bpy.types.Mesh, vertices: np.ndarray) -> np.ndarray:
    position = np.empty(len(mesh.vertices) * 3, np.float32)
    if len(position):
        mesh.attributes["position"].data.foreach_get("vector", position)
    a, b, c = np.moveaxis(tame(position.reshape(-1, 3), _FAR)[vertices], 1, 0)
    return (0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)).astype(np.float32)


def _read_uv(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers[name].uv.foreach_get("vector", uv)
    return tame(uv.reshape(-1, 2), _FAR)


def _read_colors(mesh: bpy.types.Mesh, names: set[str]) -> Iterator[tuple[str, tuple[str, np.ndarray]]]:
    for name in names:
        attribute = mesh.attributes.get(name) if name else None
        if attribute is None or attribute.domain == "EDGE" or attribute.data_type not in ATTRIBUTE_READERS:
            continue
        field_name, width = ATTRIBUTE_READERS[attribute.data_type]
        values = np.empty(len(attribute.data) * width, np.float32)
        attribute.data.foreach_get(field_name, values)
        values = tame(values.reshape(-1, width), MAX_EMISSION)
        color = np.ascontiguousarray(values[:, :3]) if width > 1 else values.repeat(3, axis=1)
        yield name, (attribute.domain, color)
