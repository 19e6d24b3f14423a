"""Writes colours into mesh attributes, without touching anything else of the user's.

Facts that this file works around: the first colour attribute made becomes active and default by itself; the active
attribute is a position in the list of all of them, so that it changes when a layer is added before it; a Python
reference to an attribute may mean another one after the next is added; `attributes.new` returns None for names it
cannot use.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from . import records
from .layers import PENDING, check_free, check_text, made_layer


def check_name(ob: bpy.types.Object, name: str) -> None:
    """Make sure that a colour attribute of this name can be written on an object.

    Raises
    ------
    AttributeNameError
        When the name is empty, too long, reserved, or that of a layer of the user's.
    """
    check_text(name)
    check_free(ob, name, cure="choose another attribute name, or ")


def prepare(mesh: bpy.types.Mesh, name: str, domain: str, data_type: str = "FLOAT_COLOR") -> str:
    """Make room for a colour attribute and return the name of the layer to fill, a new one if need be.

    A layer of this name must be ours (`check_free`). Nothing that exists is changed yet, so that a failure on another
    mesh can be undone by `discard`.

    Raises
    ------
    AttributeNameError
        When Blender refuses the layer.
    """
    if is_color(mesh, name, domain, data_type):
        return name
    with choices_kept(mesh):
        made = mesh.attributes.new(name + PENDING, data_type, domain)
        return made_layer(mesh, name, "attribute", made)


def discard(mesh: bpy.types.Mesh, name: str, layer: str) -> None:
    """Remove the layer that `prepare` made for this name, unless it was there already."""
    if layer != name:
        with choices_kept(mesh):
            mesh.attributes.remove(mesh.attributes[layer])


def fill(mesh: bpy.types.Mesh, layer: str, name: str, values: np.ndarray) -> str | None:
    """Write values into a prepared layer, give it its name, and note that it is ours.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    layer : str
        What `prepare` returned.
    name : str
        The name to end up with; a layer of ours of that name but another kind is removed.
    values : ndarray, (n, 3) float
        Linear colours, finite.

    Returns
    -------
    str or None
        What was replaced, in words.
    """
    records.adopt(mesh)
    rgba = np.ones((len(values), 4), np.float32)
    rgba[:, :3] = values
    mesh.attributes[layer].data.foreach_set("color", rgba.ravel())
    replaced = None
    if layer != name:
        with choices_kept(mesh):
            if name in mesh.attributes:
                replaced = _remove(mesh, name)
            mesh.attributes[layer].name = name
    records.claim(mesh, name)
    mesh.update()
    return replaced


def _remove(mesh: bpy.types.Mesh, name: str) -> str:
    """Remove an attribute; what it was, in words."""
    if name in mesh.uv_layers:
        mesh.uv_layers.remove(mesh.uv_layers[name])
        return f"UV map '{name}' of mesh '{mesh.name}', which belonged to a lightmap, was replaced"
    old = mesh.attributes[name]
    kind = f"{old.data_type}, {old.domain}"
    mesh.attributes.remove(old)
    return f"attribute '{name}' of mesh '{mesh.name}' ({kind}) was replaced"


def make_active(mesh: bpy.types.Mesh, name: str) -> None:
    """Show this colour in the viewport and in painting; the default for renders changes only if there was none."""
    if not mesh.attributes.default_color_name or mesh.attributes.default_color_name not in mesh.attributes:
        mesh.attributes.default_color_name = name
    mesh.attributes.active_color_name = name


@contextmanager
def choices_kept(mesh: bpy.types.Mesh) -> Iterator[None]:
    """Keep which attribute is active, and which colour is active and the default, while layers come and go."""
    layers = mesh.attributes
    active, index = layers.active.name if layers.active else "", layers.active_index
    color, default = layers.active_color_name, layers.default_color_name
    try:
        yield
    finally:
        layers.default_color_name, layers.active_color_name = default, color
        if active in layers:
            layers.active = layers[active]
        else:
            layers.active_index = index


def is_color(mesh: bpy.types.Mesh, name: str, domain: str, data_type: str = "FLOAT_COLOR") -> bool:
    """Whether the mesh has a colour attribute of this name, domain and type."""
    attribute = mesh.attributes.get(name)
    return attribute is not None and attribute.data_type == data_type and attribute.domain == domain


def keeps_what_is_written(mesh: bpy.types.Mesh) -> bool:
    """Whether attributes of a mesh reach the file: those of linked meshes and of library overrides do not."""
    return mesh.library is None and mesh.override_library is None and mesh.is_editable
