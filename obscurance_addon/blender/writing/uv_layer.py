"""Writes a UV map into meshes, without touching anything else of the user's."""

from __future__ import annotations

import bpy
import numpy as np

from . import records
from .color_attribute import choices_kept
from .layers import PENDING, AttributeNameError, check_free, check_text, made_layer

MAX_UV_MAPS = 8  # Blender's limit


def check_uv_name(ob: bpy.types.Object, name: str) -> None:
    """Make sure that a UV map of this name can be written on an object.

    Raises
    ------
    AttributeNameError
        When the name is empty, too long, reserved, or that of a layer of the user's, or when there are too many UV
        maps.
    """
    check_text(name)
    uv_layers = ob.data.uv_layers
    keeping = "keep that UV map, " if name in uv_layers else ""
    check_free(ob, name, cure=f"choose another name, {keeping}or ")
    if len(uv_layers) >= MAX_UV_MAPS and name not in uv_layers:
        raise AttributeNameError(
            f"object '{ob.name}' has {MAX_UV_MAPS} UV maps, and Blender allows no more: remove one, or keep one for "
            "the lightmap"
        )


def prepare(mesh: bpy.types.Mesh, name: str) -> str:
    """Make room for a UV map and return the name of the layer to fill; nothing that exists is changed yet."""
    if name in mesh.uv_layers:
        return name
    render = _render_map(mesh)
    made = mesh.uv_layers.new(name=name + PENDING, do_init=False)
    layer = made_layer(mesh, name, "UV map", made)
    if render:
        mesh.uv_layers[render].active_render = True
    return layer


def discard(mesh: bpy.types.Mesh, name: str, layer: str) -> None:
    """Remove the layer that `prepare` made for this name, unless it was there already."""
    if layer != name:
        mesh.uv_layers.remove(mesh.uv_layers[layer])


def fill(mesh: bpy.types.Mesh, layer: str, name: str, uv: np.ndarray) -> str | None:
    """Write a prepared UV map, give it its name, note that it is ours, and show it in editors.

    Renders keep the one that they use.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    layer : str
        What `prepare` returned.
    name : str
        The name to end up with; a colour that an earlier bake left there is removed.
    uv : ndarray, (c, 2) float32

    Returns
    -------
    str or None
        What was replaced, in words.
    """
    records.adopt(mesh)
    replaced = None
    if layer != name:
        if name in mesh.attributes:
            with choices_kept(mesh):
                mesh.attributes.remove(mesh.attributes[name])
            replaced = f"colors '{name}' of mesh '{mesh.name}' were replaced by the UV map of a lightmap"
        mesh.uv_layers[layer].name = name
    mesh.uv_layers[name].uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    mesh.uv_layers.active = mesh.uv_layers[name]
    records.claim(mesh, name)
    mesh.update()
    return replaced


def _render_map(mesh: bpy.types.Mesh) -> str:
    return next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
