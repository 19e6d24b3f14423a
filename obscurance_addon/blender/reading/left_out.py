"""Why objects cannot be baked, and what to do about it, in the same words wherever it is said."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import bpy

from ...core.errors import GeometryError
from ...core.notes import Notes
from .visibility import rendered_objects

_NO_FACES_OF_THEIR_OWN = "without faces of their own, only those that modifiers make"


class Reason(NamedTuple):
    """Why an object cannot be baked, and the cure; `what` reads well before a colon and the object's name."""

    what: str
    cure: str


Refused = Sequence[tuple[bpy.types.Object, Reason]]

_CONVERT = Reason("not a mesh", "convert what is to be baked to a mesh (Object > Convert > Mesh)")
_VOLUME = Reason("volumes and points, which have no faces", "make meshes of them (by Geometry Nodes, then apply)")
_COLLECTION = Reason("instances of collections", "make them real (Object > Apply > Make Instances Real)")
_OTHER = Reason("not a mesh", "choose mesh objects")
_APPLY = Reason(_NO_FACES_OF_THEIR_OWN, "apply the modifiers (Object > Convert > Mesh)")
_FACELESS = Reason("without faces", "give them faces (in Edit Mode, Face > Fill)")
_EXCLUDED = Reason("in collections excluded from the view layer", "tick the collection in the Outliner")
_HIDE_RENDER = Reason("hidden from renders", "switch on their camera icon in the Outliner")
_COLLECTION_RENDER = Reason(
    "in collections hidden from renders", "switch on the camera icon of the collection in the Outliner"
)
_HIDE_VIEWPORT = Reason("disabled in viewports", "switch on their monitor icon in the Outliner")
_HIDDEN = Reason("hidden in the viewport", "show them (Object > Show/Hide > Show Hidden Objects)")
_COLLECTION_VIEW = Reason(
    "in collections hidden in the viewport", "switch on the eye and monitor icons of the collection in the Outliner"
)
_INSTANCER = Reason(
    "hidden as instancers", "tick Object Properties > Instancing > Show Instancer for viewport and render"
)
_INSTANCES = Reason(
    "left with instances, but without faces, by modifiers",
    "end the node tree with Realize Instances, and apply the modifier",
)
_GONE = Reason("left without faces by modifiers", "change or disable the modifier")


def shape_reason(ob: bpy.types.Object) -> Reason | None:
    """Why an object has no mesh that values can be written to, whether it is visible or not; None if it has one."""
    if ob.type == "MESH":
        if len(ob.data.polygons):
            return None
        return _APPLY if any(modifier.show_viewport for modifier in ob.modifiers) else _FACELESS
    if ob.type in {"CURVE", "SURFACE", "META", "FONT", "CURVES"}:
        return _CONVERT
    if ob.type in {"VOLUME", "POINTCLOUD"}:
        return _VOLUME
    return _COLLECTION if _instances_meshes(ob) else _OTHER


def visibility_reason(context: bpy.types.Context, ob: bpy.types.Object) -> Reason | None:
    """Why an object does not show up in renders of the view layer, None if it does."""
    layer = context.view_layer
    if layer.objects.get(ob.name) != ob:
        return _EXCLUDED
    if ob.hide_render:
        return _HIDE_RENDER
    if ob.session_uid not in rendered_objects(layer.layer_collection):
        return _COLLECTION_RENDER
    if not ob.visible_get(view_layer=layer):
        if ob.hide_viewport:
            return _HIDE_VIEWPORT
        return _HIDDEN if ob.hide_get(view_layer=layer) else _COLLECTION_VIEW
    if ob.is_instancer and not (ob.show_instancer_for_render and ob.show_instancer_for_viewport):
        return _INSTANCER
    return None


def unseen_reason(context: bpy.types.Context, ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Reason:
    """Why an object whose mesh has faces was not seen in the evaluated scene."""
    if reason := visibility_reason(context, ob):
        return reason
    for one in depsgraph.object_instances:
        if one.is_instance and one.parent.original == ob and isinstance(one.object.data, bpy.types.Mesh):
            return _INSTANCES
    return _GONE


def nothing_to_bake(
    context: bpy.types.Context, refused: Refused = (), depsgraph: bpy.types.Depsgraph | None = None
) -> GeometryError:
    """The error that says why nothing can be baked: of the objects refused, or of all those of the scene.

    `depsgraph` is what a frame handler was given, in which nothing may be evaluated.
    """
    depsgraph = depsgraph or context.evaluated_depsgraph_get()
    scene, notes = context.scene, Notes()
    for ob, reason in refused or _of_scene(context, depsgraph):
        notes.add(reason.what, ob.name, cure=reason.cure)
    if not refused:
        others = [other.name for other in bpy.data.scenes if other != scene and any(map(_has_faces, other.objects))]
        if others:
            notes.add("meshes in other scenes", *others, cure="bake one of these scenes (--scene), or switch to it")
    if notes:
        return GeometryError(f"there is nothing to bake in scene '{scene.name}': {'; '.join(notes.lines())}")
    return GeometryError(
        f"there is nothing to bake: no mesh object with faces in scene '{scene.name}' was chosen; choose or add one"
    )


def note_refused(refused: Refused, notes: Notes) -> None:
    """Say of objects beside others that nothing was baked onto them."""
    for ob, reason in refused:
        notes.add(f"{reason.what}, so nothing was baked onto", ob.name, cure=reason.cure)


def _of_scene(context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> list[tuple[bpy.types.Object, Reason]]:
    """Every object of the scene that has a surface, or might have one, and why it cannot be baked."""
    found = []
    for ob in context.scene.objects:
        reason = shape_reason(ob) or unseen_reason(context, ob, depsgraph)
        if reason is _GONE and len(ob.evaluated_get(depsgraph).data.polygons):
            continue  # it could be baked, if it were chosen
        if reason is not _OTHER:  # lamps, cameras and the like
            found.append((ob, reason))
    return found


def _has_faces(ob: bpy.types.Object) -> bool:
    return ob.type == "MESH" and len(ob.data.polygons) > 0


def _instances_meshes(ob: bpy.types.Object) -> bool:
    return ob.instance_type == "COLLECTION" and ob.instance_collection is not None
