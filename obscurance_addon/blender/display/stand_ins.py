"""Materials with nodes that stand in for those without, and for none, until they are no longer needed.

What the user had is noted on the stand-in, so that it can be put back in any later session.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import bpy
import numpy as np

from ...core.notes import Notes, named
from ...core.shading import DEFAULT_REFLECTANCE
from ..materials import node_tree_of
from ..writing import keeps_what_is_written

SHOWN = "obscurance_shown"  # on materials with which the viewport shows a lightmap, and on the nodes added for it
MAKE_LOCAL = "make the mesh local (Object > Relations > Make Local > Selected Objects and Data)"

_STANDS_FOR = "obscurance_stands_for"  # on a stand-in: the material that it replaces, or what was there instead of one
_EMPTY_SLOT, _NO_SLOT = "empty slot", "no slot"
_SPACE = 200.0  # between nodes


def is_stand_in(material: bpy.types.Material) -> bool:
    """Whether a material takes the place of another, or of none."""
    return _STANDS_FOR in material


def fill_slots(ob: bpy.types.Object, what: str, notes: Notes) -> bool:
    """Give stand-ins to slots whose surface has no nodes; whether there were any.

    Parameters
    ----------
    ob : bpy.types.Object
    what : str
        What the slots shall show, for the notes.
    notes : Notes
        Hears of objects with a slot that cannot be changed.
    """
    if not ob.material_slots:
        if not keeps_what_is_written(ob.data):
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
                notes.add(f"material slots are linked and cannot show {what}", ob.name, cure=MAKE_LOCAL)
    return changed


def empty_slots(ob: bpy.types.Object, needed: Callable[[bpy.types.Material], bool]) -> None:
    """Undo `fill_slots`, but for stand-ins that are still needed."""
    for index, slot in reversed(list(enumerate(ob.material_slots))):
        if slot.material is None or not is_stand_in(slot.material) or needed(slot.material):
            continue
        stands_for = slot.material[_STANDS_FOR]
        if isinstance(stands_for, bpy.types.Material):
            slot.material = stands_for
        elif stands_for == _NO_SLOT:
            _drop_slot(ob.data, index)
        else:
            slot.material = None


def remove_unused() -> None:
    """Remove the stand-ins that no slot has any more."""
    for material in [m for m in bpy.data.materials if is_stand_in(m) and not m.users]:
        bpy.data.materials.remove(material)


def about_linked(names: Collection[str], what: str) -> list[str]:
    """A note about materials that cannot be changed, or none."""
    if not names:
        return []
    return [
        f"linked from a library, so they cannot show {what}: {named(names)}; make these materials local (Object > "
        "Relations > Make Local)"
    ]


def about_shared(names: Collection[str]) -> list[str]:
    """A note about materials that belong to objects with different results, or none."""
    if not names:
        return []
    return [
        f"shared by objects whose results differ, so they show that of the first: {named(names)}; give each object "
        "its own (Object > Relations > Make Single User)"
    ]


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
