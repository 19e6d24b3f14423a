"""Settings on the scene (`Scene.obscurance`), and what they mean to the core."""

from __future__ import annotations

import dataclasses
import typing

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ...core.light import MAX_REFLECTORS, LightSettings
from ...core.lightmap import MAX_ERROR_BOUND, MAX_MARGIN, MAX_SIZE, MIN_ERROR_BOUND, MIN_SIZE, LightmapSettings
from ...core.order import MAX_EXPOSURE, OutputSettings
from ...core.settings import MAX_RAYS_PER_PATCH, MAX_THREADS, BakeSettings
from ..reading import Modifiers
from ..stored_preferences import preferred_threads
from . import choices
from .options import FIXED, KEYABLE, RELATIVE_PATH
from .preview import PreviewProperties

_ESTIMATOR_NAMES = [field.name for field in dataclasses.fields(BakeSettings)]
_LIGHT_NAMES = [field.name for field in dataclasses.fields(LightSettings)]
_LIGHTMAP_NAMES = [field.name for field in dataclasses.fields(LightmapSettings) if field.name != "size"]
_OUTPUT_NAMES = [field.name for field in dataclasses.fields(OutputSettings)]


class ObscuranceSettings(PreviewProperties, bpy.types.PropertyGroup):
    """Everything a bake needs to know, saved in the .blend."""

    quantity: EnumProperty(
        name="Quantity", description="Choose what is stored", items=choices.QUANTITIES, options=FIXED
    )
    ambient: EnumProperty(
        name="Ambient From",
        description="Choose what the brightness of the ambient light is computed from",
        items=choices.AMBIENTS,
        options=KEYABLE,
    )
    reflector_mode: EnumProperty(
        name="Reflectors",
        description="Choose how many surfaces pass on the direct light that they receive, before the rest becomes "
        "ambient light. It matters where lamps stand close to a surface",
        items=choices.REFLECTOR_MODES,
        options=KEYABLE,
    )
    reflectors: IntProperty(
        name="Number",
        description="Number of surfaces that pass on direct light. 0 leaves it all to the ambient light",
        default=64,
        min=0,
        max=MAX_REFLECTORS,
        options=KEYABLE,
    )
    indirect_only: BoolProperty(
        name="Indirect Only",
        description="Leave direct light and emission out of radiosity, to compare it with ambient light",
        default=False,
        options=FIXED,
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Brighten light by this many stops before it is stored, for formats that end at 1. 0 stores what "
        "renders show",
        default=0.0,
        min=-MAX_EXPOSURE,
        max=MAX_EXPOSURE,
        soft_min=-10.0,
        soft_max=10.0,
        options=KEYABLE,
    )
    use_bleeding: BoolProperty(
        name="Color Bleeding",
        description="Surfaces tint their surroundings with their own color; without it the result is gray",
        default=True,
        options=KEYABLE,
    )
    distance_mode: EnumProperty(
        name="Distance Mode",
        description="Choose whether the reach of the rays follows from the size of the scene",
        items=choices.DISTANCE_MODES,
        options=KEYABLE,
    )
    distance: FloatProperty(
        name="Distance",
        description="Surfaces farther away than this have no influence, in the scene's unit of length",
        default=1.0,
        min=0.0,
        soft_min=0.001,
        unit="LENGTH",
        subtype="DISTANCE",
        options=KEYABLE,
    )
    falloff: EnumProperty(
        name="Falloff",
        description="Choose how the influence of a surface fades with its distance",
        items=choices.FALLOFFS,
        options=KEYABLE,
    )
    rays: IntProperty(
        name="Rays",
        description="Number of rays from each face, corner or vertex. Four times as many halve the noise or better; "
        "powers of two are best",
        default=64,
        min=1,
        max=MAX_RAYS_PER_PATCH,
        soft_max=4096,
        options=KEYABLE,
    )
    ray_budget: IntProperty(
        name="Ray Budget",
        description="Total number of rays, shared out by area with at least 16 each. 0 gives each face, corner or "
        "vertex the number of rays above",
        default=0,
        min=0,
        options=FIXED,
    )
    target: EnumProperty(
        name="Target",
        description="Choose what gets a color of its own",
        items=choices.TARGETS,
        options=FIXED,
    )
    attribute_name: StringProperty(
        name="Attribute",
        description="Name of the color attribute, or of lightmap and UV map, that hold the result. What an earlier "
        "bake made of that name is overwritten",
        default="Obscurance",
        options=FIXED,
    )
    corner_copy: BoolProperty(
        name="Viewport Copy",
        description="Write the colors of faces to their corners as well, where the viewport, painting and exporters "
        "can see them",
        default=True,
        options=FIXED,
    )
    lightmap_size: IntProperty(
        name="Size",
        description="Width and height of the lightmap in texels",
        default=LightmapSettings.size,
        min=MIN_SIZE,
        max=MAX_SIZE,
        step=256,
        options=FIXED,
    )
    resolution_mode: EnumProperty(
        name="Resolution",
        description="Choose what sets the number of texels on a surface",
        items=choices.RESOLUTIONS,
        options=FIXED,
    )
    texels_per_metre: FloatProperty(
        name="Texels per Metre",
        description="Number of texels along one metre of a surface, the same for all objects",
        default=64.0,
        min=1e-3,
        soft_max=1024.0,
        options=FIXED,
    )
    uv_mode: EnumProperty(
        name="UV Map",
        description="Choose where faces lie in the lightmap",
        items=choices.UV_MODES,
        options=FIXED,
    )
    unwrapper: EnumProperty(
        name="Unwrapper",
        description="Choose the library that cuts the objects into flat charts and packs these",
        items=choices.UNWRAPPERS,
        options=FIXED,
    )
    uv_map: StringProperty(
        name="Name",
        description="Name of the UV map to keep. Empty takes the one that each mesh renders with",
        options=FIXED,
    )
    margin: IntProperty(
        name="Margin",
        description="Texels by which colors are continued beyond the faces, at a size of 1024. It grows with the size",
        default=LightmapSettings.margin,
        min=0,
        max=MAX_MARGIN,
        options=FIXED,
    )
    adaptive: BoolProperty(
        name="Adaptive",
        description="Cast rays from few texels where the surroundings are far and smooth, and interpolate the others. "
        "Without it rays leave every texel, as a reference",
        default=True,
        options=FIXED,
    )
    error_bound: FloatProperty(
        name="Error Bound",
        description="How far an interpolated color may be off, where an open texel is 1",
        default=LightmapSettings.error_bound,
        min=MIN_ERROR_BOUND,
        max=MAX_ERROR_BOUND,
        precision=4,
        options=FIXED,
    )
    image_path: StringProperty(
        name="Image",
        description="File to save the lightmap to, // being the folder of the .blend. Empty packs it into the .blend",
        subtype="FILE_PATH",
        options=RELATIVE_PATH,
    )
    image_format: EnumProperty(
        name="Format",
        description="Choose how the colors of the lightmap are stored",
        items=choices.IMAGE_FORMATS,
        options=FIXED,
    )
    scale: EnumProperty(
        name="Scale",
        description="Choose which value an open face gets",
        items=choices.SCALES,
        options=KEYABLE,
    )
    shared_meshes: EnumProperty(
        name="Shared Meshes",
        description="Choose what happens to a mesh that several objects use",
        items=choices.SHARED,
        options=FIXED,
    )
    modifiers: EnumProperty(
        name="Modifiers",
        description="Choose which modifiers, and which of their levels, are baked. Live Preview follows the viewport",
        items=choices.MODIFIERS,
        options=FIXED,
    )
    sampler: EnumProperty(
        name="Sampler",
        description="Choose where rays start and go",
        items=choices.SAMPLERS,
        options=FIXED,
    )
    seed: IntProperty(
        name="Seed",
        description="Number that picks the rays. The same seed casts the same rays",
        default=0,
        min=0,
        options=KEYABLE,
    )
    threads: IntProperty(
        name="Threads",
        description="Number of processors to use. 0 takes the number from the preferences of the add-on",
        default=0,
        min=0,
        max=MAX_THREADS,
        options=FIXED,
    )

    def to_settings(self, **changes: object) -> BakeSettings:
        """Settings of the estimator, with some of them changed; raises SettingsError naming what is out of range."""
        own = {name: getattr(self, name) for name in _ESTIMATOR_NAMES}
        own["ray_budget"] = self.ray_budget or None
        own["threads"] = self.threads or preferred_threads()
        own["distance"] = None if self.distance_mode == "AUTO" else self.distance
        return BakeSettings(**own | changes)

    def to_light(self, **changes: object) -> LightSettings:
        """Settings of the light, with some of them changed; raises SettingsError naming what is out of range."""
        own = {name: getattr(self, name) for name in _LIGHT_NAMES}
        own["reflectors"] = None if self.reflector_mode == "AUTO" else self.reflectors
        return LightSettings(**own | changes)

    def to_lightmap(self, **changes: object) -> LightmapSettings:
        """Settings of the lightmap, with some of them changed; raises SettingsError naming what is out of range."""
        own = {name: getattr(self, name) for name in _LIGHTMAP_NAMES}
        own["size"] = self.lightmap_size
        own["error_bound"] = round(self.error_bound, 7)  # the property has single precision
        if self.resolution_mode == "SIZE":
            own["texels_per_metre"] = None
        return LightmapSettings(**own | changes)

    def changed(self) -> dict[str, object]:
        """Settings that were given a value, by name; the others have their defaults."""
        return {name: getattr(self, name) for name in setting_names() if self.is_property_set(name)}

    def assign(self, values: dict[str, object]) -> None:
        """Take these settings, and defaults for all others."""
        for name in setting_names():
            if name in values:
                setattr(self, name, values[name])
            else:
                self.property_unset(name)

    def to_modifiers(self, **changes: object) -> Modifiers:
        """Which modifiers are baked, unless changed."""
        return Modifiers(changes.get("modifiers", self.modifiers))

    def to_output(self, **changes: object) -> OutputSettings:
        """Where the result goes, with some settings changed."""
        return OutputSettings(**{name: getattr(self, name) for name in _OUTPUT_NAMES} | changes)


def setting_names() -> list[str]:
    """Names of all settings of a bake, in the order in which they are defined."""
    return list(ObscuranceSettings.__annotations__)


def property_again(name: str, **changes: object) -> object:
    """The definition of a setting for another class to use, with some of its keywords changed."""
    deferred = typing.get_type_hints(ObscuranceSettings)[name]
    return deferred.function(**deferred.keywords | changes)


def register() -> None:
    """Make `Scene.obscurance`."""
    bpy.utils.register_class(ObscuranceSettings)
    bpy.types.Scene.obscurance = PointerProperty(type=ObscuranceSettings)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Scene.obscurance
    bpy.utils.unregister_class(ObscuranceSettings)
