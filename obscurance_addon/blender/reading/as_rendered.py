"""Shows a scene as renders do while it is read: what is hidden in the viewport alone, and modifiers as they render.

Blender gives scripts a depsgraph in viewport mode only. So what differs from renders is set as in renders, evaluated,
and set back, in no more than the time it takes to read the scene.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import bpy

from .visibility import rendered_objects

_FINENESS = {
    "SUBSURF": ("levels", "render_levels"),
    "MULTIRES": ("levels", "render_levels"),
    "OCEAN": ("viewport_resolution", "resolution"),
}


class Modifiers(enum.StrEnum):
    """Which modifiers, and which of their levels, are baked."""

    VIEWPORT = "VIEWPORT"
    RENDER = "RENDER"


class Setting(NamedTuple):
    """A property, and the value that it has where it is as in renders."""

    owner: bpy.types.bpy_struct
    name: str
    value: object

    def exchange(self) -> Setting:
        """Set the value; returns what sets the former one again."""
        former = self._replace(value=getattr(self.owner, self.name))
        setattr(self.owner, self.name, self.value)
        return former


@contextmanager
def as_rendered(context: bpy.types.Context, modifiers: Modifiers) -> Iterator[None]:
    """Show what renders while the block lasts, and modifiers as they render if asked to; main thread, in no handler."""
    layer = context.view_layer
    rendered = rendered_objects(layer.layer_collection)
    settings = list(_unhidden(context, rendered))
    hidden = [
        ob
        for ob in layer.objects
        if ob.hide_get(view_layer=layer) and not ob.hide_render and ob.session_uid in rendered
    ]
    if modifiers is Modifiers.RENDER:
        settings += _simplified(context.scene)
        settings += [setting for ob in _all_objects(context) for setting in render_settings(ob)]
    if not hidden and not settings:
        yield
        return
    with ExitStack() as undo:
        undo.callback(layer.update)
        for ob in hidden:
            ob.hide_set(False, view_layer=layer)
            undo.callback(ob.hide_set, True, view_layer=layer)
        for setting in settings:
            undo.callback(setting.exchange().exchange)
        layer.update()
        yield


def render_settings(ob: bpy.types.Object) -> Iterator[Setting]:
    """What makes an object look as it renders, where that differs from the viewport."""
    for modifier in ob.modifiers:
        if modifier.show_viewport != modifier.show_render:
            yield Setting(modifier, "show_viewport", modifier.show_render)
        if modifier.show_render and modifier.type in _FINENESS:
            yield from _differing(modifier, *_FINENESS[modifier.type])
        if modifier.show_render and modifier.type == "PARTICLE_SYSTEM":
            yield from _of_particles(modifier.particle_system.settings)
    if isinstance(ob.data, bpy.types.MetaBall):
        yield from _differing(ob.data, "resolution", "render_resolution")
    elif isinstance(ob.data, bpy.types.Curve):
        for name in ("resolution_u", "resolution_v"):
            if getattr(ob.data, f"render_{name}"):  # 0 is as in the viewport
                yield from _differing(ob.data, name, f"render_{name}")


def renders_otherwise(scene: bpy.types.Scene, ob: bpy.types.Object) -> bool:
    """Whether an object has another shape in renders than in the viewport; metaballs, always finer there, do not."""
    render = scene.render
    settings = [setting for setting in render_settings(ob) if not isinstance(setting.owner, bpy.types.MetaBall)]
    if not render.use_simplify:
        return bool(settings)
    if any(setting.owner.bl_rna.identifier not in {"SubsurfModifier", "MultiresModifier"} for setting in settings):
        return True
    most = render.simplify_subdivision, render.simplify_subdivision_render
    return any(
        modifier.show_viewport != modifier.show_render
        or min(modifier.levels, most[0]) != min(modifier.render_levels, most[1])
        for modifier in ob.modifiers
        if modifier.type in {"SUBSURF", "MULTIRES"} and (modifier.show_viewport or modifier.show_render)
    )


def _differing(owner: bpy.types.bpy_struct, name: str, in_renders: str) -> Iterator[Setting]:
    value = getattr(owner, in_renders)
    if getattr(owner, name) != value:
        yield Setting(owner, name, value)


def _of_particles(settings: bpy.types.ParticleSettings) -> Iterator[Setting]:
    """Of hair alone: others are simulated, and would have to be anew."""
    if settings.type == "HAIR":
        if settings.display_percentage != 100:
            yield Setting(settings, "display_percentage", 100)
        if settings.child_type != "NONE":
            yield from _differing(settings, "child_percent", "rendered_child_count")


def _simplified(scene: bpy.types.Scene) -> Iterator[Setting]:
    if scene.render.use_simplify:
        for name in ("simplify_subdivision", "simplify_child_particles"):
            yield from _differing(scene.render, name, f"{name}_render")


def _instanced(context: bpy.types.Context) -> set[bpy.types.Collection]:
    """All collections that objects of the view layer instance, and those in them."""
    found: set[bpy.types.Collection] = set()
    objects = list(context.view_layer.objects)
    while objects:
        ob = objects.pop()
        collection = ob.instance_collection if ob.instance_type == "COLLECTION" else None
        if collection is not None and collection not in found:
            found.update((collection, *collection.children_recursive))
            objects.extend(collection.all_objects)
    return found


def _all_objects(context: bpy.types.Context) -> set[bpy.types.Object]:
    return {*context.view_layer.objects, *(ob for one in _instanced(context) for ob in one.objects)}


def _unhidden(context: bpy.types.Context, rendered: set[int]) -> Iterator[Setting]:
    """What shows objects and collections that render, and are hidden in the viewport by more than their own eye."""
    instanced = _instanced(context)
    own = [ob for ob in context.view_layer.objects if ob.session_uid in rendered]
    for ob in {*own, *(ob for one in instanced for ob in one.objects)}:
        if ob.hide_viewport and not ob.hide_render:
            yield Setting(ob, "hide_viewport", False)
    layers = [context.view_layer.layer_collection]
    collections = set(instanced)
    while layers:
        layer = layers.pop()
        if layer.collection.hide_render:
            continue
        layers.extend(layer.children)
        collections.add(layer.collection)
        if layer.hide_viewport:
            yield Setting(layer, "hide_viewport", False)
    for collection in collections:
        if collection.hide_viewport and not collection.hide_render:
            yield Setting(collection, "hide_viewport", False)
