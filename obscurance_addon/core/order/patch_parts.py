"""One object in the world, and the patches that it is cut into. numpy only, any thread."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from ..sampling import hash32
from ..scene import corner_cells, face_of_corner, finite_or_nan, opacity, smooth_fans, triangle_areas
from ..shading import FaceShading
from .output import Target
from .snapshot import BakedObject, MeshArrays, ObjectSnapshot

_ALL = 1.0 - 1e-6  # of the light


@dataclass(frozen=True)
class WorldObject:
    """One object in world space."""

    vertices: np.ndarray  # (v, 3) float64; NaN where they are not finite
    finite: np.ndarray  # (v,) bool
    triangle_corners: np.ndarray  # (t, 3), turned so that normals point outwards under mirroring transforms too
    triangles: np.ndarray  # (t, 3) vertex indices
    reflectance: np.ndarray  # (f, 3) float32
    emission: np.ndarray  # (f, 3) float32
    transmission: np.ndarray | None  # (f, 3) float32, None where all are opaque

    @classmethod
    def of(cls, ob: ObjectSnapshot, shading: FaceShading) -> WorldObject:
        mesh = ob.mesh
        matrix = ob.matrix if np.isfinite(ob.matrix).all() else np.full((4, 4), np.nan)
        vertices = finite_or_nan(finite_or_nan(mesh.positions) @ matrix[:3, :3].T + matrix[:3, 3])
        finite = np.isfinite(vertices[:, 0])
        corners = mesh.triangle_corners
        if finite.any() and np.linalg.det(matrix[:3, :3]) < 0.0:
            corners = corners[:, ::-1]
        return cls(vertices, finite, corners, mesh.corner_vertex[corners], *shading)

    def is_absent(self) -> np.ndarray:
        """(f,) bool: faces that let all light through, such as those of materials that have nothing but a volume."""
        if self.transmission is None:
            return np.zeros(len(self.reflectance), bool)
        return (self.transmission >= _ALL).all(1) & ~self.reflectance.any(1) & ~self.emission.any(1)

    def flattened(self, ob: ObjectSnapshot) -> int:
        """Along how many axes a scale of 0 took away area, 0 if it took none."""
        matrix = ob.matrix[:3, :3]
        lost = 3 - int(np.linalg.matrix_rank(matrix)) if np.isfinite(matrix).all() else 0
        return lost if lost and not triangle_areas(self.vertices[self.triangles]).all() else 0


@dataclass(frozen=True)
class PatchPart:
    """The patches of one object; indices count from its own first patch."""

    cells: np.ndarray
    patch: np.ndarray
    ids: np.ndarray
    reflectance: np.ndarray
    emission: np.ndarray
    opacity: np.ndarray | None
    shell: np.ndarray  # of each patch, 0 for those without cells
    face_patch: np.ndarray  # of each evaluated face; -1 where it is not one patch
    element_patch: np.ndarray
    element_patch_of_node: np.ndarray
    node: np.ndarray
    n_nodes: int


def baked_part(baked: BakedObject, world: WorldObject, target: Target) -> PatchPart:
    """Cut an object into patches and tie them to the elements of its unmodified mesh."""
    base = baked.base
    face = face_of_corner(base.face_start)
    if target is Target.FACE:
        element_patch = np.arange(len(base.face_start) - 1)
        cells, element, source_face = _face_cells(baked, world)
        linked, node, n_nodes = face, base.corner_vertex, len(base.positions)
    else:
        cells, corner, source_face = _corner_cells(baked, world)
        if target is Target.POINT:
            corner_patch = base.corner_vertex
            element_patch = np.arange(len(base.positions))
        else:
            corner_patch = element_patch = corner_fans(base)
        element = corner_patch[corner]
        linked, node, n_nodes = corner_patch, face, len(base.face_start) - 1
    n_patches = int(element_patch.max()) + 1
    face_patch = _face_patches(baked.snapshot.mesh, target)
    if (np.diff(element) < 0).any():
        order = np.argsort(element, kind="stable")
        cells, element, source_face = cells[order], element[order], source_face[order]
    reflectance, emission, opaque = _patch_means(cells, element, source_face, n_patches, world)
    name = np.uint32(zlib.crc32(baked.snapshot.name.encode()))
    return PatchPart(
        cells=cells,
        patch=element,
        ids=hash32(np.arange(n_patches, dtype=np.uint32) ^ hash32(name)),
        reflectance=reflectance,
        emission=emission,
        opacity=opaque,
        shell=_shells_of(baked.snapshot.mesh, element, source_face, n_patches),
        face_patch=face_patch,
        element_patch=element_patch,
        element_patch_of_node=linked,
        node=node,
        n_nodes=n_nodes,
    )


def unbaked_faces(mesh: MeshArrays) -> np.ndarray:
    """(f,) bool: evaluated faces of a baked object that came from none of its own, such as those a Boolean cuts in."""
    if mesh.face_origin is None:
        return np.zeros(len(mesh.face_start) - 1, bool)
    return np.asarray(mesh.face_origin) <= 0


def faces_with_triangles(mesh: MeshArrays) -> np.ndarray:
    """(f,) bool: faces of which there is anything to hit."""
    found = np.zeros(len(mesh.face_start) - 1, bool)
    found[mesh.triangle_face] = True
    return found


def other_part(ob: ObjectSnapshot, world: WorldObject, number: int, faces: np.ndarray) -> PatchPart:
    """Faces (f,) bool of an object that only scatter light; `number` tells instances of one object apart."""
    kept = np.flatnonzero(faces[ob.mesh.triangle_face])
    face = ob.mesh.triangle_face[kept].astype(np.int64)
    order = np.argsort(face, kind="stable")
    kept, face = kept[order], face[order]
    n_patches = int(np.count_nonzero(faces))
    face_patch = np.where(faces, np.cumsum(faces) - 1, -1)
    cells, patch = world.vertices[world.triangles[kept]], face_patch[face]
    reflectance, emission, opaque = _patch_means(cells, patch, face, n_patches, world)
    name = hash32(np.uint32(zlib.crc32(ob.name.encode()))) ^ np.uint32(number)
    nothing = np.zeros(0, np.int64)
    return PatchPart(
        cells=cells,
        patch=patch,
        ids=hash32(np.arange(n_patches, dtype=np.uint32) ^ hash32(name)),
        reflectance=reflectance,
        emission=emission,
        opacity=opaque,
        shell=_shells_of(ob.mesh, patch, face, n_patches),
        face_patch=face_patch,
        element_patch=nothing,
        element_patch_of_node=nothing,
        node=nothing,
        n_nodes=0,
    )


def _shells_of(mesh: MeshArrays, patch: np.ndarray, face: np.ndarray, n_patches: int) -> np.ndarray:
    """Number of the shell of each patch (p,) int32, some of whose cells lie on the evaluated faces `face`."""
    of_face = np.zeros(len(mesh.face_start) - 1, np.int32)
    of_face[mesh.triangle_face] = mesh.shells.shell
    shell = np.zeros(n_patches, np.int32)
    shell[patch] = of_face[face]
    return shell


def _patch_means(
    cells: np.ndarray, patch: np.ndarray, face: np.ndarray, n_patches: int, world: WorldObject
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Area means over patches whose cells lie on the evaluated faces `face`.

    Reflectance and emission (p, 3), and opacity (p,), None where all are opaque.
    """
    area = triangle_areas(cells)
    area[~np.isfinite(area)] = 0.0
    total = np.maximum(np.bincount(patch, area, n_patches), np.finfo(float).tiny)[:, None]

    def mean(per_face: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(patch, area * column, n_patches) for column in per_face[face].T], -1) / total

    transmission = world.transmission
    return mean(world.reflectance), mean(world.emission), None if transmission is None else opacity(mean(transmission))


def _face_patches(mesh: MeshArrays, target: Target) -> np.ndarray:
    """The patch of each evaluated face, -1 where its patches are smaller than a face or it has no origin."""
    n_faces = len(mesh.face_start) - 1
    if target is not Target.FACE:
        return np.full(n_faces, -1)
    return np.arange(n_faces) if mesh.face_origin is None else mesh.face_origin.astype(np.int64) - 1


def _face_cells(baked: BakedObject, world: WorldObject) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (m, 3, 3), the unmodified face of each, and the evaluated face of each."""
    mesh = baked.snapshot.mesh
    cells, face = world.vertices[world.triangles], mesh.triangle_face.astype(np.int64)
    if mesh.face_origin is None:
        return cells, face, face
    origin = mesh.face_origin[face] - 1
    known = origin >= 0
    return cells[known], origin[known], face[known]


def _corner_cells(baked: BakedObject, world: WorldObject) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (m, 3, 3) around corners, the unmodified corner of each, and the evaluated face of each."""
    mesh, base = baked.snapshot.mesh, baked.base
    points = world.vertices[mesh.corner_vertex]
    if mesh.rest is not None:
        points = np.hstack([points, mesh.rest[mesh.corner_vertex]])
    cells, corner = corner_cells(points, mesh.face_start, mesh.triangle_corners, mesh.triangle_face)
    if world.triangle_corners is not mesh.triangle_corners:  # mirrored
        cells = cells[:, ::-1]
    face = face_of_corner(mesh.face_start)[corner]
    if mesh.face_origin is None:
        return cells[..., :3], corner, face
    origin = mesh.face_origin[face] - 1
    known = origin >= 0
    cells, origin, face = cells[known], origin[known], face[known]
    return cells[..., :3], _nearest_corner(base, origin, cells[..., 3:].mean(1)), face


def _nearest_corner(base: MeshArrays, face: np.ndarray, points: np.ndarray) -> np.ndarray:
    """For points (m, 3) on faces (m,) of a mesh, the corner of that face that is nearest."""
    size = np.diff(base.face_start)[face]
    first = np.cumsum(size) - size
    owner = np.repeat(np.arange(len(face)), size)
    corner = base.face_start[face[owner]] + np.arange(len(owner)) - first[owner]
    offset = base.positions[base.corner_vertex[corner]] - points[owner]
    distance = np.einsum("ij,ij->i", offset, offset)
    order = np.lexsort((distance, owner))
    return corner[order[first]].astype(np.int64)


def corner_fans(base: MeshArrays) -> np.ndarray:
    """The group, 0, 1, ..., of each corner of a mesh whose corners shade smoothly into each other, (c,) int64."""
    points = base.positions[base.corner_vertex].astype(np.float64)
    fans = smooth_fans(
        points,
        base.face_start,
        base.triangle_corners,
        base.triangle_face,
        base.corner_vertex,
        base.corner_edge,
        base.sharp_edge,
        base.sharp_face,
    )
    return np.unique(fans, return_inverse=True)[1]
