"""What is solid of the meshes of a snapshot, and their faces turned the same way round. numpy only, any thread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene import find_shells
from .snapshot import MeshArrays, ObjectSnapshot, SceneSnapshot


def with_shells(mesh: MeshArrays) -> MeshArrays:
    """The mesh with its shells, and the triangles of flipped faces turned."""
    if mesh.shells is not None:
        return mesh
    shells, flipped = find_shells(mesh.positions, mesh.corner_vertex[mesh.triangle_corners])
    if not flipped.any():
        return replace(mesh, shells=shells)
    corners = np.where(flipped[:, None], mesh.triangle_corners[:, ::-1], mesh.triangle_corners)
    return replace(mesh, shells=shells, triangle_corners=corners, flipped_faces=len(set(mesh.triangle_face[flipped])))


def snapshot_with_shells(snapshot: SceneSnapshot) -> SceneSnapshot:
    """The snapshot with the shells of all meshes; objects that share a mesh go on sharing it."""
    found: dict[int, MeshArrays] = {}

    def turned(ob: ObjectSnapshot) -> ObjectSnapshot:
        if id(ob.mesh) not in found:
            found[id(ob.mesh)] = with_shells(ob.mesh)
        return replace(ob, mesh=found[id(ob.mesh)])

    return replace(
        snapshot,
        baked=[
            replace(
                baked, snapshot=turned(baked.snapshot), beside=None if baked.beside is None else turned(baked.beside)
            )
            for baked in snapshot.baked
        ],
        occluders=[turned(ob) for ob in snapshot.occluders],
    )
