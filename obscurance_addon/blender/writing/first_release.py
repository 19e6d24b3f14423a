"""Tells results of version 0.1.0, which kept no records of them."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.order import CORNER_SUFFIX
from ..reading import read_attribute, read_face_start


def layers(mesh: bpy.types.Mesh) -> list[str]:
    """Names of the layers that version 0.1.0 made with target FACE and its viewport copy.

    They come in pairs, which are told by their values: the same on each corner as on its face, and opaque, or empty
    where another object was joined.
    """
    if mesh.is_editmode:
        return []
    kinds = {name: (attribute.data_type, attribute.domain) for name, attribute in mesh.attributes.items()}
    return [
        name
        for face, kind in kinds.items()
        if kind == ("FLOAT_COLOR", "FACE") and kinds.get(face + CORNER_SUFFIX) == ("FLOAT_COLOR", "CORNER")
        if _is_flat_copy(mesh, face, face + CORNER_SUFFIX)
        for name in (face, face + CORNER_SUFFIX)
    ]


def _is_flat_copy(mesh: bpy.types.Mesh, face: str, corner: str) -> bool:
    on_faces, on_corners = (read_attribute(mesh, name, "color", "f4", 4) for name in (face, corner))
    flat = np.repeat(on_faces, np.diff(read_face_start(mesh)), axis=0)
    untouched = (on_faces[:, 3] == 1.0) | ~on_faces.any(1)
    return bool(untouched.all()) and np.array_equal(flat, on_corners)
