"""What materials scatter, emit and let through, as expressions over a mesh.

In go expressions that were read from node trees, textures, and the UV maps and colours of a mesh. Out come
reflectance, emission and transmission per face.
"""

from . import arithmetic
from .arithmetic import lerp, luminance, mean, saturate, shares_removed, tame
from .expressions import BLACK, AttributeSample, Constant, Expression, ImageSample, UVProjection, apply
from .places import PlaceLookup
from .shading import DEFAULT_REFLECTANCE, MAX_EMISSION, FaceShading, Shading, shade_faces
from .surfaces import NO_TRIANGLES, SurfaceArrays
from .textures import Texture

__all__ = [
    "BLACK",
    "DEFAULT_REFLECTANCE",
    "MAX_EMISSION",
    "NO_TRIANGLES",
    "AttributeSample",
    "Constant",
    "Expression",
    "FaceShading",
    "ImageSample",
    "PlaceLookup",
    "Shading",
    "SurfaceArrays",
    "Texture",
    "UVProjection",
    "apply",
    "arithmetic",
    "lerp",
    "luminance",
    "mean",
    "saturate",
    "shade_faces",
    "shares_removed",
    "tame",
]
