"""Triangle meshes as objects of a scene, for callers that have nothing but vertices and triangles."""

from __future__ import annotations

import numpy as np

from ..errors import GeometryError
from .objects import SceneObject
from .patches import Patches, Surfaces
from .solids import solid_triangles


def mesh_object(
    vertices: np.ndarray, triangles: np.ndarray, reflectance: np.ndarray | float = 0.8, *, first_id: int = 0
) -> SceneObject:
    """A mesh of which every triangle is a patch that receives and reflects.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float
        World positions in metres.
    triangles : ndarray, (t, 3) int
        Counter-clockwise seen from outside; those that share an edge share its vertices, which tells closed solids.
    reflectance : ndarray, (t, 3) or (3,) float, or float
        Diffuse reflectance in linear colour, 0 .. 1.
    first_id : int
        Identity of the first patch. Patches of equal identity cast the same rays: give each object a range of its own.

    Returns
    -------
    SceneObject
        For `join_objects`. Triangles that meet in a vertex are neighbours.

    Raises
    ------
    GeometryError
        When an array has another shape, or a triangle names a vertex that is not there.
    """
    vertices = np.asarray(vertices, np.float64)
    triangles = np.asarray(triangles)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise GeometryError(
            f"a mesh is made of vertices (v, 3) and triangles (t, 3), not {vertices.shape} and {triangles.shape}"
        )
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise GeometryError(f"the triangles name vertices {triangles.min()} to {triangles.max()} of {len(vertices)}")
    n, triangles = len(triangles), triangles.astype(np.int32)
    try:
        colours = np.broadcast_to(np.asarray(reflectance, np.float32), (n, 3))
    except ValueError:
        raise GeometryError(f"the reflectance of {n} triangles is a number, (3,) or ({n}, 3)") from None
    patch = np.arange(n)
    return SceneObject(
        Surfaces(vertices, triangles, colours, solid_triangles(vertices, triangles), patch=patch.astype(np.int32)),
        Patches(vertices[triangles], patch, (first_id + patch).astype(np.uint32)),
        colours.astype(np.float64),
        (np.repeat(patch, 3), triangles.ravel().astype(np.int64)),
    )
