"""Remembers on each mesh what its baked layers hold, whatever the settings say later."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, PointerProperty, StringProperty

from ...core.light import LightSettings, Quantity

INDIRECT = "INDIRECT"  # light without direct light and emission, however computed


class BakedLayer(bpy.types.PropertyGroup):
    """What one result holds; `name` is that of the attribute, or of the lightmap and its own UV map."""

    quantity: StringProperty(name="Quantity", options=set())
    exposure: FloatProperty(name="Exposure", options=set())
    image: PointerProperty(name="Image", description="Lightmap that holds the result", type=bpy.types.Image)
    uv_map: StringProperty(name="UV Map", description="Where faces lie in the lightmap", options=set())
    made_uv_map: BoolProperty(name="Made UV Map", description="Whether a bake made the UV map", options=set())


def what_is_stored(light: LightSettings) -> str:
    """The name of a quantity, INDIRECT for all indirect light."""
    if light.quantity is Quantity.AMBIENT or (light.quantity is Quantity.RADIOSITY and light.indirect_only):
        return INDIRECT
    return light.quantity.value


def remember(
    mesh: bpy.types.Mesh,
    layer: str,
    stored: str,
    exposure: float,
    image: bpy.types.Image | None = None,
    uv_map: str = "",
    made_uv_map: bool = False,
) -> None:
    """Note what a result on a mesh holds now.

    Where it is a lightmap, `image` holds it by way of `uv_map`, which this bake made or, if not, a former one may have.
    """
    found = mesh.obscurance_layers.get(layer)
    if found is None:
        found = mesh.obscurance_layers.add()
        found.name = layer
    found.quantity, found.exposure = stored, exposure
    found.made_uv_map = made_uv_map or (bool(uv_map) and found.uv_map == uv_map and found.made_uv_map)
    found.image, found.uv_map = image, uv_map


def indirect_exposure(mesh: bpy.types.Mesh, layer: str) -> float | None:
    """Stops by which the indirect light in a layer was brightened; None where the layer holds anything else."""
    found = mesh.obscurance_layers.get(layer)
    return found.exposure if found is not None and found.quantity == INDIRECT else None


def lightmap_of(mesh: bpy.types.Mesh, name: str) -> tuple[bpy.types.Image, str] | None:
    """The lightmap of this name that a mesh has, and the UV map to look it up with; None where there is none."""
    found = mesh.obscurance_layers.get(name)
    if found is None or found.image is None or found.uv_map not in mesh.uv_layers:
        return None
    return found.image, found.uv_map


def is_own_uv_map(mesh: bpy.types.Mesh, name: str) -> bool:
    """Whether a UV map of this name is one that a bake made for a lightmap."""
    found = mesh.obscurance_layers.get(name)
    return found is not None and found.made_uv_map and found.uv_map == name and name in mesh.uv_layers


def is_own_color(mesh: bpy.types.Mesh, name: str) -> bool:
    """Whether an attribute of this name is a colour that a bake made."""
    found, attribute = mesh.obscurance_layers.get(name), mesh.attributes.get(name)
    return found is not None and not found.uv_map and attribute is not None and attribute.data_type == "FLOAT_COLOR"


def register() -> None:
    """Make `Mesh.obscurance_layers`."""
    bpy.utils.register_class(BakedLayer)
    bpy.types.Mesh.obscurance_layers = CollectionProperty(type=BakedLayer)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Mesh.obscurance_layers
    bpy.utils.unregister_class(BakedLayer)
