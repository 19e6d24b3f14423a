"""What all layers have in common: which names they may have, and that a failure leaves none behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ...core.errors import ObscuranceError
from . import records

MAX_NAME_BYTES = 60  # Blender keeps 67, and names of temporary layers add to it
PENDING = ".baking"  # suffix of a new layer until its values are in

# Blender gives these a meaning of its own; a colour there would destroy what they hold.
_BUILT_IN = {
    "position", "material_index", "sharp_edge", "sharp_face", "crease_edge", "crease_vert", "bevel_weight_edge",
    "bevel_weight_vert", "custom_normal", "freestyle_edge", "freestyle_face", "uv_seam", "velocity", "id", "radius",
}  # fmt: skip


class AttributeNameError(ObscuranceError):
    """The chosen name cannot hold a result on some object."""


def check_text(name: str) -> None:
    """Make sure that Blender takes a name for an attribute; raises AttributeNameError."""
    if not name.strip():
        raise AttributeNameError("the attribute needs a name: enter one, for example 'Obscurance'")
    if len(name.encode()) > MAX_NAME_BYTES:
        excess = len(name.encode()) - MAX_NAME_BYTES
        raise AttributeNameError(f"the attribute name '{name}' is {excess} bytes too long: choose a shorter one")
    if name.startswith(".") or name in _BUILT_IN:
        raise AttributeNameError(f"the attribute name '{name}' is reserved by Blender: choose another one")


def check_free(ob: bpy.types.Object, name: str, writer: str = "a bake", cure: str = "choose another name, or ") -> None:
    """Make sure that no layer of this name on an object, of whatever kind, is the user's.

    Parameters
    ----------
    ob : bpy.types.Object
    name : str
    writer : str
        Who would replace the layer, for the message.
    cure : str
        What to do beside renaming the layer, for the message.

    Raises
    ------
    AttributeNameError
        When there is a layer that no bake and no copy made, as far as `records` knows.
    """
    mesh = ob.data
    if name in ob.vertex_groups:
        kind = "vertex group"
    elif name not in mesh.attributes or records.is_own(mesh, name):
        return
    elif name in mesh.uv_layers:
        kind = "UV map"
    else:
        kind = "color attribute" if mesh.attributes[name].data_type.endswith("COLOR") else "attribute"
    raise AttributeNameError(
        f"object '{ob.name}' has a {kind} named '{name}', which {writer} must not replace: {cure}rename or remove the "
        f"{kind}"
    )


def made_layer(mesh: bpy.types.Mesh, name: str, kind: str, made: bpy.types.bpy_struct | None) -> str:
    """The name that Blender gave a new layer: numbered when a layer of the user's has it already.

    Raises
    ------
    AttributeNameError
        When Blender refused the layer.
    """
    if made is None:
        raise AttributeNameError(f"mesh '{mesh.name}' takes no {kind} named '{name}': choose another name")
    return made.name


@contextmanager
def undone_on_failure() -> Iterator[ExitStack]:
    """A stack of callbacks that run, the last one first, only when the block fails."""
    with ExitStack() as undo:
        yield undo
        undo.pop_all()
