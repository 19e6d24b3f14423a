"""Adds baked ambient light to materials by one node group in front of their output, and takes it out again.

The group adds the attribute or lightmap as emission that only the camera sees, directly, mirrored or through glass: it
must not light other surfaces, whose ambient light is baked already. Materials that have no nodes, and slots without a
material, get a stand-in with nodes; the user's own data stays as it is, and comes back when the light is removed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import bpy

from ...core.errors import ObscuranceError
from ...core.notes import Notes
from ...core.order import OutputSettings, Target
from ..marks import BAKED_LIGHT
from ..writing import indirect_exposure, is_color, is_own_color, lightmap_of
from .stand_ins import SHOWN, about_linked, about_shared, empty_slots, fill_slots, is_stand_in, remove_unused

GROUP_NAME = "Obscurance Ambient"
_STRENGTH, _IMAGE, _UV_MAP = "obscurance_strength", "obscurance_image", "obscurance_uv_map"  # beside BAKED_LIGHT
_WHAT = "ambient light"  # in notes
_SEEING_RAYS = ("Is Camera Ray", "Is Glossy Ray", "Is Transmission Ray")
_SPACE = 200.0  # between nodes
_SOURCE_ROW = 3  # where the nodes that read what is baked begin, below the others


@dataclass(frozen=True)
class AmbientChange:
    """What was done.

    Attributes
    ----------
    objects : list of str
        Objects whose materials show, or no longer show, ambient light.
    changed : bool
        False when all was so already.
    notes : list of str
    """

    objects: list[str] = field(default_factory=list)
    changed: bool = False
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Baked:
    """Where baked light is: in an attribute, or in an image by way of a UV map; and what to multiply it by."""

    name: str
    strength: float
    image: bpy.types.Image | None = None
    uv_map: str = ""

    def note_on(self, tree: bpy.types.NodeTree) -> None:
        """Write it on the group that shows it."""
        tree[BAKED_LIGHT], tree[_STRENGTH] = self.name, self.strength
        if self.image is not None:
            tree[_IMAGE], tree[_UV_MAP] = self.image, self.uv_map

    def is_noted_on(self, tree: bpy.types.NodeTree) -> bool:
        """Whether a group shows this very light."""
        noted = tree.get(BAKED_LIGHT), tree.get(_STRENGTH), tree.get(_IMAGE), tree.get(_UV_MAP, "")
        return noted == (self.name, self.strength, self.image, self.uv_map)


def add_ambient(objects: Iterable[bpy.types.Object], output: OutputSettings) -> AmbientChange:
    """Make the materials of objects show their baked ambient light.

    Parameters
    ----------
    objects : iterable of bpy.types.Object
        Those whose baked attribute or lightmap is missing, or holds anything but indirect light, are passed over.
    output : OutputSettings
        Where the result is.

    Raises
    ------
    ObscuranceError
        When no object has such an attribute or lightmap.
    """
    baked = _what_is_baked(objects, output)
    changed, shown, notes = False, [], Notes()
    chosen: dict[bpy.types.Material, _Baked] = {}
    locked: set[str] = set()
    shared: set[str] = set()
    for ob, light in baked.items():
        changed |= fill_slots(ob, _WHAT, notes)
        for material in {slot.material for slot in ob.material_slots if slot.material}:
            if not material.is_editable:
                locked.add(material.name)
            elif chosen.setdefault(material, light) == light:
                changed |= _insert(material, light)
            else:
                shared.add(material.name)
        if shows_ambient(ob):
            shown.append(ob.name)
    return AmbientChange(shown, changed, [*notes.lines(), *about_linked(locked, _WHAT), *about_shared(shared)])


def remove_ambient(objects: Iterable[bpy.types.Object]) -> AmbientChange:
    """Take the ambient light out of the materials of objects, as if it had never been there."""
    changed = []
    trees: set[bpy.types.NodeTree] = set()
    for ob in [ob for ob in objects if ob.type == "MESH"]:
        materials = {slot.material for slot in ob.material_slots if slot.material}
        trees.update(node.node_tree for material in materials for node in _ambient_nodes(material))
        if shows_ambient(ob):
            changed.append(ob.name)
        for material in materials:
            if material.is_editable and not is_stand_in(material):
                _extract(material)
        empty_slots(ob, needed=_only_shows_lightmap)
    remove_unused()
    for tree in [tree for tree in trees if not tree.users]:
        bpy.data.node_groups.remove(tree)
    return AmbientChange(changed, bool(changed))


def shows_ambient(ob: bpy.types.Object) -> bool:
    """Whether a material of the object shows baked ambient light."""
    return any(_ambient_nodes(slot.material) for slot in ob.material_slots)


def has_ambient(material: bpy.types.Material) -> bool:
    """Whether a material shows baked ambient light."""
    return bool(_ambient_nodes(material))


def _what_is_baked(objects: Iterable[bpy.types.Object], output: OutputSettings) -> dict[bpy.types.Object, _Baked]:
    """The objects that have indirect light where the output is; raises ObscuranceError when there are none."""
    name, domain = output.attribute_name, output.target.value
    to_lightmap = output.target is Target.LIGHTMAP
    found, others = {}, False
    for ob in [ob for ob in objects if ob.type == "MESH"]:
        lightmap = lightmap_of(ob.data, name) if to_lightmap else None
        if lightmap is None and (to_lightmap or not is_color(ob.data, name, domain)):
            continue
        stops = indirect_exposure(ob.data, name)
        if stops is None or not (to_lightmap or is_own_color(ob.data, name)):
            others = True
        else:
            found[ob] = _Baked(name, 2.0**-stops, *(lightmap or ()))
    if not found:
        if others:
            what = "holds no ambient light"
        else:
            what = (
                "belongs to no selected object" if to_lightmap else f"is on the {domain.lower()}s of no selected object"
            )
        raise ObscuranceError(
            f"the {'lightmap' if to_lightmap else 'attribute'} '{name}' {what}: set the quantity to Ambient Light and "
            f"bake, with target and {'name' if to_lightmap else 'attribute'} as they are set now"
        )
    return found


def _group(light: _Baked) -> bpy.types.NodeTree:
    """The node group that adds baked light, made where there is none."""
    for tree in bpy.data.node_groups:
        if light.is_noted_on(tree) and tree.library is None:
            return tree
    tree = bpy.data.node_groups.new(GROUP_NAME, "ShaderNodeTree")
    light.note_on(tree)
    tree.interface.new_socket("Shader", in_out="INPUT", socket_type="NodeSocketShader")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    columns = (
        ("NodeGroupInput", "ShaderNodeLightPath"),
        ("ShaderNodeMath",),
        ("ShaderNodeMath",),
        ("ShaderNodeMath",),
        ("ShaderNodeEmission",),
        ("ShaderNodeAddShader",),
        ("NodeGroupOutput",),
    )
    made = [[_node(tree, kind, x, y) for y, kind in enumerate(column)] for x, column in enumerate(columns)]
    (begin, path), (either,), (any_of,), (scale,), (emission,), (add,), (end,) = made
    either.operation = any_of.operation = "MAXIMUM"
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = light.strength
    color = _lightmap_color(tree, light) if light.image else _attribute_color(tree, light)
    for source, target in (
        (path.outputs[_SEEING_RAYS[0]], either.inputs[0]),
        (path.outputs[_SEEING_RAYS[1]], either.inputs[1]),
        (either.outputs[0], any_of.inputs[0]),
        (path.outputs[_SEEING_RAYS[2]], any_of.inputs[1]),
        (any_of.outputs[0], scale.inputs[0]),
        (color, emission.inputs["Color"]),
        (scale.outputs[0], emission.inputs["Strength"]),
        (begin.outputs[0], add.inputs[0]),
        (emission.outputs[0], add.inputs[1]),
        (add.outputs[0], end.inputs[0]),
    ):
        tree.links.new(source, target)
    return tree


def _attribute_color(tree: bpy.types.NodeTree, light: _Baked) -> bpy.types.NodeSocket:
    baked = _node(tree, "ShaderNodeAttribute", 0, _SOURCE_ROW)
    baked.attribute_type, baked.attribute_name = "GEOMETRY", light.name
    return baked.outputs["Color"]


def _lightmap_color(tree: bpy.types.NodeTree, light: _Baked) -> bpy.types.NodeSocket:
    """What the image holds; black on other objects, which have no such UV map and would all show one corner of it."""
    uv = _node(tree, "ShaderNodeUVMap", 0, _SOURCE_ROW)
    image = _node(tree, "ShaderNodeTexImage", 1, _SOURCE_ROW)
    length, is_there = (
        _node(tree, "ShaderNodeVectorMath", 1, _SOURCE_ROW + 1),
        _node(tree, "ShaderNodeMath", 2, _SOURCE_ROW + 1),
    )
    color = _node(tree, "ShaderNodeVectorMath", 3, _SOURCE_ROW)
    uv.uv_map, image.image = light.uv_map, light.image
    image.interpolation, image.extension = "Linear", "EXTEND"  # a page that repeats would bleed over its borders
    length.operation, is_there.operation, color.operation = "LENGTH", "GREATER_THAN", "SCALE"
    is_there.inputs[1].default_value = 0.0  # a missing UV map reads as 0
    for source, target in (
        (uv.outputs[0], image.inputs["Vector"]),
        (uv.outputs[0], length.inputs[0]),
        (length.outputs["Value"], is_there.inputs[0]),
        (image.outputs["Color"], color.inputs[0]),
        (is_there.outputs[0], color.inputs["Scale"]),
    ):
        tree.links.new(source, target)
    return color.outputs["Vector"]


def _node(tree: bpy.types.NodeTree, kind: str, column: int, row: int) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    node.location = (_SPACE * column, -_SPACE * row)
    return node


def _insert(material: bpy.types.Material, light: _Baked) -> bool:
    """Put the group in front of every output that renders; whether anything was to be done."""
    tree, present = material.node_tree, _ambient_nodes(material)
    outputs = [] if present else _outputs(tree)
    if not present and not outputs:
        return False
    group = _group(light)
    changed = bool(outputs)
    for node in present:  # wherever the user may have moved it
        former = node.node_tree
        if former != group:
            node.node_tree = group
            changed = True
            if not former.users:
                bpy.data.node_groups.remove(former)
    for end in outputs:
        surface = end.inputs["Surface"]
        link = surface.links[0] if surface.links else None
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree, node.name, node.label = group, GROUP_NAME, GROUP_NAME
        node.location = (end.location.x - 0.5 * _SPACE, end.location.y + _SPACE)
        node.select = False
        if link is not None:
            _copy_link(tree, link, link.from_socket, node.inputs[0])
        tree.links.new(node.outputs[0], surface)
    return changed


def _only_shows_lightmap(material: bpy.types.Material) -> bool:
    return SHOWN in material and not has_ambient(material)


def _extract(material: bpy.types.Material) -> None:
    """Take the groups out and link what they stood between."""
    tree = material.node_tree
    for node in _ambient_nodes(material):
        before = node.inputs[0].links[0] if node.inputs[0].links else None
        targets = [link.to_socket for link in node.outputs[0].links]
        if before is not None:
            for target in targets:
                _copy_link(tree, before, before.from_socket, target)
        tree.nodes.remove(node)


def _copy_link(
    tree: bpy.types.NodeTree, link: bpy.types.NodeLink, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket
) -> None:
    muted = link.is_muted
    tree.links.new(source, target).is_muted = muted


def _outputs(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The output nodes that Cycles and EEVEE use."""
    found = (tree.get_output_node(target) for target in ("ALL", "CYCLES", "EEVEE"))
    return list({node.name: node for node in found if node is not None}.values())


def _is_ambient(node: bpy.types.Node) -> bool:
    return node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None and BAKED_LIGHT in node.node_tree


def _ambient_nodes(material: bpy.types.Material | None) -> list[bpy.types.Node]:
    tree = material.node_tree if material else None
    return [node for node in tree.nodes if _is_ambient(node)] if tree else []
