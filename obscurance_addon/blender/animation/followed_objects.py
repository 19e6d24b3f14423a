"""Which objects are followed through time, and which of them are likely to change."""

from __future__ import annotations

from collections.abc import Hashable

import bpy

from ..reading import rendered_meshes
from ..writing import is_own_color


def preview_objects(context: bpy.types.Context, attribute_name: str) -> list[bpy.types.Object]:
    """The objects that Live Preview follows: those baked under this name, or if none is, all that may ever render."""
    meshes = [ob for ob in context.view_layer.objects if ob.type == "MESH" and len(ob.data.polygons)]
    baked = [ob for ob in meshes if is_own_color(ob.data, attribute_name)]
    return baked or objects_over_time(context)


def objects_over_time(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Mesh objects with faces that render now, or are animated, so that they may render later."""
    layer = context.view_layer
    now = {ob.session_uid for ob in rendered_meshes(context) if ob.visible_get(view_layer=layer)}
    return [
        ob
        for ob in layer.objects
        if ob.type == "MESH" and len(ob.data.polygons) and (ob.session_uid in now or is_animated(ob))
    ]


def likely_movers(context: bpy.types.Context) -> set[Hashable]:
    """Session uids of objects that are animated in some way, which spares them being found out later."""
    return {ob.session_uid for ob in context.view_layer.objects if is_animated(ob)}


def is_animated(ob: bpy.types.Object) -> bool:
    """Whether an object looks like one that will move, deform, or come and go."""
    if ob.animation_data is not None or ob.constraints or ob.rigid_body is not None:
        return True
    data = ob.data
    keys = getattr(data, "shape_keys", None)
    if getattr(data, "animation_data", None) is not None or (keys is not None and keys.animation_data is not None):
        return True
    if any(modifier.type == "ARMATURE" for modifier in ob.modifiers):
        return True
    return ob.parent is not None and is_animated(ob.parent)
