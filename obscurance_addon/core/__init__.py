"""Obscurances with colour bleeding of triangle meshes, with numpy and Embree and without Blender.

In go meshes as arrays of vertices and triangles with their reflectances (`mesh_object`), and settings. Out come the
obscurances of each face and an estimate of their error (`bake_objects`), or those of a scene that changes
(`IncrementalBake`).
"""

from .errors import BackendError, BakeCancelledError, GeometryError, ObscuranceError, SettingsError
from .falloff import Falloff
from .monitor import Monitor
from .obscurance import Obscurances, bake_objects, bake_obscurances
from .scene import Patches, SceneObject, Surfaces, join_objects, mesh_object
from .settings import BakeSettings, Sampler
from .updates import IncrementalBake

__all__ = [
    "BackendError",
    "BakeCancelledError",
    "BakeSettings",
    "Falloff",
    "GeometryError",
    "IncrementalBake",
    "Monitor",
    "ObscuranceError",
    "Obscurances",
    "Patches",
    "Sampler",
    "SceneObject",
    "SettingsError",
    "Surfaces",
    "bake_objects",
    "bake_obscurances",
    "join_objects",
    "mesh_object",
]
