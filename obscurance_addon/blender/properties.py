"""Settings on the scene (`Scene.obscurance`), and what they mean to the core."""

from __future__ import annotations

import dataclasses

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..core.falloff import Falloff
from ..core.settings import MAX_RAYS_PER_PATCH, BakeSettings, Sampler
from .output_settings import OutputSettings, Scale, SharedMeshes, Target

_FALLOFFS = (
    (Falloff.SQRT, "Square Root", "Rises fast near the surface and joins open space without an edge"),
    (Falloff.CBRT, "Cube Root", "Rises fastest: only close contact darkens"),
    (Falloff.LINEAR, "Linear", "Rises evenly with distance"),
    (Falloff.EXPONENTIAL, "Exponential", "Between linear and square root, 1 at the distance"),
    (Falloff.STEP, "Step", "Anything within the distance blocks fully: classical ambient occlusion, without bleeding"),
)
_TARGETS = (
    (Target.FACE, "Faces", "One color for each face, as a face attribute"),
    (Target.CORNER, "Face Corners", "Smooth colors that break at sharp edges"),
    (Target.POINT, "Vertices", "One color for each vertex"),
)
_SCALES = (
    (Scale.WHITE, "White", "Open faces are white: a layer to multiply by"),
    (Scale.PAPER, "Paper", "The obscurance itself, in which open faces have the scene's mean reflectance"),
)
_SHARED = (
    (SharedMeshes.SEPARATE, "Separate", "Each object that shares a mesh gets a copy of its own"),
    (SharedMeshes.AVERAGE, "Average", "The mesh stays shared and takes the mean of its objects"),
)
_SAMPLERS = (
    (Sampler.SOBOL, "Sobol", "Scrambled Sobol points: far less noise for the same rays"),
    (Sampler.RANDOM, "Random", "Plain Monte Carlo, for comparison"),
)
_DISTANCE_MODES = (
    ("AUTO", "Automatic", "A fifth of the diagonal of the scene's bounding box"),
    ("METRES", "Metres", "The distance given below"),
)

_ESTIMATOR_NAMES = [field.name for field in dataclasses.fields(BakeSettings)]
_OUTPUT_NAMES = [field.name for field in dataclasses.fields(OutputSettings)]


def _items(choices: tuple) -> list[tuple[str, str, str]]:
    return [(str(getattr(value, "value", value)), label, tip) for value, label, tip in choices]


class ObscuranceSettings(bpy.types.PropertyGroup):
    """Everything a bake needs to know, saved in the .blend."""

    rays: IntProperty(
        name="Rays",
        description="Rays cast from each patch. More rays, less noise; powers of two use the samples best",
        default=64,
        min=1,
        max=MAX_RAYS_PER_PATCH,
        soft_max=4096,
    )
    ray_budget: IntProperty(
        name="Ray Budget",
        description="Total number of rays to share out over the patches by their area, at least 16 each. "
        "0 gives every patch the number of rays above",
        default=0,
        min=0,
    )
    distance_mode: EnumProperty(
        name="Distance Mode", description="How far surroundings have influence", items=_items(_DISTANCE_MODES)
    )
    distance: FloatProperty(
        name="Distance",
        description="Surfaces farther away than this have no influence",
        default=1.0,
        min=0.0,
        soft_min=0.001,
        unit="LENGTH",
        subtype="DISTANCE",
    )
    falloff: EnumProperty(
        name="Falloff", description="How the influence of a surface fades with its distance", items=_items(_FALLOFFS)
    )
    use_bleeding: BoolProperty(
        name="Color Bleeding", description="Surfaces tint their surroundings with their own color", default=True
    )
    scale: EnumProperty(name="Scale", description="What value an open face gets", items=_items(_SCALES))
    sampler: EnumProperty(name="Sampler", description="Where rays start and go", items=_items(_SAMPLERS))
    seed: IntProperty(name="Seed", description="The same seed casts the same rays", default=0, min=0)
    threads: IntProperty(name="Threads", description="Processors to use, 0 for all of them", default=0, min=0, max=1024)
    target: EnumProperty(name="Target", description="What gets a value of its own", items=_items(_TARGETS))
    attribute_name: StringProperty(
        name="Attribute", description="Name of the attribute that holds the result", default="Obscurance"
    )
    corner_copy: BoolProperty(
        name="Viewport Copy",
        description="Also write the faces' colors to their corners, where viewport, painting and exporters see them",
        default=True,
    )
    shared_meshes: EnumProperty(
        name="Shared Meshes", description="What to do with a mesh that several objects use", items=_items(_SHARED)
    )

    def to_settings(self, **changes: object) -> BakeSettings:
        """Settings of the estimator, with some of them changed; raises SettingsError naming what is out of range."""
        own = {name: getattr(self, name) for name in _ESTIMATOR_NAMES}
        own["ray_budget"] = self.ray_budget or None
        own["distance"] = None if self.distance_mode == "AUTO" else self.distance
        return BakeSettings(**own | changes)

    def to_output(self, **changes: object) -> OutputSettings:
        """Where the result goes, with some settings changed."""
        return OutputSettings(**{name: getattr(self, name) for name in _OUTPUT_NAMES} | changes)


def register() -> None:
    """Make `Scene.obscurance`."""
    bpy.utils.register_class(ObscuranceSettings)
    bpy.types.Scene.obscurance = PointerProperty(type=ObscuranceSettings)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Scene.obscurance
    bpy.utils.unregister_class(ObscuranceSettings)
