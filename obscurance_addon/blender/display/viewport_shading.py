"""Makes a 3D view show the baked result and nothing else, and gives back what it showed before.

Colours are shown as the active colour attribute. A lightmap is shown by what "Texture" in Solid shading shows: the
image of the Image Texture node of each material that has `show_texture`, over the active UV map. Such a node is added
to the materials, linked to nothing; what it displaces is noted in the file, so that any later session can put it back.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import bpy

from ...core.notes import Notes
from ...core.order import OutputSettings, Target
from ..materials import node_tree_of
from ..writing import color_attribute, lightmap_of
from .ambient_nodes import has_ambient
from .stand_ins import MAKE_LOCAL, SHOWN, about_linked, about_shared, empty_slots, fill_slots, remove_unused

_COLORS = {"type": "SOLID", "light": "FLAT", "color_type": "VERTEX"}
_TEXTURES = _COLORS | {"color_type": "TEXTURE"}
_USUAL = {"type": "SOLID", "light": "STUDIO", "color_type": "MATERIAL"}  # Blender's own, where nothing is remembered

_BEFORE = "obscurance_before"  # on nodes that were shown before, and on meshes: the UV map that was active
_NODE_NAME = "Obscurance Result"
_SPACE = 300.0  # between the user's nodes and ours

_before: dict[int, dict[str, str]] = {}  # what each view showed, by its address, for as long as the file is open


@dataclass(frozen=True)
class ShownResult:
    """What a view can show now.

    Attributes
    ----------
    count : int
        Number of meshes or, for a lightmap, of objects that show their result.
    changed : bool
        Whether anything in the file had to be changed for it.
    notes : list of str
    """

    count: int
    changed: bool
    notes: list[str] = field(default_factory=list)


def shows_result(space: bpy.types.SpaceView3D) -> bool:
    """Whether a view shows the active colours, or the lightmaps in the materials, unlit."""
    return _has(space, _COLORS) or (_has(space, _TEXTURES) and lightmaps_are_shown())


def show_result(space: bpy.types.SpaceView3D, target: Target) -> None:
    """Show what `activate_result` has made active."""
    key = space.as_pointer()
    if key not in _before or not (_has(space, _COLORS) or _has(space, _TEXTURES)):
        _before[key] = {name: getattr(space.shading, name) for name in _USUAL}
    _set(space, _TEXTURES if target is Target.LIGHTMAP else _COLORS)


def hide_result(space: bpy.types.SpaceView3D) -> bool:
    """Show what the view showed before `show_result`; whether anything in the file was changed for it."""
    _set(space, _before.pop(space.as_pointer(), _USUAL))
    if not lightmaps_are_shown() or any(_has(other, _TEXTURES) for other in _other_views()):
        return False
    _take_back()
    return True


def lightmaps_are_shown() -> bool:
    """Whether materials have nodes for showing lightmaps."""
    return any(map(_is_shown, bpy.data.materials))


def forget_views() -> None:
    """Addresses mean nothing once another file is open."""
    _before.clear()


def _other_views() -> list[bpy.types.SpaceView3D]:
    """The views in which `show_result` was called, and `hide_result` not."""
    spaces = (space for screen in bpy.data.screens for area in screen.areas for space in area.spaces)
    return [space for space in spaces if space.type == "VIEW_3D" and space.as_pointer() in _before]


def _has(space: bpy.types.SpaceView3D, look: dict[str, str]) -> bool:
    return all(getattr(space.shading, name) == value for name, value in look.items())


def _set(space: bpy.types.SpaceView3D, values: dict[str, str]) -> None:
    space.shading.type = "SOLID"  # the others can only be set there
    for name, value in reversed(values.items()):
        setattr(space.shading, name, value)


def activate_result(objects: Iterable[bpy.types.Object], output: OutputSettings) -> ShownResult:
    """Make the baked layer the active colour of all meshes that have one, or let their materials show the lightmap."""
    meshes = [ob for ob in objects if ob.type == "MESH"]
    if output.target is Target.LIGHTMAP:
        return _activate_lightmaps(meshes, output.attribute_name)
    return _activate_colors({ob.data.session_uid: ob.data for ob in meshes}.values(), output)


def _activate_colors(meshes: Iterable[bpy.types.Mesh], output: OutputSettings) -> ShownResult:
    shown, changed = 0, False
    for mesh in meshes:
        name, domain = output.layers()[0]
        if domain == "FACE" or not color_attribute.is_color(mesh, name, domain):
            continue
        shown += 1
        if mesh.attributes.active_color_name != name and mesh.library is None:
            color_attribute.make_active(mesh, name)
            changed = True
    return ShownResult(shown, changed)


def _activate_lightmaps(objects: list[bpy.types.Object], name: str) -> ShownResult:
    shown, changed = 0, False
    notes = Notes()
    images: dict[bpy.types.Material, bpy.types.Image] = {}
    locked: set[str] = set()
    shared: set[str] = set()
    for ob in objects:
        lightmap = lightmap_of(ob.data, name)
        if lightmap is None:
            continue
        image, uv_map = lightmap
        other_map = ob.data.uv_layers.active.name != uv_map
        if other_map and not color_attribute.keeps_what_is_written(ob.data):
            notes.add(f"their mesh is linked, with another UV map active than '{uv_map}'", ob.name, cure=MAKE_LOCAL)
            continue
        changed |= fill_slots(ob, "the lightmap", notes)
        for material in {slot.material for slot in ob.material_slots if slot.material}:
            if not material.is_editable:
                locked.add(material.name)
            elif node_tree_of(material) is None:  # in a linked slot, of which there is a note
                continue
            elif images.setdefault(material, image) == image:
                changed |= _show_in(material, image)
            else:
                shared.add(material.name)
        if not any(_is_shown(slot.material) for slot in ob.material_slots):
            continue
        shown += 1
        if other_map:
            ob.data[_BEFORE] = ob.data.get(_BEFORE, ob.data.uv_layers.active.name)
            ob.data.uv_layers.active = ob.data.uv_layers[uv_map]
            changed = True
    return ShownResult(shown, changed, [*notes.lines(), *about_linked(locked, "the lightmap"), *about_shared(shared)])


def _show_in(material: bpy.types.Material, image: bpy.types.Image) -> bool:
    """Let a material show an image in the viewport; whether anything was to be done."""
    tree = material.node_tree
    node = next((node for node in tree.nodes if SHOWN in node), None)
    if node is not None and node.image == image and node.show_texture:
        return False
    if node is None:
        corner = (
            min((n.location.x for n in tree.nodes), default=0.0),
            max((n.location.y for n in tree.nodes), default=0),
        )
        node = tree.nodes.new("ShaderNodeTexImage")
        node.name = node.label = _NODE_NAME
        node.location = (corner[0] - _SPACE, corner[1])
        node.select = False
        node[SHOWN] = material[SHOWN] = True
    for other in tree.nodes:
        if other.show_texture and other != node:
            other[_BEFORE] = True
            other.show_texture = False
    node.image, node.show_texture = image, True
    material.update_tag()
    return True


def _is_shown(material: bpy.types.Material | None) -> bool:
    """Whether a material shows a lightmap; those of libraries are as they were saved, and no matter of ours."""
    return material is not None and SHOWN in material and material.is_editable


def _take_back() -> None:
    """Undo what `activate_result` did for lightmaps, in all of the file."""
    for material in filter(_is_shown, bpy.data.materials):
        nodes = material.node_tree.nodes
        for node in [node for node in nodes if SHOWN in node]:
            nodes.remove(node)
        for node in nodes:
            if _BEFORE in node:
                node.show_texture = True
                del node[_BEFORE]
        del material[SHOWN]
        material.update_tag()
    for ob in bpy.data.objects:
        if ob.type == "MESH":
            empty_slots(ob, needed=has_ambient)
    remove_unused()
    for mesh in bpy.data.meshes:
        if _BEFORE in mesh and mesh.library is None:
            if mesh[_BEFORE] in mesh.uv_layers:
                mesh.uv_layers.active = mesh.uv_layers[mesh[_BEFORE]]
            del mesh[_BEFORE]
