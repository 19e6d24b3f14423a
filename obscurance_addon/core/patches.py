"""Surfaces that rays can hit, and patches that rays leave from.

A patch is a set of triangles, here called cells: those of a face, or of the part of the surface around a corner.
Rays start on the cells and leave about each cell's own normal, so that patches of any number of corners, convex or not,
planar or not, are sampled where they really are.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .errors import GeometryError

# Rays start this fraction of the largest coordinate of their cell above it, in coordinates centred on the scene: a
# hundred times the rounding error of float32 positions. docs/theory.md, "Numerical hazards", has the measurements.
OFFSET = 1e-5
# Slimmer triangles (height / longest edge) have no reliable normal; shorter edges than this fraction of the largest
# coordinate are rounding noise.
MIN_SLENDERNESS = 1e-6
MIN_EDGE = 1e-7


@dataclass(frozen=True)
class Surfaces:
    """Everything that rays can hit.

    Attributes
    ----------
    vertices : ndarray, (v, 3) float64
        World positions in metres.
    triangles : ndarray, (t, 3) int32
    reflectance : ndarray, (t, 3) float32
        Diffuse reflectance per RGB channel in linear colour, 0 .. 1.
    solid : ndarray, (t,) bool
        Triangles of closed solids seen from outside (`core.solids.solid_triangles`).
    object_starts : ndarray, (o,) int
        First triangle of each object; objects out of reach of the patches are not traced.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    reflectance: np.ndarray
    solid: np.ndarray
    object_starts: np.ndarray = field(default_factory=lambda: np.zeros(1, np.int64))


@dataclass(frozen=True)
class Patches:
    """Where rays leave from.

    Attributes
    ----------
    corners : ndarray, (c, 3, 3) float64
        World positions of the corners of each cell, counter-clockwise seen from outside, metres.
    patch : ndarray, (c,) int
        Patch of each cell, ascending. Patches without a cell are allowed and come out invalid.
    ids : ndarray, (p,) uint32
        Stable identity of each patch: the same id casts the same rays.
    """

    corners: np.ndarray
    patch: np.ndarray
    ids: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Normalisation:
    """Recentres and rescales to coordinates of the order of 1, in float64, before anything becomes float32."""

    centre: np.ndarray
    scale: float  # metres per unit

    @classmethod
    def of(cls, points: np.ndarray) -> Normalisation:
        """Centre and half diagonal of the bounding box of the finite points, (..., 3) float64 metres.

        Raises
        ------
        GeometryError
            When the points have no extent.
        """
        low, high = bounding_box(points)
        with np.errstate(over="ignore"):
            half_diagonal = 0.5 * float(np.linalg.norm(high - low))
        if half_diagonal == np.inf:
            raise GeometryError("the faces to bake span more than numbers can tell: a vertex is far astray")
        if not half_diagonal > 0.0:
            raise GeometryError("the faces to bake have no extent: all their vertices coincide, or none is finite")
        return cls(0.5 * (low + high), half_diagonal)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """World positions (..., 3) float64 -> normalised float64."""
        return (points - self.centre) / self.scale


def bounding_box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, each (3,) float64, over the finite ones of the points (..., 3); zero without any."""
    points = points.reshape(-1, 3)
    low, high = points.min(0, initial=np.inf), points.max(0, initial=-np.inf)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        points = points[np.isfinite(points).all(1)]
        if not len(points):
            return np.zeros(3), np.zeros(3)
        low, high = points.min(0), points.max(0)
    return low.astype(np.float64), high.astype(np.float64)


def triangle_areas(corners: np.ndarray) -> np.ndarray:
    """Areas (n,) of triangles (n, 3, 3) in the square of their unit; not finite where a corner is not."""
    with np.errstate(invalid="ignore", over="ignore"):
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * np.sqrt(np.einsum("ij,ij->i", normal, normal))


def usable_triangles(corners: np.ndarray) -> np.ndarray:
    """Which triangles have a normal that float32 tracing can rely on.

    Parameters
    ----------
    corners : ndarray, (n, 3, 3) float64
        In normalised coordinates.

    Returns
    -------
    ndarray, (n,) bool
        False for triangles with a corner that is not finite, of no area, or slimmer than rounding allows.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        edges = corners - np.roll(corners, 1, axis=1)
        longest = np.sqrt(np.einsum("nij,nij->ni", edges, edges).max(1))
        height = 2.0 * triangle_areas(corners) / np.where(longest > 0.0, longest, 1.0)
        extent = np.abs(corners).max((1, 2))
        return (height > MIN_SLENDERNESS * longest) & (longest > MIN_EDGE * extent) & np.isfinite(extent)


@dataclass(frozen=True)
class Cells:
    """The usable cells of patches, in normalised float32, ready for the matrix products of the ray table.

    Attributes
    ----------
    frames : ndarray, (c, 3, 6) float32
        A ray table's row (b1, b2, 1 | x, y, z) gives the origin by the first three columns, the direction by the rest.
    offset : ndarray, (c,) float32
        Distance of the origins from the cell.
    patch : ndarray, (c,) int64
    weight : ndarray, (c,) float64
        Share of the patch's area.
    area : ndarray, (p,) float64
        Usable area of each patch, normalised units squared.
    """

    frames: np.ndarray
    offset: np.ndarray
    patch: np.ndarray
    weight: np.ndarray
    area: np.ndarray


def prepare_cells(patches: Patches, normalisation: Normalisation) -> Cells:
    """Drop unusable cells and precompute the frames of the others."""
    from .sampling import orthonormal_frames

    corners = normalisation.apply(patches.corners)
    usable = usable_triangles(corners)
    if not usable.all():
        corners = corners[usable]
    patch = np.asarray(patches.patch, np.int64)[usable]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(edge1, edge2)
    double_area = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    normal /= double_area[:, None]
    offset = OFFSET * np.abs(corners).max((1, 2))
    frames = np.empty((len(corners), 3, 6), np.float32)
    frames[:, 0, :3], frames[:, 1, :3] = edge1, edge2
    frames[:, 2, :3] = corners[:, 0] + offset[:, None] * normal
    frames[:, :, 3:] = orthonormal_frames(normal)
    area = np.bincount(patch, 0.5 * double_area, len(patches))
    return Cells(frames, offset.astype(np.float32), patch, 0.5 * double_area / area[patch], area)
