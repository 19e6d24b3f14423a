"""The part of a surface around each corner of its faces, and corners that one shading value serves.

The part around a corner is bounded by the corner, the midpoints of its two edges and the face's centre. Where a face is
not planar, or does not see all of itself from its centre, that outline would leave the surface: there each triangle of
the face is cut the same way instead.
"""

from __future__ import annotations

import numpy as np

from .components import connected_components

PLANARITY = 1e-6  # distance of the outline from the surface, relative to the largest coordinate: float32 rounding
COPLANAR_COSINE = np.cos(np.radians(1.0))  # flat-shaded faces that meet flatter than this show no crease


def next_corner(face_start: np.ndarray) -> np.ndarray:
    """The corner that follows each corner around its face: (f + 1,) int -> (c,) int64."""
    following = np.arange(1, face_start[-1] + 1, dtype=np.int64)
    sizes = np.diff(face_start)
    following[face_start[1:][sizes > 0] - 1] = face_start[:-1][sizes > 0]
    return following


def face_of_corner(face_start: np.ndarray) -> np.ndarray:
    """The face of each corner: (f + 1,) int -> (c,) int64."""
    return np.repeat(np.arange(len(face_start) - 1), np.diff(face_start))


def corner_cells(
    points: np.ndarray, face_start: np.ndarray, triangle_corners: np.ndarray, triangle_face: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut faces into triangular cells around their corners.

    Parameters
    ----------
    points : ndarray, (c, k) float64
        Position of each corner in the first three columns; further columns are carried along linearly.
    face_start : ndarray, (f + 1,) int
        First corner of each face, and the number of corners.
    triangle_corners : ndarray, (t, 3) int
        Triangulation, as corners.
    triangle_face : ndarray, (t,) int

    Returns
    -------
    cells : ndarray, (m, 3, k) float64
        Corners of the cells, turning the same way as the faces.
    corner : ndarray, (m,) int64
        The corner of the mesh that each cell belongs to.
    """
    face = face_of_corner(face_start)
    size = np.maximum(np.diff(face_start), 1)
    centre = np.stack([np.bincount(face, column, len(size)) for column in points.T], -1) / size[:, None]
    following = next_corner(face_start)
    previous = np.empty_like(following)
    previous[following] = np.arange(len(following))
    outline = _around(points, 0.5 * (points + points[following]), centre[face], 0.5 * (points + points[previous]))
    bad = _leaves_surface(outline, face, points, triangle_corners, triangle_face, len(size))
    kept = np.flatnonzero(~bad[face])
    if len(kept) == len(face):
        return outline.reshape(-1, 3, points.shape[1]), np.repeat(kept, 2)
    a, b, c = points[triangle_corners[bad[triangle_face]]].transpose(1, 0, 2)
    middle = (a + b + c) / 3.0
    cut = [_around(p, 0.5 * (p + q), middle, 0.5 * (p + r)) for p, q, r in ((a, b, c), (b, c, a), (c, a, b))]
    corners_cut = triangle_corners[bad[triangle_face]].T.ravel().astype(np.int64)
    cells = np.concatenate([outline[kept], *cut]).reshape(-1, 3, points.shape[1])
    return cells, np.repeat(np.concatenate([kept, corners_cut]), 2)


def _around(corner: np.ndarray, after: np.ndarray, middle: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Two triangles (n, 2, 3, k) that make up the quadrilaterals corner, after, middle, before, each (n, k)."""
    return np.stack([np.stack([corner, after, middle], 1), np.stack([corner, middle, before], 1)], 1)


def _area_vectors(triangles: np.ndarray) -> np.ndarray:
    """Normals (..., 3) of twice the length of the area of triangles (..., 3, k >= 3)."""
    a, b, c = (triangles[..., i, :3] for i in range(3))
    return np.cross(b - a, c - a)


def _face_normals(
    points: np.ndarray, triangle_corners: np.ndarray, triangle_face: np.ndarray, n_faces: int
) -> np.ndarray:
    """Unit normals (f, 3) of faces, the mean over their triangles; zero for faces without area."""
    areas = _area_vectors(points[triangle_corners])
    normal = np.stack([np.bincount(triangle_face, areas[:, k], n_faces) for k in range(3)], -1)
    return normal / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]


def _leaves_surface(
    outline: np.ndarray,
    face: np.ndarray,
    points: np.ndarray,
    triangle_corners: np.ndarray,
    triangle_face: np.ndarray,
    n_faces: int,
) -> np.ndarray:
    """(f,) bool: faces whose outline cells (c, 2, 3, k) do not lie on their triangles."""
    with np.errstate(invalid="ignore", over="ignore"):
        normal = _face_normals(points, triangle_corners, triangle_face, n_faces)
        folded = np.einsum("cij,cj->ci", _area_vectors(outline), normal[face]) < 0.0
        finite = points[np.isfinite(points[:, :3]).all(1), :3]
        extent = np.abs(finite - finite.mean(0)).max() if len(finite) else 0.0
        height = np.einsum("cj,cj->c", outline[:, 0, 0, :3] - outline[:, 0, 2, :3], normal[face])
        bent = np.abs(height) > PLANARITY * extent
    bad = np.zeros(n_faces, bool)
    bad[face[folded.any(1) | bent]] = True
    return bad


def smooth_fans(
    points: np.ndarray,
    face_start: np.ndarray,
    triangle_corners: np.ndarray,
    triangle_face: np.ndarray,
    corner_vertex: np.ndarray,
    corner_edge: np.ndarray,
    sharp_edge: np.ndarray,
    sharp_face: np.ndarray,
) -> np.ndarray:
    """Corners that share one value because shading is smooth between them.

    Two faces are smooth over their common edge when it is not marked sharp and both shade smoothly, or when both are
    flat but lie in one plane to within a degree, where no crease shows.

    Parameters
    ----------
    points : ndarray, (c, 3) float64
        Position of each corner.
    face_start, triangle_corners, triangle_face
        As for `corner_cells`.
    corner_vertex, corner_edge : ndarray, (c,) int
        Vertex of each corner, and the edge from it to the next one.
    sharp_edge : ndarray, (e,) bool
    sharp_face : ndarray, (f,) bool

    Returns
    -------
    ndarray, (c,) int64
        The same label, the smallest corner, for all corners of a fan.
    """
    face, following = face_of_corner(face_start), next_corner(face_start)
    order = np.argsort(corner_edge, kind="stable")
    uses = np.bincount(corner_edge, minlength=len(sharp_edge))
    pair_start = (np.cumsum(uses) - uses)[uses == 2]
    one, two = order[pair_start], order[pair_start + 1]
    with np.errstate(invalid="ignore", over="ignore"):
        normal = _face_normals(points, triangle_corners, triangle_face, len(sharp_face))
        coplanar = np.einsum("ij,ij->i", normal[face[one]], normal[face[two]]) > COPLANAR_COSINE
    smooth = ~(sharp_face[face[one]] | sharp_face[face[two]]) | coplanar
    smooth &= ~sharp_edge[corner_edge[one]] & (corner_vertex[one] != corner_vertex[two])
    one, two = one[smooth], two[smooth]
    links = np.concatenate([np.stack([one, following[two]], 1), np.stack([following[one], two], 1)])
    return connected_components(len(corner_vertex), links)
