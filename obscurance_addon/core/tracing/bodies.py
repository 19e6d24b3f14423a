"""Which rays start inside of a body: each body has a ray tracer of its own.

A ray starts inside of a body if, of all surfaces of that body, it meets the inside of one first. What stands between,
or touches the body, has no part in that, so bodies may overlap, and walls may coincide. The first hit among all
surfaces costs nothing more, but may be of something else that stands in there: it picks the patches for whose rays the
bodies are asked one by one.
"""

from __future__ import annotations

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ..scene import OFFSET
from .embree import EmbreeIntersector
from .intersector import Hits, Intersector

FAR = np.float32(1e30)  # stands for an infinite ray length, so that 0 x length stays 0
_GROWN_OFFSETS = 2.0  # by which boxes are grown, for rays start one of them above surfaces
_DIRECTIONS = np.float32([(0.36, 0.48, 0.8), (-0.48, -0.6, -0.64), (0.6, -0.64, 0.48)])  # along no axis or diagonal
_GROUP = 64  # neighbouring rays that are looked up among the boxes of bodies at once
_KEPT_TRACERS = 256  # embreex crashes beyond a thousand of them; to build one for a few triangles takes 0.1 ms


@dataclass(frozen=True)
class BodyShapes:
    """Shapes of k bodies, normalised.

    Attributes
    ----------
    numbers : ndarray, (k,) int32
        Ascending, above 0.
    boxes : ndarray, (2, k, 3) float64
        Lowest and highest corner of each, grown by what rays start above surfaces.
    corners : list of callable
        Each gives the corners (t, 3, 3) of the triangles of a body.
    """

    numbers: np.ndarray
    boxes: np.ndarray
    corners: list[Callable[[], np.ndarray]]

    @classmethod
    def of(
        cls, vertices: np.ndarray, triangles: np.ndarray, body: np.ndarray, apply: Callable = lambda points: points
    ) -> BodyShapes:
        """Those of the bodies (t,) int32 that triangles (t, 3) bound, 0 for none.

        `apply` normalises some of the vertices (v, 3) float64.
        """
        solid = np.flatnonzero(body)
        triangles = triangles[solid[np.argsort(body[solid], kind="stable")]]
        numbers, first = np.unique(np.sort(body[solid]), return_index=True)
        boxes = np.zeros((2, len(numbers), 3))
        if len(numbers):
            points = apply(vertices)
            for axis, column in enumerate(points.T):
                of_corner = column[triangles]
                boxes[0, :, axis] = np.minimum.reduceat(of_corner.min(1), first)
                boxes[1, :, axis] = np.maximum.reduceat(of_corner.max(1), first)
            grow = _GROWN_OFFSETS * OFFSET * np.abs(boxes).max((0, 2))[:, None]
            boxes += np.stack([-grow, grow])
        corners = [functools.partial(_corners, vertices, part, apply) for part in np.split(triangles, first[1:])]
        return cls(numbers.astype(np.int32), boxes, corners[: len(numbers)])

    def numbered_from(self, first: int) -> BodyShapes:
        """The same where the first triangle is number `first` of a larger scene."""
        return BodyShapes(self.numbers + np.int32(first), self.boxes, self.corners)

    @classmethod
    def joined(cls, parts: Iterable[BodyShapes]) -> BodyShapes:
        """Those of several objects, of ascending numbers."""
        parts = [part for part in parts if len(part.numbers)]
        return cls(
            np.concatenate([np.zeros(0, np.int32), *(part.numbers for part in parts)]),
            np.concatenate([np.zeros((2, 0, 3)), *(part.boxes for part in parts)], axis=1),
            [corners for part in parts for corners in part.corners],
        )


def _corners(vertices: np.ndarray, triangles: np.ndarray, apply: Callable) -> np.ndarray:
    """Corners (t, 3, 3) of triangles (t, 3)."""
    return apply(vertices[triangles])


class Bodies:
    """The bodies of a scene. Calls may come from several threads at once.

    Parameters
    ----------
    of_triangle : ndarray, (t + 1,) int32
        Number of the body that each triangle bounds, 0 for none; entry 0 is for misses.
    shapes : BodyShapes
    before : Bodies, optional
        Of the scene before it changed: ray tracers of bodies that are the same are taken over.
    """

    def __init__(self, of_triangle: np.ndarray, shapes: BodyShapes, before: Bodies | None = None) -> None:
        self._of_triangle, self._shapes = of_triangle, shapes
        self._tracers: OrderedDict[Callable, Intersector] = OrderedDict()  # by what gives the corners
        if before is not None:
            same = set(shapes.corners)
            self._tracers.update((key, tracer) for key, tracer in before._tracers.items() if key in same)
        self._lock = threading.Lock()

    @property
    def numbers(self) -> np.ndarray:
        """Of the bodies, (k,) int32."""
        return self._shapes.numbers

    @property
    def boxes(self) -> np.ndarray:
        """Lowest and highest corners of the bodies, (2, k, 3) float64."""
        return self._shapes.boxes

    def without(self, numbers: np.ndarray) -> Bodies | None:
        """The scene where some of the bodies are none, None where no other is left."""
        if not len(numbers):
            return self
        kept = np.flatnonzero(~np.isin(self.numbers, numbers))
        shapes = BodyShapes(self.numbers[kept], self._shapes.boxes[:, kept], [self._shapes.corners[i] for i in kept])
        of_triangle = np.where(np.isin(self._of_triangle, numbers), 0, self._of_triangle)
        return Bodies(of_triangle, shapes, self) if len(kept) else None

    def left_first(self, directions: np.ndarray, hits: Hits) -> np.ndarray:
        """(n,) bool: rays whose first hit among all surfaces is the inside of a body."""
        inside = meet_back(directions, hits)
        inside &= np.take(self._of_triangle, hits.triangle + 1, mode="clip") > 0
        return inside

    def spare_rooms(self, inside: np.ndarray, hits: Hits, rooms: np.ndarray | None) -> None:
        """Take rays out of those of `left_first` that meet a room of theirs, as of `start_inside`."""
        if rooms is not None:
            rays = np.flatnonzero(inside)
            inside[rays] = (self._of_triangle[hits.triangle[rays] + 1, None] != rooms[rays]).all(1)

    def start_inside(
        self, origins: np.ndarray, directions: np.ndarray, rooms: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Which rays start inside of a body, (n,) bool, and the number of rays cast to find out.

        `rooms` (n, depth) int32 are bodies that are not asked, for each ray.
        """
        inside, cast = np.zeros(len(origins), bool), 0
        first = np.arange(0, len(origins), _GROUP)
        if not len(first):
            return inside, cast
        low, high = np.minimum.reduceat(origins, first), np.maximum.reduceat(origins, first)
        boxes = self._shapes.boxes
        for row in np.flatnonzero(_overlap(boxes, (low.min(0), high.max(0)))):
            box = boxes[:, row]
            groups = first[_overlap((low, high), box)]
            rays = (groups[:, None] + np.arange(_GROUP)).ravel()
            rays = rays[rays < len(origins)]
            rays = rays[~inside[rays] & _overlap((origins[rays], origins[rays]), box)]
            if rooms is not None:
                rays = rays[(rooms[rays] != self.numbers[row]).all(1)]
            if len(rays):
                towards = directions[rays]
                hits = self._tracer(row).intersect(origins[rays], towards, np.full(len(rays), FAR, np.float32))
                inside[rays] = (hits.triangle >= 0) & meet_back(towards, hits)
                cast += len(rays)
        return inside, cast

    def contains(self, row: int, points: np.ndarray) -> np.ndarray:
        """(m,) bool: points (m, 3) float32 inside of a body: rays in most directions meet its inside first."""
        tracer, votes = self._tracer(row), np.zeros(len(points), int)
        for direction in _DIRECTIONS:
            towards = np.broadcast_to(direction, points.shape).copy()
            hits = tracer.intersect(points, towards, np.full(len(points), FAR, np.float32))
            votes += (hits.triangle >= 0) & meet_back(towards, hits)
        return 2 * votes > len(_DIRECTIONS)

    def _tracer(self, row: int) -> Intersector:
        body = self._shapes.corners[row]
        with self._lock:
            if body not in self._tracers:
                vertices, index = np.unique(body().astype(np.float32).reshape(-1, 3), axis=0, return_inverse=True)
                self._tracers[body] = EmbreeIntersector(vertices, index.reshape(-1, 3))
            self._tracers.move_to_end(body)
            while len(self._tracers) > _KEPT_TRACERS:
                self._tracers.popitem(last=False)
            return self._tracers[body]


def meet_back(directions: np.ndarray, hits: Hits) -> np.ndarray:
    """(n,) bool: rays that meet the back of a triangle; for misses, anything."""
    with np.errstate(all="ignore"):  # normals of misses hold anything
        along = directions[:, 0] * hits.normal[:, 0]  # coordinate by coordinate, as directions lie in memory
        along += directions[:, 1] * hits.normal[:, 1]
        along += directions[:, 2] * hits.normal[:, 2]
        return along > 0.0


def _overlap(boxes: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(m,) bool: which boxes, lowest and highest corners (m, 3), overlap another one."""
    return ((boxes[0] <= other[1]) & (boxes[1] >= other[0])).all(-1)
