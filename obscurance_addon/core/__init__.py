"""Obscurances with colour bleeding, and light, as a library of arrays: numpy and embreex, no Blender.

In go meshes (`mesh_object`, joined by `join_objects`) or patches and surfaces of one's own, and settings. Out come the
obscurances of every patch with an estimate of their error (`bake_obscurances`). `examples/bake_trimesh.py` is the
shortest way from a mesh to its colours.
"""

from .errors import BackendError, BakeCancelledError, GeometryError, ObscuranceError, SettingsError
from .falloff import Falloff
from .light import BakedLight, LightSettings, Quantity, bake_light
from .monitor import Monitor
from .obscurance import Obscurances, bake_obscurances
from .scene import Patches, SceneObject, Surfaces, join_objects, mesh_object, solid_triangles
from .settings import BakeSettings, Sampler

__all__ = [
    "BackendError",
    "BakeCancelledError",
    "BakeSettings",
    "BakedLight",
    "Falloff",
    "GeometryError",
    "LightSettings",
    "Monitor",
    "ObscuranceError",
    "Obscurances",
    "Patches",
    "Quantity",
    "Sampler",
    "SceneObject",
    "SettingsError",
    "Surfaces",
    "bake_light",
    "bake_obscurances",
    "join_objects",
    "mesh_object",
    "solid_triangles",
]
