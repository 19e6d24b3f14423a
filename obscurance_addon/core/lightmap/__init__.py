"""Obscurances and light at the texels of a lightmap, and the atlas that the faces lie on.

In go meshes to unwrap or triangles with UV coordinates, and what a bake of patches needs. Out come pages of pixels
with their margins, and counts.
"""

from .bake import Lightmap, bake_lightmap
from .layout import AtlasLayout
from .light import bake_light_map
from .settings import (
    MAX_ERROR_BOUND,
    MAX_MARGIN,
    MAX_SIZE,
    MIN_ERROR_BOUND,
    MIN_SIZE,
    LightmapSettings,
    Unwrapper,
    UvMode,
)
from .triangles import charts_of
from .unwrapping import TooManyChartsError, UnwrapMesh, unwrap

__all__ = [
    "MAX_ERROR_BOUND",
    "MAX_MARGIN",
    "MAX_SIZE",
    "MIN_ERROR_BOUND",
    "MIN_SIZE",
    "AtlasLayout",
    "Lightmap",
    "LightmapSettings",
    "TooManyChartsError",
    "UnwrapMesh",
    "Unwrapper",
    "UvMode",
    "bake_light_map",
    "bake_lightmap",
    "charts_of",
    "unwrap",
]
