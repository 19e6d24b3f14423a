"""Ties what is seen of an object to its unmodified mesh, whose faces, corners or vertices receive the values."""

from __future__ import annotations

from dataclasses import replace

import bpy

from ...core.errors import GeometryError
from ...core.lightmap import LightmapSettings, UvMode
from ...core.order import BakedObject, ObjectSnapshot
from ..materials import read_surface
from .meshes import read_mesh, same_faces
from .objects import SceneReader
from .origins import made_elsewhere, with_own_origins


def tie(ob: bpy.types.Object, snapshot: ObjectSnapshot, reader: SceneReader) -> BakedObject:
    """An object to bake.

    Parameters
    ----------
    ob : bpy.types.Object
        Original, not in Edit Mode.
    snapshot : ObjectSnapshot
        What the reader read of it.
    reader : SceneReader

    Raises
    ------
    GeometryError
        When it lacks the UV map that it is to keep.
    """
    lightmap = reader.lightmap
    if lightmap is not None and lightmap.uv_mode is UvMode.KEEP:
        return _with_kept_uv(ob, snapshot, lightmap)
    if snapshot.mesh.face_origin is None and same_faces(ob.data, snapshot.mesh):
        return BakedObject(snapshot, snapshot.mesh, ob.session_uid)
    base, beside = read_mesh(ob.data), None
    mesh = with_own_origins(snapshot.mesh, base)
    if mesh.face_origin is None:
        base = mesh
    elif lightmap is not None or not mesh.face_origin.any():
        why, cure = "keep no link to the faces they started from", ""
        if lightmap is not None:
            why, cure = "change which faces there are", ", or keep the UV map of this bake in the next one,"
        made, where = made_elsewhere(snapshot.mesh, base), ""
        if made is not None:
            beside, where = replace(snapshot, mesh=made), ", beside what they make elsewhere"
        reader.notes.add(
            f"modifiers {why}, so the unmodified mesh was baked{where}",
            ob.name,
            cure=f"apply the modifiers{cure} to bake what they make",
        )
        mesh = base
        snapshot = replace(snapshot, surface=read_surface(ob.data, snapshot.shadings, reader.baked_layers))
    return BakedObject(replace(snapshot, mesh=mesh), base, ob.session_uid, beside)


def _with_kept_uv(ob: bpy.types.Object, snapshot: ObjectSnapshot, lightmap: LightmapSettings) -> BakedObject:
    """An object as modifiers make it, with the UV map that came with it."""
    if snapshot.mesh.uv is None:
        missing = f"no UV map named '{lightmap.uv_map}'" if lightmap.uv_map else "no UV map"
        raise GeometryError(f"object '{ob.name}' has {missing} to keep: choose another one, or let the bake unwrap")
    mesh = replace(snapshot.mesh, face_origin=None, rest=None)
    return BakedObject(replace(snapshot, mesh=mesh), mesh, ob.session_uid)
