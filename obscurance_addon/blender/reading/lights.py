"""Blender's lights and world as the core's light sources, in the units in which Cycles renders them.

Measured in 4.2, 4.5 and 5.0 by baking a white surface: a point or spot light of P watts has a radiant intensity of
P / 4 pi (a spot is not brighter for its cone), an area light of area A a radiance of P / (pi A), a sun gives its
strength on a surface that faces it. A scale of the object stretches area lights at the same power, and the cone of a
spot light; it leaves radii alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
import numpy as np

from ...core.light import AreaLamp, Lamp, PointLamp, SpotCone, SunLamp
from ...core.notes import Notes
from ...core.shading import MAX_EMISSION, Shading
from ..materials import ImageCache, Input, Output, TreeReader, UnreadableNodeError

_LEAST_SPREAD = 1e-3  # radians
_GIVE_POWER = "give them power and size, and tick Ray Visibility > Diffuse, or remove them"
_UNLINK = "clear Object Properties > Shading > Light Linking, or expect the difference"
_PLAIN = "give its Background node a plain color: the mean of what you see"


@dataclass
class LightReader:
    """Reads lights one by one, and remembers what is to be said about them.

    Attributes
    ----------
    notes : Notes
    lamps : list of Lamp
    """

    notes: Notes
    lamps: list[Lamp] = field(default_factory=list)
    _animated: set[str] = field(default_factory=set)
    _dark: set[str] = field(default_factory=set)
    _linked: set[str] = field(default_factory=set)

    def read(self, ob: bpy.types.Object, matrix: np.ndarray) -> None:
        """Read an evaluated light object, or instance of it, that stands at `matrix` (4, 4)."""
        light, name = ob.data, ob.name
        if _is_animated(ob.original) or _is_animated(light.original):
            self._animated.add(name)
        self.note_linking(ob)
        if light.type == "AREA" and _is_portal(light):
            return
        colour = self._colour(light)
        if not (np.isfinite(colour).all() and np.isfinite(matrix).all()):
            self.notes.add("lights whose power or place is no finite number, so left out", name, cure="correct it")
            return
        if (colour < 0.0).any():
            self.notes.add(
                "lights with negative power, which cannot be baked, so left out", name, cure="make it positive"
            )
            return
        colour = np.minimum(colour, MAX_EMISSION)
        lamp = _MAKERS[light.type](light, name, matrix, colour) if colour.any() and ob.visible_diffuse else None
        if lamp is None:
            self._dark.add(name)
        else:
            self.lamps.append(lamp)

    def note_linking(self, ob: bpy.types.Object) -> None:
        """Remember objects that use light linking, which is not modelled."""
        linking = getattr(ob, "light_linking", None)
        if linking is not None and (linking.receiver_collection or linking.blocker_collection):
            self._linked.add(ob.name)

    def finish(self) -> None:
        """Say what a user may not expect."""
        for names, text, cure in (
            (self._dark, "lights without power, size or diffuse light, so they light nothing", _GIVE_POWER),
            (self._animated, "animated lights, baked as they are at this frame", "bake others with --frames"),
            (self._linked, "light linking is not supported, so these light, and shade, everything", _UNLINK),
        ):
            if names:
                self.notes.add(text, *names, cure=cure)

    def _colour(self, light: bpy.types.Light) -> np.ndarray:
        """Power or strength per channel, (3,) float64."""
        colour = np.array(light.color, np.float64) * light.energy
        if hasattr(light, "exposure"):  # since 4.5
            colour *= 2.0**light.exposure
        if getattr(light, "use_temperature", False):
            colour *= np.array(light.temperature_color, np.float64)
        return colour * self._node_colour(light)

    def _node_colour(self, light: bpy.types.Light) -> np.ndarray:
        """What the light's own nodes make of it, relative to none."""
        if light.node_tree is None or not _uses_nodes(light):
            return np.ones(3)
        reader = TreeReader(ImageCache())
        end = light.node_tree.get_output_node("CYCLES")
        shading = reader.surface_at(Input(end.inputs["Surface"], None)) if end else Shading()
        if shading.varies():
            reader.note("nodes use a texture, so they count as white", cure="set a color without a texture")
        reader.tell(self.notes, "in lights", light.name, "set a plain color and strength in their nodes")
        return np.ones(3) * (1.0 if shading.varies() else shading.radiance.at(None)[0, 0])


def read_world(world: bpy.types.World | None, notes: Notes) -> np.ndarray:
    """Constant radiance of the world, (3,) float64 W/(m^2 sr)."""
    if world is None:
        return np.zeros(3)
    if world.node_tree is None or not _uses_nodes(world):
        return np.array(world.color, np.float64)
    reader = TreeReader(ImageCache())
    end = world.node_tree.get_output_node("CYCLES")
    if end is None:
        return np.zeros(3)
    if end.inputs["Volume"].is_linked:
        notes.add(
            "volumes of worlds are not supported, so left out", world.name, cure="unlink it, or expect less light"
        )
    origin = _source(Input(end.inputs["Surface"], None))
    if origin is None:
        return np.zeros(3)
    if origin.node.bl_idname != "ShaderNodeBackground":
        notes.add(
            "only a Background node is understood in worlds, so this one counts as black", world.name, cure=_PLAIN
        )
        return np.zeros(3)
    colour, strength = reader.values(origin, "Color", "Strength")
    radiance = np.zeros(3)
    if Shading(colour, strength).varies():
        reader.note("textures are not understood, so the background counts as black", cure=_PLAIN)
    else:
        radiance = np.ones(3) * colour.at(None)[0, 0] * strength.at(None)[0, 0]
    reader.tell(notes, "in the world", world.name, _PLAIN)
    return np.clip(np.nan_to_num(radiance.astype(np.float64)), 0.0, MAX_EMISSION)


def _source(target: Input) -> Output | None:
    """The node output that really feeds an input, past reroutes and groups; None where nothing does."""
    try:
        origin = target.origin()
        while origin is not None and (behind := origin.behind()) is not None:
            origin = behind.origin()
    except UnreadableNodeError:
        return None
    return origin


def _point(light: bpy.types.Light, name: str, matrix: np.ndarray, colour: np.ndarray) -> PointLamp:
    radius = max(float(light.shadow_soft_size), 0.0)
    if not getattr(light, "normalize", True):  # then the power is that of a square metre
        colour = colour * (4.0 * math.pi * radius**2 if radius > 0.0 else 4.0)
    return PointLamp(
        name,
        matrix[:3, 3],
        colour / (4.0 * math.pi),
        radius,
        is_disc=bool(getattr(light, "use_soft_falloff", True)),
        casts_shadow=bool(light.use_shadow),
    )


def _spot(light: bpy.types.Light, name: str, matrix: np.ndarray, colour: np.ndarray) -> PointLamp:
    x, y, beam = matrix[:3, 0], matrix[:3, 1], -matrix[:3, 2]
    length = np.maximum([np.linalg.norm(axis) for axis in (x, y, beam)], 1e-12)
    frame = np.stack([x / length[0] * length[2] / length[0], y / length[1] * length[2] / length[1], beam / length[2]])
    cone = SpotCone(frame, math.cos(0.5 * light.spot_size), float(light.spot_blend))
    lamp = _point(light, name, matrix, colour)
    return PointLamp(
        lamp.name, lamp.position, lamp.intensity, lamp.radius, cone, lamp.is_disc, casts_shadow=lamp.casts_shadow
    )


def _sun(light: bpy.types.Light, name: str, matrix: np.ndarray, colour: np.ndarray) -> SunLamp | None:
    axis = matrix[:3, 2]
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        return None
    half_angle = 0.5 * min(max(float(light.angle), 0.0), math.pi)
    if not getattr(light, "normalize", True):
        colour = colour * (math.pi * math.sin(half_angle) ** 2 if half_angle > 0.0 else 1.0)
    return SunLamp(name, axis / length, colour, half_angle, casts_shadow=bool(light.use_shadow))


def _area(light: bpy.types.Light, name: str, matrix: np.ndarray, colour: np.ndarray) -> AreaLamp | None:
    size_y = light.size if light.shape in {"SQUARE", "DISK"} else light.size_y
    half_x, half_y = 0.5 * light.size * matrix[:3, 0], 0.5 * size_y * matrix[:3, 1]
    normal = np.cross(half_x, half_y)
    length = float(np.linalg.norm(normal))
    if not length > 0.0 or light.spread < _LEAST_SPREAD:
        return None
    beam = -normal / length if np.linalg.det(matrix[:3, :3]) > 0.0 else normal / length
    is_ellipse = light.shape in {"DISK", "ELLIPSE"}
    lamp = AreaLamp(
        name,
        matrix[:3, 3],
        half_x,
        half_y,
        beam,
        colour / math.pi,
        is_ellipse,
        0.5 * float(light.spread),
        casts_shadow=bool(light.use_shadow),
    )
    return lamp if not getattr(light, "normalize", True) else lamp.of_power(colour)


_MAKERS: dict[str, Callable[[bpy.types.Light, str, np.ndarray, np.ndarray], Lamp | None]] = {
    "POINT": _point,
    "SPOT": _spot,
    "SUN": _sun,
    "AREA": _area,
}


def _uses_nodes(owner: bpy.types.Light | bpy.types.World) -> bool:
    # New versions always use the nodes, and warn when asked.
    always = (5, 0, 0) if isinstance(owner, bpy.types.World) else (5, 3, 0)
    return bpy.app.version >= always or owner.use_nodes


def _is_portal(light: bpy.types.Light) -> bool:
    return getattr(getattr(light, "cycles", None), "is_portal", False)  # gone where Cycles is disabled


def _is_animated(owner: bpy.types.ID) -> bool:
    data = owner.animation_data
    return data is not None and (data.action is not None or bool(data.drivers) or bool(data.nla_tracks))
