"""Reads a scene from the evaluated depsgraph into plain arrays, the one step of a bake that needs the main thread.

The snapshot holds no bpy object. It is taken in one go, so that nothing the user does later can tear it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import bpy

from ...core.errors import GeometryError
from ...core.lightmap import LightmapSettings, UvMode
from ...core.notes import Notes
from ...core.order import BakedObject, ObjectSnapshot, SceneSnapshot
from ..materials import read_surface
from .left_out import note_refused, nothing_to_bake, unseen_reason
from .libraries import note_missing
from .lights import LightReader
from .meshes import read_mesh
from .objects import SceneReader
from .origins import carried_indices, with_own_origins


def snapshot_scene(
    context: bpy.types.Context,
    objects: Iterable[bpy.types.Object],
    needs_rest: bool = False,
    baked_layers: Sequence[str] = (),
    needs_light: bool = False,
    lightmap: LightmapSettings | None = None,
) -> SceneSnapshot:
    """Read the objects to bake and everything that occludes them.

    Parameters
    ----------
    context : bpy.types.Context
        Its view layer is evaluated, in viewport mode.
    objects : iterable of bpy.types.Object
        Mesh objects in object mode, in the view layer, with a writable mesh.
    needs_rest : bool
        Carry vertex positions through modifiers too: needed for values per corner or vertex.
    baked_layers : sequence of str
        Colour attributes that the bake will write; materials that read them see white.
    needs_light : bool
        Read lights and world too.
    lightmap : LightmapSettings, optional
        Where a lightmap is baked: read the UV map that it keeps; or leave out modifiers that change which faces there
        are, for whose faces no UV map could be written.

    Returns
    -------
    SceneSnapshot

    Raises
    ------
    GeometryError
        When none of the objects to bake is visible, or one lacks the UV map to keep.
    """
    objects = list(objects)
    notes = Notes()
    note_missing(context.scene, notes)
    with carried_indices(objects, needs_rest) as first_index:
        depsgraph = context.evaluated_depsgraph_get()
        reader = SceneReader(context, notes, baked_layers, LightReader(notes) if needs_light else None, lightmap)
        wanted = {ob.session_uid: ob for ob in objects}
        found: dict[int, ObjectSnapshot] = {}
        occluders = []
        for instance in depsgraph.object_instances:
            snapshot = reader.read(instance)
            if snapshot is None:
                continue
            uid = instance.object.original.session_uid
            if not instance.is_instance and uid in wanted:
                found[uid] = snapshot
            else:
                occluders.append(snapshot)
        reader.note_hidden()
        baked = [
            _baked_object(ob, found[ob.session_uid], first_index.get(ob.data.session_uid), reader)
            for ob in objects
            if ob.session_uid in found
        ]
    unseen = [(ob, unseen_reason(context, ob)) for ob in objects if ob.session_uid not in found]
    if not baked:
        raise nothing_to_bake(context, unseen)
    note_refused(unseen, notes)
    sources = reader.light_sources()
    return SceneSnapshot(baked, occluders, notes.lines(), sources)


def _baked_object(
    ob: bpy.types.Object, snapshot: ObjectSnapshot, first_index: int | None, reader: SceneReader
) -> BakedObject:
    """Tie what is seen of an object to its unmodified mesh, whose face indices were carried from `first_index` on."""
    if reader.lightmap is not None and reader.lightmap.uv_mode is UvMode.KEEP:
        return _with_kept_uv(ob, snapshot, reader.lightmap)
    base = read_mesh(ob.data)
    mesh = with_own_origins(snapshot.mesh, base, first_index)
    if mesh.face_origin is None:
        base = mesh
    elif reader.lightmap is not None or not mesh.face_origin.any():
        why, cure = "keep no link to the faces they started from", ""
        if reader.lightmap is not None:
            why, cure = "change which faces there are", ", or keep the UV map of this bake in the next one,"
        reader.notes.add(
            f"modifiers {why}, so the unmodified mesh was baked",
            ob.name,
            cure=f"apply the modifiers{cure} to bake what they make",
        )
        base = mesh = replace(base, face_origin=None, rest=None)
        snapshot = replace(snapshot, surface=read_surface(ob.data, snapshot.shadings, reader.baked_layers))
    return BakedObject(replace(snapshot, mesh=mesh), base, ob.session_uid)


def _with_kept_uv(ob: bpy.types.Object, snapshot: ObjectSnapshot, lightmap: LightmapSettings) -> BakedObject:
    """An object as modifiers make it, with the UV map that came with it."""
    if snapshot.mesh.uv is None:
        missing = f"no UV map named '{lightmap.uv_map}'" if lightmap.uv_map else "no UV map"
        raise GeometryError(f"object '{ob.name}' has {missing} to keep: choose another one, or let the bake unwrap")
    mesh = replace(snapshot.mesh, face_origin=None, rest=None)
    return BakedObject(replace(snapshot, mesh=mesh), mesh, ob.session_uid)
