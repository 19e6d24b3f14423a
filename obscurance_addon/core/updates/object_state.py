"""What an incremental bake knows of each object, and a table of all objects for tests of many boxes at once."""

from __future__ import annotations

from collections.abc import Hashable, Iterable

import numpy as np

from ..obscurance import ObscuranceSums
from ..sampling import split_rays
from ..scene import (
    OFFSET,
    Cells,
    Normalisation,
    SceneObject,
    bounding_box,
    hidden_sums,
    prepare_cells,
    surface_sums,
    usable_triangles,
)
from ..tracing import BodyShapes, ShellPoints
from .hit_cache import NO_SLOT

# Boxes grow by this share of their largest coordinate, far more than float32 rounds off positions, and boxes of patches
# by this number of ray offsets too: rays start one offset above their patch and pass eight doubled faces of four each.
_ROUNDING, _OFFSETS = 1e-6, 64.0
NO_CELLS = Cells(np.zeros((0, 3, 6), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64), *np.zeros((2, 0)))
NOTHING = np.array([[np.inf] * 3, [-np.inf] * 3])  # lowest and highest corner of an empty box


class ObjectState:
    """One object as it is now.

    Parameters
    ----------
    source : SceneObject
    key : hashable
        Its name.
    row : int
        Of the object in the `ObjectTable`.
    normalisation : Normalisation

    Attributes
    ----------
    usable : ndarray, (k,) int
        Its triangles that can be traced.
    slender : ndarray, (k,) bool
        Those of them that are traced in pieces.
    box : ndarray, (2, 3) float64
        Around these, normalised.
    cells : Cells
    patch_boxes : ndarray, (2, p, 3) float64
        Around all points from which rays of each patch start, normalised.
    rays : ndarray, (p,) int
        Rays of each patch; `share_rays` sets it, and
    count : ndarray, (c,) int
        those of each cell.
    slots : ndarray, (c,) int64
        Places of each cell in the cache, as of `LayeredCaster`.
    bodies : BodyShapes
        Numbered from its own first triangle, as are
    shells : ShellPoints
        those of what can be traced.
    rooms : ndarray, (p, depth, 2) int64, or None
        Row of the object, and number among its shells, of the rooms that each patch is in; None for none.
    sums : ObscuranceSums
    first : int
        Number in the whole scene of its first triangle.
    values : ndarray, (p, 7) float64, or None
        Finished values, None when they are out of date.
    """

    def __init__(self, source: SceneObject, key: Hashable, row: int, normalisation: Normalisation) -> None:
        self.source, self.key, self.row = source, key, row
        surfaces, patches = source.surfaces, source.patches
        vertices = normalisation.apply(surfaces.vertices)
        usable, slender = usable_triangles(vertices, surfaces.triangles)
        if surfaces.occludes is not None:
            usable &= surfaces.occludes
        self.usable, self.slender = np.flatnonzero(usable), slender[usable]
        self.box = _grown(_box_around(vertices[surfaces.triangles[self.usable]]))
        self.bodies = BodyShapes.of(
            surfaces.vertices, surfaces.triangles[self.usable], surfaces.shells.body[self.usable], normalisation.apply
        )
        self.shells = ShellPoints.of(
            surfaces.vertices, surfaces.triangles[self.usable], surfaces.shells.only(self.usable), normalisation.apply
        )
        self.rooms: np.ndarray | None = None
        transmission = surfaces.transmission
        self.is_transparent = transmission is not None and bool(transmission.mean[self.usable].any())
        self.cells = prepare_cells(patches, normalisation, threads=0)
        self.patch_boxes = _patch_boxes(self.cells, len(patches))
        self.slots = np.full(len(self.cells.patch), NO_SLOT, np.int64)
        n = len(patches)
        self.sums = ObscuranceSums(np.zeros((n, 4)), np.zeros(n), np.zeros(n), 0, tint=np.zeros((n, 3)))
        self.first = -1  # none yet
        self.values: np.ndarray | None = None
        self._patch_area = self.cells.area * normalisation.scale**2
        self._surface_sums = surface_sums(surfaces)

    def recolour(self, source: SceneObject) -> None:
        """Take over the colours of an object of the same shape."""
        self.source, self.values = source, None
        self._surface_sums = surface_sums(source.surfaces)

    def numbers(self) -> tuple[int, int]:
        """Number in the whole scene of its first triangle, and the one after its last."""
        return self.first, self.first + len(self.source.surfaces.triangles)

    def share_rays(self, rays: np.ndarray) -> None:
        """Give each patch its number of rays (p,) int."""
        self.rays = rays
        self.count = split_rays(self.cells.patch, self.cells.weight, rays)[1]

    def reflecting_sums(self) -> np.ndarray:
        """`surface_sums`, then the first four of these for what is hidden in solids, (12,) float64."""
        hidden = hidden_sums(self._patch_area, self.sums.valid, self.source.reflectance, self.source.opacity)
        return np.append(self._surface_sums, hidden)

    def forget_hits(self, places: np.ndarray | None = None) -> int:
        """Give up its places in the cache, or those of cells of which a ray has one of these places (k,), ascending.

        Returns
        -------
        int
            Number of rays that are of no more use.
        """
        if places is None:
            lost = self.slots >= 0
        else:
            lost = (self.slots >= 0) & (
                np.searchsorted(places, self.slots) != np.searchsorted(places, self.slots + self.count)
            )
        self.slots[lost | (self.slots < 0)] = NO_SLOT
        return int((self.count * lost).sum())

    def traced_box(self) -> np.ndarray:
        """Box, in metres, that decides whether the object is traced; as `build_scene` finds it; (2, 3) float64."""
        triangles = self.source.surfaces.triangles
        if not len(triangles):
            return NOTHING
        return np.stack(bounding_box(self.source.surfaces.vertices[triangles.min() : triangles.max() + 1]))


class ObjectTable:
    """Boxes and sums of all objects, a row for each; rows of objects that are gone are used again.

    Attributes
    ----------
    traced, corners : ndarray, (2, o, 3) float64
        Boxes in metres that decide what is traced: those of surfaces, and of the corners of patches.
    patches : ndarray, (2, o, 3) float64
        Boxes around all patches of each, normalised.
    present : ndarray, (o,) bool
        Whether the object is in reach of any patch of the scene, and so traced.
    areas : ndarray, (o, 12) float64
        `ObjectState.reflecting_sums`.
    """

    def __init__(self) -> None:
        self.states: list[ObjectState | None] = []
        self.traced = self.corners = self.patches = np.repeat(NOTHING[:, None], 0, axis=1)
        self.present, self.areas = np.zeros(0, bool), np.zeros((0, 12))
        self._free: list[int] = []

    def add(self) -> int:
        """A row for a new object."""
        if not self._free:
            more = len(self.states) + 1
            self._free = list(range(len(self.states), len(self.states) + more))[::-1]
            self.states += [None] * more
            self.traced, self.corners, self.patches = (
                np.concatenate([boxes, np.repeat(NOTHING[:, None], more, axis=1)], axis=1)
                for boxes in (self.traced, self.corners, self.patches)
            )
            self.present, self.areas = (
                np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)]) for a in (self.present, self.areas)
            )
        return self._free.pop()

    def put(self, state: ObjectState) -> None:
        """Enter the boxes of an object in its row."""
        row = state.row
        self.states[row] = state
        self.traced[:, row] = state.traced_box()
        self.corners[:, row] = _box_around(state.source.patches.corners)
        self.patches[:, row] = state.patch_boxes[0].min(0, initial=np.inf), state.patch_boxes[1].max(0, initial=-np.inf)
        self.refresh(state)

    def refresh(self, state: ObjectState) -> None:
        """Enter what a bake of some of its patches, or other colours, changed."""
        self.areas[state.row] = state.reflecting_sums()

    def remove(self, row: int) -> None:
        """Leave a row to others."""
        self.states[row] = None
        for boxes in (self.traced, self.corners, self.patches):
            boxes[:, row] = NOTHING
        self.areas[row] = 0.0
        self._free.append(row)

    def corner_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Box in metres of the corners of all patches, as `bounding_box` of all of them would give it."""
        low, high = self.corners[0].min(0, initial=np.inf), self.corners[1].max(0, initial=-np.inf)
        return (low, high) if np.isfinite(low).all() else (np.zeros(3), np.zeros(3))


def join_cells_of(states: Iterable[ObjectState]) -> Cells:
    """The cells of several objects, their patches numbered on."""
    cells = [NO_CELLS, *(state.cells for state in states)]
    first = np.cumsum([0, *(len(c.area) for c in cells)])
    frames, offset, weight, area = (
        np.concatenate([getattr(c, name) for c in cells]) for name in ("frames", "offset", "weight", "area")
    )
    return Cells(frames, offset, np.concatenate([c.patch + first[i] for i, c in enumerate(cells)]), weight, area)


def _box_around(points: np.ndarray) -> np.ndarray:
    """Lowest and highest corner (2, 3) of the finite ones of the points (..., 3), NOTHING for none."""
    points = points.reshape(-1, 3)
    finite = np.isfinite(points).all(1)
    return np.stack(bounding_box(points)) if finite.any() else NOTHING


def _patch_boxes(cells: Cells, n_patches: int) -> np.ndarray:
    boxes = np.repeat(NOTHING[:, None], n_patches, axis=1)
    if len(cells.patch):
        corner = cells.frames[:, 2:, :3].astype(np.float64)
        points = np.concatenate([corner, corner + cells.frames[:, :2, :3]], axis=1)
        patch, first = np.unique(cells.patch, return_index=True)
        boxes[0, patch] = np.minimum.reduceat(points.min(1), first)
        boxes[1, patch] = np.maximum.reduceat(points.max(1), first)
    return _grown(boxes, _OFFSETS * OFFSET)


def _grown(boxes: np.ndarray, share: float = 0.0) -> np.ndarray:
    """Boxes (2, ..., 3) grown by a share of their largest coordinate, and by what rounding may move them."""
    by = (share + _ROUNDING) * np.abs(boxes).max((0, -1), keepdims=True)
    with np.errstate(invalid="ignore"):  # of empty boxes
        grown = boxes + by * np.array([-1.0, 1.0]).reshape(2, *(1,) * (boxes.ndim - 1))
    return np.where(np.isfinite(boxes), grown, boxes)
