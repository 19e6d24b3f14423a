"""Which objects show up in renders."""

from __future__ import annotations

import bpy


def rendered_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Mesh objects with faces that are visible in the viewport and in renders."""
    rendered = rendered_objects(context.view_layer.layer_collection)
    return [
        ob
        for ob in context.view_layer.objects
        if ob.type == "MESH"
        and len(ob.data.polygons)
        and ob.visible_get(view_layer=context.view_layer)
        and not ob.hide_render
        and ob.session_uid in rendered
    ]


def rendered_objects(layer_collection: bpy.types.LayerCollection) -> set[int]:
    """Session uids of objects in collections that are neither excluded nor disabled in renders."""
    if layer_collection.collection.hide_render:
        return set()
    # A collection can be taken in again below one that is excluded.
    own = () if layer_collection.exclude else layer_collection.collection.objects
    return {ob.session_uid for ob in own}.union(*map(rendered_objects, layer_collection.children))


def rendered_members(collection: bpy.types.Collection) -> set[int]:
    """Session uids of objects that an instance of a collection shows in renders."""
    uids = {ob.session_uid for ob in collection.objects}
    return uids.union(*(rendered_members(child) for child in collection.children if not child.hide_render))
