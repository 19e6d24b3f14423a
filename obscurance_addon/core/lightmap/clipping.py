"""Which squares of a page a triangle covers wholly or partly, and what it cuts off the latter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_SLICE = 1 << 14  # squares cut at once: they stay in the cache
_SQUARE = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])


def spans(uv: np.ndarray, rows: tuple[int, int], size: int) -> tuple[tuple, tuple]:
    """(triangle, x, y) of texels wholly in a triangle, and of those that are partly in it, within the rows."""
    bottom = np.maximum(np.floor(uv[..., 1].min(1)), rows[0]).astype(np.int64)
    top = np.minimum(np.ceil(uv[..., 1].max(1)), rows[1]).astype(np.int64)
    triangle, line = ranges(bottom, top + 1)
    left, right = _crossings(uv[triangle], line)
    is_row = np.flatnonzero(line < top[triangle])  # the line above belongs to the same triangle
    triangle, y = triangle[is_row], line[is_row]
    corner_x, corner_y = uv[triangle, :, 0], uv[triangle, :, 1]
    within = (corner_y >= y[:, None]) & (corner_y <= y[:, None] + 1)
    far_left = np.where(within, corner_x, np.inf).min(1)
    far_right = np.where(within, corner_x, -np.inf).max(1)
    below, above = left[is_row], left[is_row + 1]
    first = np.ceil(np.maximum(below, above))
    outer_first = np.floor(np.minimum(np.minimum(below, above), far_left))
    below, above = right[is_row], right[is_row + 1]
    end = np.floor(np.minimum(below, above))
    outer_end = np.ceil(np.maximum(np.maximum(below, above), far_right))
    first, end, outer_first, outer_end = (
        np.clip(x, 0, size).astype(np.int64) for x in (first, end, outer_first, outer_end)
    )
    none = end <= first
    first, end = np.where(none, outer_end, first), np.where(none, outer_end, end)
    inner_row, inner_x = ranges(first, end)
    left_row, left_x = ranges(outer_first, first)
    right_row, right_x = ranges(end, outer_end)
    outer_row, outer_x = np.concatenate([left_row, right_row]), np.concatenate([left_x, right_x])
    return (triangle[inner_row], inner_x, y[inner_row]), (triangle[outer_row], outer_x, y[outer_row])


def ranges(first: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All whole numbers of the ranges first .. end - 1, each (k,), and the range that each belongs to."""
    count = np.maximum(end - first, 0)
    owner = np.repeat(np.arange(len(first)), count)
    return owner, np.arange(len(owner)) + np.repeat(first - (np.cumsum(count) - count), count)


def _crossings(uv: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where horizontal lines (k,) enter and leave triangles (k, 3, 2); inf and -inf where they miss."""
    left, right = np.full(len(line), np.inf), np.full(len(line), -np.inf)
    for k in range(3):
        ax, ay = uv[:, k].T
        bx, by = uv[:, (k + 1) % 3].T
        met = (np.minimum(ay, by) <= line) & (line <= np.maximum(ay, by))
        with np.errstate(invalid="ignore", divide="ignore"):
            x = ax + (line - ay) * (bx - ax) / (by - ay)
        level = ay == by
        low, high = np.where(level, np.minimum(ax, bx), x), np.where(level, np.maximum(ax, bx), x)
        left[met], right[met] = np.minimum(left[met], low[met]), np.maximum(right[met], high[met])
    return left, right


@dataclass(frozen=True)
class Polygons:
    """Convex polygons with three corners or more, counter-clockwise: m of them with v corners, one after the other.

    Attributes
    ----------
    x, y : ndarray, (v,) float64
    count : ndarray, (m,) int64
        Corners of each.
    """

    x: np.ndarray
    y: np.ndarray
    count: np.ndarray

    def fans(self) -> Fans:
        """The triangles that they consist of."""
        end = np.cumsum(self.count)
        is_second = np.ones(len(self.x), bool)
        is_second[end - self.count] = is_second[end - 1] = False
        second = np.flatnonzero(is_second)
        first = np.repeat(end - self.count, self.count - 2)
        x, y = self.x[first], self.y[first]
        edges = np.stack([self.x[second] - x, self.y[second] - y, self.x[second + 1] - x, self.y[second + 1] - y])
        return Fans(x, y, edges, 0.5 * (edges[0] * edges[3] - edges[1] * edges[2]), self.count - 2)


@dataclass(frozen=True)
class Fans:
    """The f triangles of m polygons, those of one after those of the other.

    Attributes
    ----------
    x, y : ndarray, (f,) float64
        First corner.
    edges : ndarray, (4, f) float64
        From there to the second corner along x and y, then to the third.
    area : ndarray, (f,) float64
    count : ndarray, (m,) int64
        Triangles of each polygon.
    """

    x: np.ndarray
    y: np.ndarray
    edges: np.ndarray
    area: np.ndarray
    count: np.ndarray

    def areas_of_polygons(self) -> np.ndarray:
        """(m,) float64."""
        return np.bincount(np.repeat(np.arange(len(self.count)), self.count), self.area, len(self.count))

    def of_polygons(self, chosen: np.ndarray) -> tuple[Fans, np.ndarray]:
        """Those of some polygons (k,) int that have an area, polygon by polygon, and which polygon each belongs to."""
        first = np.cumsum(self.count) - self.count
        owner, kept = ranges(first[chosen], first[chosen] + self.count[chosen])
        has_area = self.area[kept] > 0.0  # a cell without area would get rays all the same
        owner, kept = owner[has_area], kept[has_area]
        count = np.bincount(owner, minlength=len(chosen))
        return Fans(self.x[kept], self.y[kept], self.edges[:, kept], self.area[kept], count), owner


def cut_squares(
    uv: np.ndarray, triangle: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[Polygons, np.ndarray, np.ndarray, np.ndarray]:
    """Texels (n,) cut by triangles: what polygons are left, and triangle, x, y of each."""
    found = []
    for at in range(0, len(x), _SLICE):
        part = slice(at, at + _SLICE)
        own = uv[triangle[part]]
        count = np.full(len(own), 4)
        corner_x = (x[part, None] + _SQUARE[0]).ravel()
        corner_y = (y[part, None] + _SQUARE[1]).ravel()
        for k in range(3):
            corner_x, corner_y, count = _clip(corner_x, corner_y, count, own[:, k], own[:, (k + 1) % 3])
        kept = count > 2
        is_kept = np.repeat(kept, count)
        found.append(
            (corner_x[is_kept], corner_y[is_kept], count[kept], triangle[part][kept], x[part][kept], y[part][kept])
        )
    if not found:
        none = np.zeros(0, np.int64)
        return Polygons(np.zeros(0), np.zeros(0), none), none, none, none
    corner_x, corner_y, count, *rest = map(np.concatenate, zip(*found, strict=True))
    return Polygons(corner_x, corner_y, count), *rest


def _clip(
    x: np.ndarray, y: np.ndarray, count: np.ndarray, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is left of the lines from a to b, each (m, 2), of polygons as of `Polygons`, but with any count."""
    start = np.concatenate([[0], np.cumsum(count)])
    edge_x, edge_y, at_x, at_y = (np.repeat(values, count) for values in (*(b - a).T, *a.T))
    away = edge_x * (y - at_y) - edge_y * (x - at_x)
    following = np.arange(1, len(x) + 1)
    some = count > 0
    following[start[1:][some] - 1] = start[:-1][some]
    inside = away >= 0.0
    crosses = inside != inside[following]
    end = np.concatenate([[0], np.cumsum(inside.view(np.int8) + crosses.view(np.int8), dtype=np.int64)])
    crossing = np.flatnonzero(crosses)
    beyond = following[crossing]
    t = away[crossing] / (away[crossing] - away[beyond])
    kept, cut = end[:-1][inside], end[1:][crossing] - 1
    out = []
    for values in (x, y):
        out.append(np.empty(end[-1]))
        out[-1][kept] = values[inside]
        out[-1][cut] = values[crossing] + t * (values[beyond] - values[crossing])
    return *out, np.diff(end[start])
