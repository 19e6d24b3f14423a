"""Makes a 3D view show the baked colours and nothing else, and gives back what it showed before."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from . import color_attribute
from .output_settings import OutputSettings

_RESULT = {"type": "SOLID", "light": "FLAT", "color_type": "VERTEX"}
_USUAL = {"type": "SOLID", "light": "STUDIO", "color_type": "MATERIAL"}  # Blender's own, where nothing is remembered

_before: dict[int, dict[str, str]] = {}  # what each view showed, by its address, for as long as the file is open


def shows_result(space: bpy.types.SpaceView3D) -> bool:
    """Whether a view shows the active colours, unlit."""
    return all(getattr(space.shading, name) == value for name, value in _RESULT.items())


def show_result(space: bpy.types.SpaceView3D) -> None:
    """Show the active colours."""
    _before[space.as_pointer()] = {name: getattr(space.shading, name) for name in _RESULT}
    _set(space, _RESULT)


def hide_result(space: bpy.types.SpaceView3D) -> None:
    """Show what the view showed before `show_result`."""
    _set(space, _before.pop(space.as_pointer(), _USUAL))


def forget_views() -> None:
    """Addresses mean nothing once another file is open."""
    _before.clear()


def _set(space: bpy.types.SpaceView3D, values: dict[str, str]) -> None:
    space.shading.type = "SOLID"  # the others can only be set there
    for name, value in reversed(values.items()):
        setattr(space.shading, name, value)


def activate_result(objects: Iterable[bpy.types.Object], output: OutputSettings) -> tuple[int, bool]:
    """Make the baked layer the active colour of all meshes that have one.

    Returns
    -------
    shown : int
        Number of meshes that have a layer which a viewport can show.
    changed : bool
        Whether another colour was active on any of them.
    """
    meshes = {ob.data.session_uid: ob.data for ob in objects if ob.type == "MESH"}.values()
    shown, changed = 0, False
    for mesh in meshes:
        name, domain = output.layers()[0]
        if domain == "FACE" or not color_attribute.is_color(mesh, name, domain):
            continue
        shown += 1
        if mesh.attributes.active_color_name != name and mesh.library is None:
            color_attribute.make_active(mesh, name)
            changed = True
    return shown, changed
