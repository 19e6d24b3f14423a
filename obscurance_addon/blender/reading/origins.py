"""Where the faces that modifiers make come from: face indices and vertex positions that ride through modifiers.

They ride on the depsgraph's own copy of a mesh, over which the modifiers of one object run once more. So nothing of the
user's is touched or tagged and nothing else is evaluated, which a frame handler may not have done: Blender crashes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.order import MeshArrays
from ...core.scene import connected_components
from .meshes import read_attribute

# Modifiers that move vertices at most; every other one may change which faces there are.
_DEFORM_ONLY = {
    "ARMATURE", "CAST", "CLOTH", "COLLISION", "CORRECTIVE_SMOOTH", "CURVE", "DATA_TRANSFER", "DISPLACE", "HOOK",
    "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "NORMAL_EDIT", "PARTICLE_SYSTEM",
    "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM", "UV_PROJECT", "UV_WARP",
    "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "VOLUME_DISPLACE", "WARP", "WAVE",
    "WEIGHTED_NORMAL",
}  # fmt: skip

_NEAR_BASE = 0.1  # of its diagonal: how far the box of a part may be from that of the unmodified part behind it
_MOST_PARTS = 256  # of an unmodified mesh that are told apart

_FACE_INDEX = "obscurance_face_index"  # above 0, since faces without origin read 0
_REST_POSITION = "obscurance_rest_position"


@dataclass(frozen=True)
class EvaluatedMesh:
    """A mesh as modifiers make it, and what its faces (f,) int32 and vertices (v, 3) float32 carried, if anything."""

    mesh: bpy.types.Mesh
    face_origin: np.ndarray | None = None
    rest: np.ndarray | None = None


def may_change_topology(ob: bpy.types.Object) -> bool:
    """Whether modifiers of an object, in the viewport or in renders, may change which faces there are."""
    return any(
        (modifier.show_viewport or modifier.show_render) and modifier.type not in _DEFORM_ONLY
        for modifier in ob.modifiers
    )


@contextmanager
def evaluated_mesh(ob: bpy.types.Object) -> Iterator[EvaluatedMesh]:
    """The mesh of an evaluated object while the block lasts."""
    try:
        yield EvaluatedMesh(
            ob.to_mesh()
        )  # not ob.data, which lacks the last subdivision where the graphics card makes it
    finally:
        ob.to_mesh_clear()


@contextmanager
def carried_mesh(
    ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph, needs_rest: bool, results: Collection[str]
) -> Iterator[EvaluatedMesh]:
    """The mesh of an evaluated object, with what its faces and vertices carried through its modifiers.

    Parameters
    ----------
    ob : bpy.types.Object
        Evaluated by `depsgraph`.
    depsgraph : bpy.types.Depsgraph
    needs_rest : bool
        Carry vertex positions too.
    results : collection of str
        Layers of results, which read 0 meanwhile: what a bake wrote must not decide from where the next one's faces
        come, as it does below a Bevel.
    """
    source = ob.original.data.evaluated_get(depsgraph)
    with ExitStack() as undo:
        for name in results:
            undo.enter_context(_blank(source, name))
        index = undo.enter_context(_riding(source, _FACE_INDEX, "INT", "FACE"))
        source.attributes[index].data.foreach_set("value", np.arange(1, len(source.polygons) + 1, dtype=np.int32))
        carried = {"face_origin": (index, "FACE", "value", "i4", 1)}
        if needs_rest:
            rest = undo.enter_context(_riding(source, _REST_POSITION, "FLOAT_VECTOR", "POINT"))
            positions = read_attribute(source, "position", "vector", "f4", 3)
            source.attributes[rest].data.foreach_set("vector", positions.ravel())
            carried["rest"] = rest, "POINT", "vector", "f4", 3
        undo.callback(ob.to_mesh_clear)
        mesh = ob.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
        if not all(_has(mesh, name, domain) for name, domain, *_ in carried.values()):  # a mesh that was made anew
            yield EvaluatedMesh(mesh, np.zeros(len(mesh.polygons), np.int32))
        else:
            found = {key: read_attribute(mesh, name, *how) for key, (name, _domain, *how) in carried.items()}
            yield EvaluatedMesh(mesh, **found)


def with_own_origins(mesh: MeshArrays, base: MeshArrays) -> MeshArrays:
    """An evaluated mesh with `face_origin` as 1-based faces of the unmodified one, 0 for those that came from none.

    Faces that are the unmodified ones, in the same order, come back without `face_origin`.
    """
    n_faces = len(base.face_start) - 1
    same = np.array_equal(mesh.face_start, base.face_start) and np.array_equal(mesh.corner_vertex, base.corner_vertex)
    if mesh.face_origin is None:
        origin = np.arange(1, n_faces + 1) if same else np.zeros(len(mesh.face_start) - 1, np.int64)
    else:
        origin = mesh.face_origin.astype(np.int64)
        origin[(origin < 1) | (origin > n_faces)] = 0
    if same and np.array_equal(origin, np.arange(1, n_faces + 1)):
        return replace(mesh, face_origin=None, rest=None)
    return replace(mesh, face_origin=origin)


def made_elsewhere(mesh: MeshArrays, base: MeshArrays) -> MeshArrays | None:
    """The connected parts of an evaluated mesh for which the unmodified one cannot stand; None where there are none.

    A part of the unmodified mesh stands for those whose boxes are nearly its own: what modifiers smooth, bevel or
    thicken. Others are copies, what is scattered, and shapes that nodes make anew.
    """
    part, low, high = _parts(mesh)
    _, base_low, base_high = _parts(base)
    if len(base_low) > _MOST_PARTS:  # then they stand together
        base_low, base_high = base_low.min(0, keepdims=True), base_high.max(0, keepdims=True)
    stands = np.zeros(len(low), bool)
    for lowest, highest in zip(base_low, base_high, strict=True):
        margin = _NEAR_BASE * np.linalg.norm(highest - lowest)
        stands |= ((np.abs(low - lowest) <= margin) & (np.abs(high - highest) <= margin)).all(1)
    kept = ~stands[part]
    if not kept.any():
        return None
    return replace(
        mesh,
        triangle_corners=mesh.triangle_corners[kept],
        triangle_face=mesh.triangle_face[kept],
        face_origin=None,
        rest=None,
    )


def _parts(mesh: MeshArrays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The connected part (t,) of each triangle, and the lowest and highest corners of the parts, each (k, 3)."""
    corners = mesh.corner_vertex[mesh.triangle_corners]
    of_vertex = connected_components(len(mesh.positions), np.concatenate([corners[:, :2], corners[:, 1:]]))
    _, part = np.unique(of_vertex[corners[:, 0]], return_inverse=True)
    order = np.argsort(part, kind="stable")
    first = np.searchsorted(part[order], np.arange(part.max(initial=-1) + 1))
    points = mesh.positions[corners[order]]
    return part, np.minimum.reduceat(points.min(1), first), np.maximum.reduceat(points.max(1), first)


def _has(mesh: bpy.types.Mesh, name: str, domain: str) -> bool:
    return name in mesh.attributes and mesh.attributes[name].domain == domain


@contextmanager
def _riding(mesh: bpy.types.Mesh, name: str, kind: str, domain: str) -> Iterator[str]:
    """The name of an attribute that an evaluated mesh has while the block lasts."""
    while (made := mesh.attributes.new(name, kind, domain)) is None:  # a vertex group has the name
        name += "_"
    name = made.name  # numbered where an attribute has it
    try:
        yield name
    finally:
        mesh.attributes.remove(mesh.attributes[name])


@contextmanager
def _blank(mesh: bpy.types.Mesh, name: str) -> Iterator[None]:
    """Zeros in a layer of an evaluated mesh while the block lasts; nothing where there is no such layer."""
    layer = mesh.attributes.get(name)
    field_name, width = {"FLOAT_COLOR": ("color", 4), "FLOAT2": ("vector", 2)}.get(layer and layer.data_type, ("", 0))
    if not width:
        yield
        return
    values = np.empty(len(layer.data) * width, np.float32)
    layer.data.foreach_get(field_name, values)
    layer.data.foreach_set(field_name, np.zeros_like(values))
    try:
        yield
    finally:
        mesh.attributes[name].data.foreach_set(field_name, values)
