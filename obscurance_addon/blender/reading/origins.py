"""Face indices and vertex positions that ride through modifiers, to tell where each evaluated face came from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np

from ...core.errors import GeometryError
from ...core.order import MeshArrays
from .meshes import FACE_INDEX, REST_POSITION, read_attribute

# Modifiers that move vertices at most; every other one may change which faces there are.
_DEFORM_ONLY = {
    "ARMATURE", "CAST", "CLOTH", "COLLISION", "CORRECTIVE_SMOOTH", "CURVE", "DATA_TRANSFER", "DISPLACE", "HOOK",
    "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "NORMAL_EDIT", "PARTICLE_SYSTEM",
    "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM", "UV_PROJECT", "UV_WARP",
    "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "VOLUME_DISPLACE", "WARP", "WAVE",
    "WEIGHTED_NORMAL",
}  # fmt: skip

# Modifiers that do the same to every face, wherever it is.
_ALL_FACES_ALIKE = {"SUBSURF", "MULTIRES", "SOLIDIFY"}


@contextmanager
def carried_indices(objects: list[bpy.types.Object], needs_rest: bool) -> Iterator[dict[int, int]]:
    """Put face indices (and positions) on meshes whose modifiers may change topology, while the block lasts.

    Gives the session uid of each such mesh and the index before its first one: no two meshes use the same indices, so
    that faces which modifiers bring in from another object are not taken for an object's own.
    """
    meshes = {ob.data.session_uid: ob.data for ob in objects if _may_change_topology(ob)}
    for mesh in meshes.values():
        taken = {FACE_INDEX, REST_POSITION}.intersection(mesh.attributes.keys())
        if taken:
            raise GeometryError(
                f"mesh '{mesh.name}' has an attribute named '{taken.pop()}', which a bake needs: rename it"
            )
    counts = [len(mesh.polygons) for mesh in meshes.values()]
    first_index = dict(zip(meshes, np.cumsum([0, *counts]).tolist(), strict=False))
    try:
        for uid, mesh in meshes.items():
            indices = first_index[uid] + np.arange(1, len(mesh.polygons) + 1, dtype=np.int32)
            _put(mesh, FACE_INDEX, "INT", "FACE", "value", indices.astype(np.int32))
            if needs_rest:
                positions = read_attribute(mesh, "position", "vector", "f4", 3)
                _put(mesh, REST_POSITION, "FLOAT_VECTOR", "POINT", "vector", positions)
            mesh.update()
        yield first_index
    finally:
        for mesh in meshes.values():
            for name in (FACE_INDEX, REST_POSITION):
                if name in mesh.attributes:
                    mesh.attributes.remove(mesh.attributes[name])
            mesh.update()


def keeps_links(ob: bpy.types.Object) -> bool:
    """Whether faces come from the same unmodified ones for as long as they hang together as they do.

    Other modifiers choose faces by where vertices are, or by what else they are told.
    """
    return all(
        not modifier.show_viewport or modifier.type in _DEFORM_ONLY or modifier.type in _ALL_FACES_ALIKE
        for modifier in ob.modifiers
    )


def _may_change_topology(ob: bpy.types.Object) -> bool:
    return any(modifier.show_viewport and modifier.type not in _DEFORM_ONLY for modifier in ob.modifiers)


def with_own_origins(mesh: MeshArrays, base: MeshArrays, first_index: int | None) -> MeshArrays:
    """An evaluated mesh with `face_origin` as 1-based faces of the object's own mesh, 0 for those of any other.

    Faces that are the unmodified ones, in the same order, come back without `face_origin`.
    """
    n_faces = len(base.face_start) - 1
    same = np.array_equal(mesh.face_start, base.face_start) and np.array_equal(mesh.corner_vertex, base.corner_vertex)
    if first_index is None:
        origin = np.arange(1, n_faces + 1) if same else np.zeros(len(mesh.face_start) - 1, np.int64)
    elif mesh.face_origin is None or (base.rest is not None and mesh.rest is None):
        origin = np.zeros(len(mesh.face_start) - 1, np.int64)
    else:
        origin = mesh.face_origin.astype(np.int64) - first_index
        origin[(origin < 1) | (origin > n_faces)] = 0
    if same and np.array_equal(origin, np.arange(1, n_faces + 1)):
        return replace(mesh, face_origin=None, rest=None)
    return replace(mesh, face_origin=origin)


def _put(mesh: bpy.types.Mesh, name: str, kind: str, domain: str, field_name: str, values: np.ndarray) -> None:
    mesh.attributes.new(name, kind, domain)
    mesh.attributes[name].data.foreach_set(field_name, values.ravel())
