"""A scene as plain arrays: what a bake is computed from, with nothing of Blender's in it."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np

from ..light import LightSources
from ..scene import Shells
from ..shading import Shading, SurfaceArrays


@dataclass(frozen=True)
class MeshArrays:
    """One mesh in its own space.

    Attributes
    ----------
    positions : ndarray, (v, 3) float32
    corner_vertex : ndarray, (c,) int32
    face_start : ndarray, (f + 1,) int32
        First corner of each face, and the number of corners.
    triangle_corners : ndarray, (t, 3) int32
        Blender's own triangulation.
    triangle_face : ndarray, (t,) int32
    face_material : ndarray, (f,) int32
        Material slot of each face.
    corner_edge : ndarray, (c,) int32
        Edge that begins at each corner.
    sharp_edge, sharp_face : ndarray, (e,) and (f,) bool
        Edges marked sharp, and faces with flat shading.
    face_origin, rest : ndarray, (f,) int and (v, 3) float32, or None
        1-based index of the unmodified face that each face came from, 0 for faces that came from none, and where its
        vertices were before modifiers; None for meshes whose faces are the unmodified ones.
    uv : ndarray, (c, 2) float32, or None
        The UV map that was asked for, if the mesh has it; `uv_map` is its name.
    shells : Shells or None
        None until `with_shells` has found them, and turned the triangles of
    flipped_faces : int
        so many faces.
    """

    positions: np.ndarray
    corner_vertex: np.ndarray
    face_start: np.ndarray
    triangle_corners: np.ndarray
    triangle_face: np.ndarray
    face_material: np.ndarray
    corner_edge: np.ndarray
    sharp_edge: np.ndarray
    sharp_face: np.ndarray
    face_origin: np.ndarray | None = None
    rest: np.ndarray | None = None
    uv: np.ndarray | None = None
    uv_map: str = ""
    shells: Shells | None = None
    flipped_faces: int = 0


@dataclass(frozen=True)
class ObjectSnapshot:
    """One object or instance as it stands in the world."""

    key: Hashable  # identity while the file is open: of the object, or of what makes the instance
    name: str
    mesh: MeshArrays
    matrix: np.ndarray  # (4, 4) float64, local to world
    shadings: list[Shading]  # one for each material slot, the last one for faces without material
    surface: SurfaceArrays
    materials: tuple[int, ...] = ()  # session uids, one for each material slot
    data_uid: int = 0  # of the mesh before modifiers
    occludes: bool = True  # whether it throws shadows: else no ray meets it
    gives_color: bool = True  # whether others see its color and its light: else it occludes at most


@dataclass(frozen=True)
class BakedObject:
    """An object that receives values, and its mesh before modifiers."""

    snapshot: ObjectSnapshot
    base: MeshArrays  # the mesh whose faces, corners or vertices receive the values
    session_uid: int  # of the object, to find it again when the values are written
    beside: ObjectSnapshot | None = None  # what modifiers make that `snapshot` does not stand for: it occludes


@dataclass(frozen=True)
class SceneSnapshot:
    """Everything that a bake needs to know of a scene."""

    baked: list[BakedObject]
    occluders: list[ObjectSnapshot]
    notes: list[str] = field(default_factory=list)
    sources: LightSources = field(default_factory=LightSources)

    def objects(self) -> list[ObjectSnapshot]:
        """All that may be met, in the order in which their triangles are joined: what is baked comes first."""
        beside = [baked.beside for baked in self.baked if baked.beside is not None]
        return [*(baked.snapshot for baked in self.baked), *beside, *self.occluders]


@dataclass(frozen=True)
class Change:
    """An object as it is now; `baked` is None for objects that only occlude."""

    snapshot: ObjectSnapshot
    baked: BakedObject | None
