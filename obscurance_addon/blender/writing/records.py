"""Remembers on each mesh which layers are ours and what they hold, whatever the settings say later.

The record is part of the mesh, so that it is saved, undone, copied, appended and linked with it. A layer is ours as
long as it has the name, type and domain in which a bake or a copy left it, painted over or not. Any other layer is the
user's, and nothing that writes results may change it.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, PointerProperty, StringProperty

from ...core.light import LightSettings, Quantity
from . import first_release

INDIRECT = "INDIRECT"  # light without direct light and emission, however computed

_COLOR, _UV_MAP = ("FLOAT_COLOR", ""), ("FLOAT2", "CORNER")  # type and domain; '' is any


class BakedLayer(bpy.types.PropertyGroup):
    """What one result holds; `name` is that of the attribute, or of the lightmap and its own UV map."""

    quantity: StringProperty(name="Quantity", options=set())
    exposure: FloatProperty(name="Exposure", options=set())
    image: PointerProperty(name="Image", description="Lightmap that holds the result", type=bpy.types.Image)
    uv_map: StringProperty(name="UV Map", description="Where faces lie in the lightmap", options=set())
    data_type: StringProperty(name="Type", description="Of the layer that was made; empty for none", options=set())
    domain: StringProperty(name="Domain", description="Of the layer that was made", options=set())
    made_uv_map: BoolProperty(name="Made UV Map", description="Instead of a type, in older files", options=set())

    def made(self) -> tuple[str, str]:
        """Type and domain of the layer of this name that a bake or a copy made; ('', '') where none did."""
        if self.data_type:
            return self.data_type, self.domain
        if self.made_uv_map:
            return _UV_MAP
        return ("", "") if self.uv_map else _COLOR  # in older files


def what_is_stored(light: LightSettings) -> str:
    """The name of a quantity, INDIRECT for all indirect light."""
    if light.quantity is Quantity.AMBIENT or (light.quantity is Quantity.RADIOSITY and light.indirect_only):
        return INDIRECT
    return light.quantity.value


def adopt(mesh: bpy.types.Mesh) -> None:
    """Note which layers are results of version 0.1.0, before anything changes them."""
    for name in [] if _has_records(mesh) else first_release.layers(mesh):
        found, attribute = _added(mesh, name), mesh.attributes[name]
        found.data_type, found.domain = attribute.data_type, attribute.domain


def claim(mesh: bpy.types.Mesh, layer: str) -> None:
    """Note that a layer, as it is now, was made by a bake or a copy."""
    attribute = mesh.attributes[layer]
    _assign(_record(mesh, layer), data_type=attribute.data_type, domain=attribute.domain)
    forget_lost(mesh)


def remember(
    mesh: bpy.types.Mesh,
    layer: str,
    stored: str,
    exposure: float,
    image: bpy.types.Image | None = None,
    uv_map: str = "",
) -> None:
    """Note what a result on a mesh holds now; where it is a lightmap, `image` holds it by way of `uv_map`."""
    _assign(_record(mesh, layer), quantity=stored, exposure=exposure, image=image, uv_map=uv_map)


def forget(mesh: bpy.types.Mesh, layer: str) -> None:
    """Drop the record of a layer."""
    place = mesh.obscurance_layers.find(layer)
    if place >= 0:
        mesh.obscurance_layers.remove(place)


def forget_lost(mesh: bpy.types.Mesh) -> None:
    """Drop records whose layer is gone or has become something else: what gets its name later is the user's."""
    for name in [found.name for found in mesh.obscurance_layers]:  # references do not survive a removal
        if is_own(mesh, name):
            continue
        if lightmap_of(mesh, name) is None:
            forget(mesh, name)
        else:
            _assign(mesh.obscurance_layers[name], data_type="", domain="", made_uv_map=False)


def is_own(mesh: bpy.types.Mesh, layer: str) -> bool:
    """Whether a bake or a copy made the layer of this name."""
    found, attribute = mesh.obscurance_layers.get(layer), mesh.attributes.get(layer)
    if attribute is None:
        return False
    if found is None:
        return not _has_records(mesh) and layer in first_release.layers(mesh)
    data_type, domain = found.made()
    return attribute.data_type == data_type and domain in {"", attribute.domain}


def is_own_color(mesh: bpy.types.Mesh, layer: str) -> bool:
    """Whether an attribute of this name is a colour that a bake made, and what was baked last under this name."""
    found = mesh.obscurance_layers.get(layer)
    return is_own(mesh, layer) and layer not in mesh.uv_layers and not (found is not None and found.uv_map)


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


def _record(mesh: bpy.types.Mesh, layer: str) -> BakedLayer:
    adopt(mesh)
    found = mesh.obscurance_layers.get(layer)
    return _added(mesh, layer) if found is None else found


def _added(mesh: bpy.types.Mesh, layer: str) -> BakedLayer:
    found = mesh.obscurance_layers.add()
    found.name = layer
    return found


def _has_records(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh has, or ever had, a record."""
    return mesh.is_property_set("obscurance_layers")


def _assign(found: BakedLayer, **values: object) -> None:
    """Set what differs only: to set a property makes Blender evaluate the mesh anew."""
    for name, value in values.items():
        if getattr(found, name) != value:
            setattr(found, name, value)


@persistent
def _on_change(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Notice that layers were removed or renamed, before others get their names."""
    if depsgraph.mode != "VIEWPORT":
        return
    for update in depsgraph.updates:
        mesh = update.id.original
        if isinstance(mesh, bpy.types.Mesh) and len(mesh.obscurance_layers) and mesh.library is None:
            forget_lost(mesh)


def register() -> None:
    """Make `Mesh.obscurance_layers`."""
    bpy.utils.register_class(BakedLayer)
    bpy.types.Mesh.obscurance_layers = CollectionProperty(type=BakedLayer)
    bpy.app.handlers.depsgraph_update_post.append(_on_change)


def unregister() -> None:
    """Undo `register`."""
    bpy.app.handlers.depsgraph_update_post.remove(_on_change)
    del bpy.types.Mesh.obscurance_layers
    bpy.utils.unregister_class(BakedLayer)
