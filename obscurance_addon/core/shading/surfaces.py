"""What shading needs to know of a mesh, as arrays: its triangles, UV maps and colour attributes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class SurfaceArrays:
    """What shading needs to know of a triangulated mesh.

    Attributes
    ----------
    triangle_corners : ndarray, (T, 3) int32
        Corner (Blender: loop) indexes of each triangle.
    triangle_face : ndarray, (T,) int32
    triangle_area : ndarray, (T,) float32
        Weights of the triangles of one face, any unit.
    corner_vertex : ndarray, (C,) int32
    uv : mapping of str to ndarray, (C, 2) float32
        UV maps by name.
    color : mapping of str to tuple of str and ndarray, (n, 3) float32
        Domain ('POINT', 'CORNER' or 'FACE') and linear colours of attributes by name.
    active_uv, active_color : str
        Names of the UV map and of the colour attribute that a render takes when a node names none; '' if there is none.
    """

    triangle_corners: np.ndarray
    triangle_face: np.ndarray
    triangle_area: np.ndarray
    corner_vertex: np.ndarray
    uv: Mapping[str, np.ndarray] = field(default_factory=dict)
    color: Mapping[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    active_uv: str = ""
    active_color: str = ""


NO_TRIANGLES = SurfaceArrays(
    np.empty((0, 3), np.int32), np.empty(0, np.int32), np.empty(0, np.float32), np.empty(0, np.int32)
)
