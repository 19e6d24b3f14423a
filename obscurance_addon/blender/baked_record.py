"""Remembers on each mesh what its baked layers hold, whatever the settings say later."""

from __future__ import annotations

import bpy
from bpy.props import CollectionProperty, FloatProperty, StringProperty

from ..core.light_settings import LightSettings, Quantity

INDIRECT = "INDIRECT"  # light without direct light and emission, however computed


class BakedLayer(bpy.types.PropertyGroup):
    """What one attribute holds; `name` is the attribute's."""

    quantity: StringProperty(name="Quantity", options=set())
    exposure: FloatProperty(name="Exposure", options=set())


def what_is_stored(light: LightSettings) -> str:
    """The name of a quantity, INDIRECT for all indirect light."""
    if light.quantity is Quantity.AMBIENT or (light.quantity is Quantity.RADIOSITY and light.indirect_only):
        return INDIRECT
    return light.quantity.value


def remember(mesh: bpy.types.Mesh, layer: str, stored: str, exposure: float) -> None:
    """Note what a layer of a mesh holds now."""
    found = mesh.obscurance_layers.get(layer)
    if found is None:
        found = mesh.obscurance_layers.add()
        found.name = layer
    found.quantity, found.exposure = stored, exposure


def indirect_exposure(mesh: bpy.types.Mesh, layer: str) -> float | None:
    """Stops by which the indirect light in a layer was brightened; None where the layer holds anything else."""
    found = mesh.obscurance_layers.get(layer)
    return found.exposure if found is not None and found.quantity == INDIRECT else None


def register() -> None:
    """Make `Mesh.obscurance_layers`."""
    bpy.utils.register_class(BakedLayer)
    bpy.types.Mesh.obscurance_layers = CollectionProperty(type=BakedLayer)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Mesh.obscurance_layers
    bpy.utils.unregister_class(BakedLayer)
