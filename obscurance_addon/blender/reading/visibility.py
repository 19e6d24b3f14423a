"""Which objects show up in renders."""

from __future__ import annotations

from collections.abc import Callable

import bpy


def rendered_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Mesh objects with faces that are visible in renders, whether the viewport shows them or not."""
    rendered = rendered_objects(context.view_layer.layer_collection)
    return [
        ob
        for ob in context.view_layer.objects
        if ob.type == "MESH" and len(ob.data.polygons) and not ob.hide_render and ob.session_uid in rendered
    ]


def shown_objects(context: bpy.types.Context) -> set[int]:
    """Session uids of objects that neither their eye nor a collection hides in the viewport.

    An object may still be disabled there, which can be animated, so that only the evaluated one tells. In a file that
    Blender 5.3 has just loaded, `LayerCollection.is_visible` is False for every collection.
    """
    layer = context.view_layer
    hidden = {ob.session_uid for ob in layer.objects if ob.hide_get(view_layer=layer)}
    return (
        _objects_below(layer.layer_collection, lambda one: one.hide_viewport or one.collection.hide_viewport) - hidden
    )


def rendered_objects(layer_collection: bpy.types.LayerCollection) -> set[int]:
    """Session uids of objects in collections that are neither excluded nor disabled in renders."""
    return _objects_below(layer_collection, lambda one: one.collection.hide_render)


def _objects_below(
    layer_collection: bpy.types.LayerCollection, is_hidden: Callable[[bpy.types.LayerCollection], bool]
) -> set[int]:
    """Session uids of objects in collections that are not excluded, and with nothing hidden above them."""
    if is_hidden(layer_collection):
        return set()
    # A collection can be taken in again below one that is excluded.
    own = () if layer_collection.exclude else layer_collection.collection.objects
    return {ob.session_uid for ob in own}.union(*(_objects_below(one, is_hidden) for one in layer_collection.children))


def rendered_members(collection: bpy.types.Collection) -> set[int]:
    """Session uids of objects that an instance of a collection shows in renders."""
    uids = {ob.session_uid for ob in collection.objects}
    return uids.union(*(rendered_members(child) for child in collection.children if not child.hide_render))
