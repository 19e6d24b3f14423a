"""Settings on the scene (`Scene.obscurance`), and what they mean to the core."""

from __future__ import annotations

import dataclasses
import typing

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..core.falloff import Falloff
from ..core.light_settings import MAX_REFLECTORS, Ambient, LightSettings, Quantity
from ..core.settings import MAX_RAYS_PER_PATCH, MAX_THREADS, BakeSettings, Sampler
from .output_settings import MAX_EXPOSURE, OutputSettings, Scale, SharedMeshes, Target
from .stored_preferences import preferred_threads

_QUANTITIES = (
    (Quantity.OBSCURANCE, "Obscurance", "How open each place is, tinted by its surroundings; no light is needed"),
    (Quantity.AMBIENT, "Ambient Light", "All indirect light, to be added to the direct light of a renderer"),
    (Quantity.DIRECT, "Direct Light", "The light of lamps, shining faces and the world, with shadows"),
    (Quantity.COMBINED, "Combined Light", "Direct and ambient light, and what faces emit: a finished lighting"),
    (
        Quantity.RADIOSITY,
        "Radiosity",
        "The same with all indirect light computed in full, as a reference: slow, and for whole faces only",
    ),
)
_AMBIENTS = (
    (Ambient.RECEIVED, "Light Received", "From the direct light that surfaces receive and scatter"),
    (Ambient.EMISSION, "Light Emitted", "From what lamps and surfaces emit, as published in 2003"),
)
_REFLECTOR_MODES = (
    ("AUTO", "Automatic", "Take the surfaces that scatter most direct light, where they are few"),
    ("NUMBER", "Number", "Take the number of surfaces given below"),
)
_FALLOFFS = (
    (Falloff.SQRT, "Square Root", "The influence fades fast near a surface and joins open space without an edge"),
    (Falloff.CBRT, "Cube Root", "The influence fades fastest, so that only close contact darkens"),
    (Falloff.LINEAR, "Linear", "The influence fades evenly with distance"),
    (Falloff.EXPONENTIAL, "Exponential", "The influence fades between linear and square root"),
    (
        Falloff.STEP,
        "Step",
        "Anything within the distance blocks fully: this is classical ambient occlusion, without bleeding",
    ),
)
_TARGETS = (
    (Target.FACE, "Faces", "Each face gets one color, in a face attribute"),
    (Target.CORNER, "Face Corners", "Colors vary smoothly over faces and break at sharp edges"),
    (Target.POINT, "Vertices", "Each vertex gets one color, and colors vary smoothly over all edges"),
)
_SCALES = (
    (Scale.WHITE, "White", "Open faces are white, so that the layer can be multiplied with a material's color"),
    (Scale.PAPER, "Paper", "Values are obscurances as published: open faces have the scene's mean reflectance"),
)
_SHARED = (
    (SharedMeshes.SEPARATE, "Separate", "Each object that shares a mesh gets a copy of its own"),
    (SharedMeshes.AVERAGE, "Average", "The mesh stays shared and takes the mean of its objects"),
)
_SAMPLERS = (
    (Sampler.SOBOL, "Sobol", "Rays follow scrambled Sobol points, which leave far less noise for the same number"),
    (Sampler.RANDOM, "Random", "Rays are random, as a comparison"),
)
_DISTANCE_MODES = (
    ("AUTO", "Automatic", "Rays reach a fifth of the diagonal of the scene's bounding box"),
    ("METRES", "Metres", "Rays reach the distance given below"),
)

# What may change over time without a surprise. Where results go, and how they are computed, may not.
_KEYABLE: set[str] = {"ANIMATABLE"}
_FIXED: set[str] = set()

_ESTIMATOR_NAMES = [field.name for field in dataclasses.fields(BakeSettings)]
_LIGHT_NAMES = [field.name for field in dataclasses.fields(LightSettings)]
_OUTPUT_NAMES = [field.name for field in dataclasses.fields(OutputSettings)]


def _items(choices: tuple) -> list[tuple[str, str, str]]:
    return [(str(getattr(value, "value", value)), label, tip) for value, label, tip in choices]


class ObscuranceSettings(bpy.types.PropertyGroup):
    """Everything a bake needs to know, saved in the .blend."""

    quantity: EnumProperty(
        name="Quantity", description="Choose what is stored", items=_items(_QUANTITIES), options=_FIXED
    )
    ambient: EnumProperty(
        name="Ambient From",
        description="Choose what the brightness of the ambient light is computed from",
        items=_items(_AMBIENTS),
        options=_KEYABLE,
    )
    reflector_mode: EnumProperty(
        name="Reflectors",
        description="Choose how many surfaces pass on the direct light that they receive, before the rest becomes "
        "ambient light. It matters where lamps stand close to a surface",
        items=_items(_REFLECTOR_MODES),
        options=_KEYABLE,
    )
    reflectors: IntProperty(
        name="Number",
        description="Number of surfaces that pass on direct light. 0 leaves it all to the ambient light",
        default=64,
        min=0,
        max=MAX_REFLECTORS,
        options=_KEYABLE,
    )
    indirect_only: BoolProperty(
        name="Indirect Only",
        description="Leave direct light and emission out of radiosity, to compare it with ambient light",
        default=False,
        options=_FIXED,
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
        options=_KEYABLE,
    )
    use_bleeding: BoolProperty(
        name="Color Bleeding",
        description="Surfaces tint their surroundings with their own color; without it the result is gray",
        default=True,
        options=_KEYABLE,
    )
    distance_mode: EnumProperty(
        name="Distance Mode",
        description="Choose whether the reach of the rays follows from the size of the scene",
        items=_items(_DISTANCE_MODES),
        options=_KEYABLE,
    )
    distance: FloatProperty(
        name="Distance",
        description="Surfaces farther away than this have no influence, in the scene's unit of length",
        default=1.0,
        min=0.0,
        soft_min=0.001,
        unit="LENGTH",
        subtype="DISTANCE",
        options=_KEYABLE,
    )
    falloff: EnumProperty(
        name="Falloff",
        description="Choose how the influence of a surface fades with its distance",
        items=_items(_FALLOFFS),
        options=_KEYABLE,
    )
    rays: IntProperty(
        name="Rays",
        description="Number of rays from each face, corner or vertex. Four times as many halve the noise or better; "
        "powers of two are best",
        default=64,
        min=1,
        max=MAX_RAYS_PER_PATCH,
        soft_max=4096,
        options=_KEYABLE,
    )
    ray_budget: IntProperty(
        name="Ray Budget",
        description="Total number of rays, shared out by area with at least 16 each. 0 gives each face, corner or "
        "vertex the number of rays above",
        default=0,
        min=0,
        options=_FIXED,
    )
    target: EnumProperty(
        name="Target", description="Choose what gets a color of its own", items=_items(_TARGETS), options=_FIXED
    )
    attribute_name: StringProperty(
        name="Attribute",
        description="Name of the color attribute that holds the result. One that exists already is overwritten",
        default="Obscurance",
        options=_FIXED,
    )
    corner_copy: BoolProperty(
        name="Viewport Copy",
        description="Write the colors of faces to their corners as well, where the viewport, painting and exporters "
        "can see them",
        default=True,
        options=_FIXED,
    )
    scale: EnumProperty(
        name="Scale", description="Choose which value an open face gets", items=_items(_SCALES), options=_KEYABLE
    )
    shared_meshes: EnumProperty(
        name="Shared Meshes",
        description="Choose what happens to a mesh that several objects use",
        items=_items(_SHARED),
        options=_FIXED,
    )
    sampler: EnumProperty(
        name="Sampler", description="Choose where rays start and go", items=_items(_SAMPLERS), options=_FIXED
    )
    seed: IntProperty(
        name="Seed",
        description="Number that picks the rays. The same seed casts the same rays",
        default=0,
        min=0,
        options=_KEYABLE,
    )
    threads: IntProperty(
        name="Threads",
        description="Number of processors to use. 0 takes the number from the preferences of the add-on",
        default=0,
        min=0,
        max=MAX_THREADS,
        options=_FIXED,
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

    def to_output(self, **changes: object) -> OutputSettings:
        """Where the result goes, with some settings changed."""
        return OutputSettings(**{name: getattr(self, name) for name in _OUTPUT_NAMES} | changes)


def setting_names() -> list[str]:
    """Names of all settings, in the order in which they are defined."""
    return list(typing.get_type_hints(ObscuranceSettings))


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
