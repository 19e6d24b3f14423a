"""Adds baked ambient light to materials by one node group in front of their output, and takes it out again.

The group adds the attribute as emission that only the camera sees, directly, mirrored or through glass: it must not
light other surfaces, whose ambient light is baked already. Materials that have no nodes, and slots without a material,
get a stand-in with nodes; the user's own data stays as it is, and comes back when the ambient light is removed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.errors import ObscuranceError
from . import color_attribute
from .baked_record import indirect_exposure
from .materials import DEFAULT_REFLECTANCE, node_tree_of
from .node_tree import BAKED_LIGHT
from .output_settings import OutputSettings

GROUP_NAME = "Obscurance Ambient"
_STRENGTH = "obscurance_strength"
_STANDS_FOR = "obscurance_stands_for"  # on a stand-in: the material that it replaces, or what was there instead of one
_EMPTY_SLOT, _NO_SLOT = "empty slot", "no slot"
_SEEING_RAYS = ("Is Camera Ray", "Is Glossy Ray", "Is Transmission Ray")
_SPACE = 200.0  # between nodes


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


def add_ambient(objects: Iterable[bpy.types.Object], output: OutputSettings) -> AmbientChange:
    """Make the materials of objects show their baked ambient light.

    Parameters
    ----------
    objects : iterable of bpy.types.Object
        Those whose baked attribute is missing, or holds anything but indirect light, are passed over.
    output : OutputSettings
        Where the result is.

    Raises
    ------
    ObscuranceError
        When no object has such an attribute.
    """
    name, domain = output.attribute_name, output.target.value
    layered = [ob for ob in objects if ob.type == "MESH" and color_attribute.is_color(ob.data, name, domain)]
    stops = {ob: indirect_exposure(ob.data, name) for ob in layered}
    baked = [ob for ob in layered if stops[ob] is not None]
    if not baked:
        what = "holds no ambient light" if layered else f"is on the {domain.lower()}s of no selected object"
        raise ObscuranceError(
            f"the attribute '{name}' {what}: set the quantity to Ambient Light and bake, with target and attribute as "
            "they are set now"
        )
    changed, shown = False, []
    notes: list[str] = []
    locked: set[str] = set()
    for ob in baked:
        changed |= _fill_slots(ob, notes)
        for material in {slot.material for slot in ob.material_slots if slot.material}:
            if material.is_editable:
                changed |= _insert(material, name, 2.0 ** -stops[ob])
            else:
                locked.add(material.name)
        if any(map(_ambient_nodes, (slot.material for slot in ob.material_slots))):
            shown.append(ob.name)
    if locked:
        notes.append(
            f"linked from a library, so they cannot show ambient light: {', '.join(map(repr, sorted(locked)))}; make "
            "these materials local (Object > Relations > Make Local)"
        )
    return AmbientChange(shown, changed, notes)


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
            if material.is_editable and _STANDS_FOR not in material:
                _extract(material)
        _empty_slots(ob)
    for material in [m for m in bpy.data.materials if _STANDS_FOR in m and not m.users]:
        bpy.data.materials.remove(material)
    for tree in [tree for tree in trees if not tree.users]:
        bpy.data.node_groups.remove(tree)
    return AmbientChange(changed, bool(changed))


def shows_ambient(ob: bpy.types.Object) -> bool:
    """Whether a material of the object shows baked ambient light."""
    return any(_ambient_nodes(slot.material) for slot in ob.material_slots)


def _group(attribute: str, strength: float) -> bpy.types.NodeTree:
    """The node group that adds an attribute, made where there is none."""
    for tree in bpy.data.node_groups:
        if tree.get(BAKED_LIGHT) == attribute and tree.get(_STRENGTH) == strength and tree.library is None:
            return tree
    tree = bpy.data.node_groups.new(GROUP_NAME, "ShaderNodeTree")
    tree[BAKED_LIGHT], tree[_STRENGTH] = attribute, strength
    tree.interface.new_socket("Shader", in_out="INPUT", socket_type="NodeSocketShader")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    columns = (
        ("NodeGroupInput", "ShaderNodeAttribute", "ShaderNodeLightPath"),
        ("ShaderNodeMath",),
        ("ShaderNodeMath",),
        ("ShaderNodeMath",),
        ("ShaderNodeEmission",),
        ("ShaderNodeAddShader",),
        ("NodeGroupOutput",),
    )
    made = [[tree.nodes.new(kind) for kind in column] for column in columns]
    for x, column in enumerate(made):
        for y, node in enumerate(column):
            node.location = (_SPACE * x, -_SPACE * y)
    (begin, baked, path), (either,), (any_of,), (scale,), (emission,), (add,), (end,) = made
    baked.attribute_type, baked.attribute_name = "GEOMETRY", attribute
    either.operation = any_of.operation = "MAXIMUM"
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = strength
    for source, target in (
        (path.outputs[_SEEING_RAYS[0]], either.inputs[0]),
        (path.outputs[_SEEING_RAYS[1]], either.inputs[1]),
        (either.outputs[0], any_of.inputs[0]),
        (path.outputs[_SEEING_RAYS[2]], any_of.inputs[1]),
        (any_of.outputs[0], scale.inputs[0]),
        (baked.outputs["Color"], emission.inputs["Color"]),
        (scale.outputs[0], emission.inputs["Strength"]),
        (begin.outputs[0], add.inputs[0]),
        (emission.outputs[0], add.inputs[1]),
        (add.outputs[0], end.inputs[0]),
    ):
        tree.links.new(source, target)
    return tree


def _insert(material: bpy.types.Material, attribute: str, strength: float) -> bool:
    """Put the group in front of every output that renders; whether anything was to be done."""
    tree, present = material.node_tree, _ambient_nodes(material)
    outputs = [] if present else _outputs(tree)
    if not present and not outputs:
        return False
    group = _group(attribute, strength)
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


def _fill_slots(ob: bpy.types.Object, notes: list[str]) -> bool:
    """Give stand-ins to slots whose surface has no nodes; whether there were any."""
    if not ob.material_slots:
        if not color_attribute.keeps_what_is_written(ob.data):
            return False
        ob.data.materials.append(_stand_in(_NO_SLOT))
        return True
    changed = False
    for slot in ob.material_slots:
        if slot.material is None or node_tree_of(slot.material) is None:
            stand_in = _stand_in(slot.material or _EMPTY_SLOT)
            slot.material = stand_in
            changed = True
            if slot.material != stand_in:
                notes.append(f"object '{ob.name}': a material slot is linked and cannot show ambient light")
    return changed


def _empty_slots(ob: bpy.types.Object) -> None:
    """Undo `_fill_slots`."""
    for index, slot in reversed(list(enumerate(ob.material_slots))):
        stands_for = slot.material.get(_STANDS_FOR) if slot.material else None
        if isinstance(stands_for, bpy.types.Material):
            slot.material = stands_for
        elif stands_for == _NO_SLOT:
            _drop_slot(ob.data, index)
        elif stands_for == _EMPTY_SLOT:
            slot.material = None


def _drop_slot(mesh: bpy.types.Mesh, index: int) -> None:
    """Remove a slot that was added to a mesh without any; the faces keep their material indices."""
    if len(mesh.materials) > 1:  # the user added more
        mesh.materials.pop(index=index)
        return
    values = np.zeros(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", values)
    mesh.materials.clear()  # takes the slot off the objects too, which removing it alone does not
    if values.any():
        mesh.polygons.foreach_set("material_index", values)


def _stand_in(original: bpy.types.Material | str) -> bpy.types.Material:
    """A material with nodes that looks like one without, or like none; one for each that it replaces."""
    for material in bpy.data.materials:
        if material.library is None and material.get(_STANDS_FOR) == original:
            return material
    if isinstance(original, bpy.types.Material):
        made, colour = original.copy(), tuple(original.diffuse_color)
    else:
        made, colour = bpy.data.materials.new("Obscurance Surface"), (*[DEFAULT_REFLECTANCE] * 3, 1.0)
    made[_STANDS_FOR] = original
    if bpy.app.version >= (5, 0, 0):  # there, a new material looks like none; before, none was a plain diffuse surface
        return made
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    end, shader = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    end.location = (2.0 * _SPACE, 0.0)
    shader.inputs["Color"].default_value = colour
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    return made
