"""Objects of a scene from plain triangle meshes."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import ArrayLike

from ..errors import GeometryError, SettingsError
from ..sampling import hash32
from .objects import SceneObject
from .patches import Patches, Surfaces
from .solids import find_shells, finite_or_nan


def mesh_object(
    vertices: ArrayLike,
    triangles: ArrayLike,
    reflectance: ArrayLike = 0.8,
    *,
    face: ArrayLike | None = None,
    receives: bool = True,
    name: str = "",
) -> SceneObject:
    """What rays can hit of a triangle mesh, and a patch for each of its faces.

    Parameters
    ----------
    vertices : array_like, (v, 3) float
        World positions in metres. Triangles with a corner that is not finite are left out.
    triangles : array_like, (t, 3) int
        Vertex indices, counter-clockwise seen from outside. Triangles that are the other way round than most of the
        area that hangs together with them are turned.
    reflectance : array_like of float, (), (3,) or (f, 3)
        Diffuse reflectance in linear colour, 0 .. 1: of everything, or of each face.
    face : array_like, (t,) int, optional
        Face of each triangle, 0 .. f - 1; by default each triangle is a face.
    receives : bool
        False for an object that only occludes and tints others: it has no patches.
    name : str
        Objects of different names cast different rays; the same name casts the same rays in every bake.

    Returns
    -------
    SceneObject
        With the faces as patches, in their order; faces that touch a common vertex are neighbours.

    Raises
    ------
    GeometryError
        When an array has another shape, or an index points at nothing.
    SettingsError
        When a reflectance is not within 0 .. 1.
    """
    vertices = np.asarray(vertices, np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise GeometryError(f"vertices have shape {vertices.shape}: give (v, 3)")
    vertices = finite_or_nan(vertices)
    triangles = _indices("triangles", triangles, (-1, 3), len(vertices))
    if face is None:
        face, n_faces = np.arange(len(triangles)), len(triangles)
    else:
        face = _indices("face", face, (len(triangles),), None)
        n_faces = int(face.max(initial=-1)) + 1
    colours = _reflectance(reflectance, n_faces)
    shells, flipped = find_shells(vertices, triangles)
    triangles = np.where(flipped[:, None], triangles[:, ::-1], triangles)
    surfaces = Surfaces(
        vertices,
        triangles.astype(np.int32),
        colours[face].astype(np.float32),
        shells,
        patch=(face if receives else np.full(len(face), -1)).astype(np.int32),
    )
    if not receives:
        return SceneObject(surfaces, Patches.none(), np.zeros((0, 3)))
    order = np.argsort(face, kind="stable")
    seed = hash32(np.uint32(zlib.crc32(name.encode())))
    shell = np.zeros(n_faces, np.int32)
    shell[face] = shells.shell
    ids = hash32(np.arange(n_faces, dtype=np.uint32) ^ seed)
    patches = Patches(vertices[triangles[order]], face[order], ids, shell)
    return SceneObject(surfaces, patches, colours, (np.repeat(face, 3), triangles.ravel()))


def _indices(name: str, values: ArrayLike, shape: tuple[int, ...], end: int | None) -> np.ndarray:
    """Values as int64 of a shape, where -1 stands for any length, within 0 .. end - 1."""
    array = np.asarray(values)
    if array.shape == (0,):  # an empty list has no dtype that means anything
        array = np.zeros([0, *shape[1:]], np.int64)
    if array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("t" if n == -1 else str(n) for n in shape)
        raise GeometryError(f"{name} has shape {array.shape}: give ({wanted})")
    if array.dtype.kind not in "iu":
        raise GeometryError(f"{name} has dtype {array.dtype}: give whole numbers")
    low, high = int(array.min(initial=0)), int(array.max(initial=0))
    if low < 0 or (end is not None and array.size and high >= end):
        raise GeometryError(
            f"{name} names {low if low < 0 else high}: indices go from 0 to {'f' if end is None else end} - 1"
        )
    return array.astype(np.int64)


def _reflectance(values: ArrayLike, n_faces: int) -> np.ndarray:
    """(f, 3) float64 in 0 .. 1."""
    values = np.asarray(values, np.float64)
    if values.shape not in ((), (3,), (n_faces, 3)):
        raise GeometryError(f"reflectance has shape {values.shape}: give a number, (3,) or ({n_faces}, 3)")
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise SettingsError("reflectance goes from 0 to 1: divide colours of 8 bits by 255")
    return np.broadcast_to(values, (n_faces, 3)).copy()
