"""What colour attributes and UV maps have in common: the names they may have, and that a failure leaves none behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ...core.errors import ObscuranceError

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


def name_in_use(ob: bpy.types.Object, name: str, kind: str, cure: str) -> AttributeNameError:
    """The error that a name belongs to something of the user's."""
    return AttributeNameError(
        f"object '{ob.name}' has a {kind} named '{name}', which a bake must not replace: choose another {cure}"
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
