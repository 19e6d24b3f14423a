"""A whole bake as a function of arrays: the snapshot of a scene goes in, values per element come out.

In go snapshots (plain dataclasses of arrays, with nothing of Blender's in them) and settings. Out come the arrays that
the method takes, and where each of its results belongs in the scene.
"""

from .arrays import ObjectRange, prepare_arrays, shade
from .atlas_layout import lay_out
from .object_arrays import ObjectArrays
from .output import MAX_EXPOSURE, ImageFormat, OutputSettings, Scale, SharedMeshes, Target
from .snapshot import BakedObject, MeshArrays, ObjectSnapshot, SceneSnapshot
from .texel_materials import TexelMaterials

__all__ = [
    "MAX_EXPOSURE",
    "BakedObject",
    "ImageFormat",
    "MeshArrays",
    "ObjectArrays",
    "ObjectRange",
    "ObjectSnapshot",
    "OutputSettings",
    "Scale",
    "SceneSnapshot",
    "SharedMeshes",
    "Target",
    "TexelMaterials",
    "lay_out",
    "prepare_arrays",
    "shade",
]
