"""Surfaces that rays can hit, and patches that rays leave from.

A patch is a set of triangles, here called cells: those of a face, or of the part of the surface around a corner.
Rays start on the cells and leave about each cell's own normal, so that patches of any number of corners, convex or not,
planar or not, are sampled where they really are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..errors import GeometryError
from ..sampling import orthonormal_frames
from ..workers import workers
from .solids import Shells
from .transmission import Transmission

# Rays start this fraction of the largest coordinate of their cell above it, in coordinates centred on the scene: a
# hundred times the rounding error of float32 positions. docs/theory.md, "Numerical hazards", has the measurements.
OFFSET = 1e-5
# Slimmer triangles (height / longest edge) have no reliable normal; shorter edges than this fraction of the largest
# coordinate are rounding noise.
MIN_SLENDERNESS = 1e-6
MIN_EDGE = 1e-7
# Slimmer triangles are traced in pieces, else rays meet the face that they leave: of 200 each, none did from here on.
SLENDER = 3e-4

_SLICE = 1 << 14


@dataclass(frozen=True)
class Surfaces:
    """Everything that rays can hit.

    Attributes
    ----------
    vertices : ndarray, (v, 3) float64
        World positions in metres.
    triangles : ndarray, (t, 3) int32
    reflectance : ndarray, (t, 3) float32
        Diffuse reflectance per RGB channel in linear colour, 0 .. 1; NaN for triangles whose colour nothing sees, which
        R_ave leaves out.
    shells : Shells
        What is solid (`core.scene.solids.find_shells`); flipped triangles are turned.
    object_starts : ndarray, (o,) int
        First triangle of each object; objects out of reach of the patches are not traced.
    emission : ndarray, (t, 3) float32, or None
        Emitted radiant exitance, W/m^2; only light needs it.
    patch : ndarray, (t,) int32, or None
        The patch of which each triangle is a part, -1 for none; only radiosity needs it.
    occludes : ndarray, (t,) bool, or None
        False for triangles that no ray meets, although they may shine and count in R_ave; None where all occlude.
    transmission : Transmission or None
        What passes the triangles; None where all are opaque. The reflectance of transparent ones is of all the light
        that falls on them: that of what stops light times the opacity.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    reflectance: np.ndarray
    shells: Shells
    object_starts: np.ndarray = field(default_factory=lambda: np.zeros(1, np.int64))
    emission: np.ndarray | None = None
    patch: np.ndarray | None = None
    occludes: np.ndarray | None = None
    transmission: Transmission | None = None

    def only(self, kept: np.ndarray, vertices: np.ndarray) -> Surfaces:
        """Some of the triangles (k,) int, with other positions (v, 3) of all vertices; objects are not told apart."""
        rest = {name: getattr(self, name) for name in ("emission", "patch", "occludes")}
        return Surfaces(
            vertices,
            self.triangles[kept],
            self.reflectance[kept],
            self.shells.only(kept),
            **{name: None if values is None else values[kept] for name, values in rest.items()},
            transmission=None if self.transmission is None else self.transmission.only(kept),
        )


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
    shell : ndarray, (p,) int32, or None
        Number of the shell that each patch is a part of, as of `Shells`, 0 for none; None where that is not known, and
        then nobody is in a room.
    """

    corners: np.ndarray
    patch: np.ndarray
    ids: np.ndarray
    shell: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def none(cls) -> Patches:
        """No patch at all."""
        return cls(np.zeros((0, 3, 3)), np.zeros(0, np.int64), np.zeros(0, np.uint32), np.zeros(0, np.int32))

    def with_others(self, others: Patches) -> Patches:
        """These patches, then the others."""
        return Patches(
            np.concatenate([self.corners, others.corners]),
            np.concatenate([self.patch, others.patch + len(self)]),
            np.concatenate([self.ids, others.ids]),
            None if self.shell is None or others.shell is None else np.concatenate([self.shell, others.shell]),
        )


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
            raise GeometryError(
                "the faces to bake span more than numbers can tell: delete the vertex that is far astray"
            )
        if not half_diagonal > 0.0:
            raise GeometryError(
                "the faces to bake have no extent: all their vertices coincide, or none is finite; scale them up or "
                "repair them"
            )
        return cls(0.5 * (low + high), half_diagonal)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """World positions (..., 3) float64 -> normalised float64."""
        return (points - self.centre) / self.scale


def bounding_box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, each (3,) float64, over the finite ones of the points (..., 3); zero without any."""
    columns = points.reshape(-1, 3).T
    low, high = (np.array([f(c, initial=start) for c in columns]) for f, start in ((np.min, np.inf), (np.max, -np.inf)))
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        columns = columns[:, np.isfinite(columns).all(0)]
        if not columns.size:
            return np.zeros(3), np.zeros(3)
        low, high = columns.min(1), columns.max(1)
    return low.astype(np.float64), high.astype(np.float64)


def triangle_areas(corners: np.ndarray) -> np.ndarray:
    """Areas (t,) float64 of triangles with corners (t, 3, 3); not finite where a corner is not."""
    area = np.empty(len(corners))
    for part in slices(len(corners)):
        area[part] = 0.5 * _Shape.of(corners[part]).double_area
    return area


def usable_triangles(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which triangles have a normal that float32 tracing can rely on, as they are or cut into shorter pieces.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float64
        In normalised coordinates.
    triangles : ndarray, (t, 3) int

    Returns
    -------
    usable : ndarray, (t,) bool
        False for triangles with a corner that is not finite, of no area, or slimmer than rounding allows.
    slender : ndarray, (t,) bool
        Those that are to be cut.
    """
    usable, slender = np.empty((2, len(triangles)), bool)
    for part in slices(len(triangles)):
        shape = _Shape.of(vertices[triangles[part]])
        usable[part], slender[part] = shape.usable(), shape.is_slender()
    return usable, slender


def slices(n: int) -> Iterator[slice]:
    """Parts of n triangles that stay in the cache."""
    return (slice(at, at + _SLICE) for at in range(0, n, _SLICE))


@dataclass(frozen=True)
class _Shape:
    """Measures of m triangles; axes come first, so that every step runs along contiguous memory."""

    corners: np.ndarray  # (3 corners, 3 axes, m) float64
    normal: np.ndarray  # (3, m), of length double_area
    double_area: np.ndarray  # (m,)

    @classmethod
    def of(cls, corners: np.ndarray) -> _Shape:
        corners = np.ascontiguousarray(corners.transpose(1, 2, 0), np.float64)
        with np.errstate(invalid="ignore", over="ignore"):
            (x1, y1, z1), (x2, y2, z2) = corners[1] - corners[0], corners[2] - corners[0]
            normal = np.stack([y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2])
            return cls(corners, normal, np.sqrt((normal * normal).sum(0)))

    def extent(self) -> np.ndarray:
        """Largest coordinate of each, (m,)."""
        return np.abs(self.corners).max((0, 1))

    @cached_property
    def longest(self) -> np.ndarray:
        """Longest edge of each, (m,)."""
        with np.errstate(invalid="ignore", over="ignore"):
            edges = self.corners - np.roll(self.corners, 1, axis=0)
            return np.sqrt((edges * edges).sum(1).max(0))

    def is_slender(self) -> np.ndarray:
        """(m,) bool: whose height is tiny beside their longest edge."""
        with np.errstate(invalid="ignore", over="ignore"):
            return self.double_area < SLENDER * self.longest * self.longest

    def usable(self) -> np.ndarray:
        with np.errstate(invalid="ignore", over="ignore"):
            longest, extent = self.longest, self.extent()
            tall = self.double_area > MIN_SLENDERNESS * longest * longest
            return tall & (longest > MIN_EDGE * extent) & np.isfinite(extent)


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
    are_parallelograms : bool
        The cells are parallelograms with the edges that `frames` name, instead of triangles.
    """

    frames: np.ndarray
    offset: np.ndarray
    patch: np.ndarray
    weight: np.ndarray
    area: np.ndarray
    are_parallelograms: bool = False

    def of_patches(self, chosen: np.ndarray) -> Cells:
        """The cells of some patches, (p,) bool; the others are left without cells."""
        kept = chosen[self.patch]
        return replace(
            self, frames=self.frames[kept], offset=self.offset[kept], patch=self.patch[kept], weight=self.weight[kept]
        )


def as_triangles(cells: Cells) -> Cells:
    """The same cells as triangles: two for each parallelogram."""
    if not cells.are_parallelograms:
        return cells
    frames = np.repeat(cells.frames, 2, axis=0)
    frames[1::2, 2, :3] += frames[1::2, 0, :3] + frames[1::2, 1, :3]
    frames[1::2, :2, :3] *= np.float32(-1.0)
    offset, patch, weight = (np.repeat(values, 2) for values in (cells.offset, cells.patch, cells.weight))
    return Cells(frames, offset, patch, 0.5 * weight, cells.area)


def join_cells(one: Cells, other: Cells) -> Cells:
    """The triangles of one set of patches, then of another, whose patches are numbered after the first."""
    patch = np.concatenate([one.patch, other.patch + len(one.area)])
    parts = ((getattr(one, name), getattr(other, name)) for name in ("frames", "offset", "weight", "area"))
    frames, offset, weight, area = map(np.concatenate, parts)
    return Cells(frames, offset, patch, weight, area)


def prepare_cells(patches: Patches, normalisation: Normalisation, threads: int) -> Cells:
    """Drop unusable cells and precompute the frames of the others."""

    def prepare(part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        shape = _Shape.of(normalisation.apply(patches.corners[part]))
        usable = shape.usable()
        corners, double_area = shape.corners[..., usable], shape.double_area[usable]
        normal = shape.normal[:, usable] / double_area
        offset = OFFSET * shape.extent()[usable]
        frame = np.empty((len(offset), 3, 6), np.float32)
        frame[:, 0, :3], frame[:, 1, :3] = (corners[1] - corners[0]).T, (corners[2] - corners[0]).T
        frame[:, 2, :3] = (corners[0] + offset * normal).T
        frame[:, :, 3:] = orthonormal_frames(normal.T)
        return usable, frame, offset.astype(np.float32), 0.5 * double_area

    with workers(threads) as pool:
        parts = pool.map(prepare, slices(max(len(patches.corners), 1)))
        kept, frames, offset, cell_area = map(np.concatenate, zip(*parts, strict=True))
    patch = np.asarray(patches.patch, np.int64)[kept]
    area = np.bincount(patch, cell_area, len(patches))
    return Cells(frames, offset, patch, cell_area / area[patch], area)
