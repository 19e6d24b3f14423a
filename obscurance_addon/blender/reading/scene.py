"""Reads a scene from the evaluated depsgraph into plain arrays, the one step of a bake that needs the main thread.

The snapshot holds no bpy object. It is taken in one go, so that nothing the user does later can tear it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy

from ...core.lightmap import LightmapSettings
from ...core.notes import Notes
from ...core.order import ObjectSnapshot, SceneSnapshot
from .left_out import note_refused, nothing_to_bake, unseen_reason
from .libraries import note_missing
from .lights import LightReader
from .objects import SceneReader
from .ties import tie


def snapshot_scene(
    context: bpy.types.Context,
    objects: Iterable[bpy.types.Object],
    needs_rest: bool = False,
    baked_layers: Sequence[str] = (),
    needs_light: bool = False,
    lightmap: LightmapSettings | None = None,
    depsgraph: bpy.types.Depsgraph | None = None,
) -> SceneSnapshot:
    """Read the objects to bake and everything that occludes them.

    Parameters
    ----------
    context : bpy.types.Context
        Its view layer is read.
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
    depsgraph : bpy.types.Depsgraph, optional
        What a frame handler was given, in which nothing may be evaluated. Otherwise the view layer is evaluated, in
        viewport mode.

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
    depsgraph = depsgraph or context.evaluated_depsgraph_get()
    wanted = {ob.session_uid: ob for ob in objects}
    lights = LightReader(notes) if needs_light else None
    reader = SceneReader(context, depsgraph, notes, wanted, baked_layers, needs_rest, lights, lightmap)
    found: dict[int, ObjectSnapshot] = {}
    occluders = []
    for instance in depsgraph.object_instances:
        occluders += reader.read_hair(instance)
        snapshot = reader.read(instance)
        if snapshot is None:
            continue
        uid = instance.object.original.session_uid
        if not instance.is_instance and uid in wanted:
            found[uid] = snapshot
        else:
            occluders.append(snapshot)
    reader.note_hidden()
    baked = [tie(ob, found[ob.session_uid], reader) for ob in objects if ob.session_uid in found]
    unseen = [(ob, unseen_reason(context, ob, depsgraph)) for ob in objects if ob.session_uid not in found]
    if not baked:
        raise nothing_to_bake(context, unseen, depsgraph)
    note_refused(unseen, notes)
    sources = reader.light_sources()
    return SceneSnapshot(baked, occluders, notes.lines(), sources)
