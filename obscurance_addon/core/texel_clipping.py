"""Which squares of a page a triangle covers wholly or partly, and what it cuts off the latter."""

from __future__ import annotations

import numpy as np

_SLICE = 1 << 15  # squares cut at once: they stay in the cache
_MOST_CORNERS = 7  # of a square cut by a triangle


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


def cut_squares(uv: np.ndarray, triangle: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Texels (m,) cut by triangles: polygons (k, 7, 2), their numbers of corners, and triangle, x, y of each."""
    found = []
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    for at in range(0, len(x), _SLICE):
        part = slice(at, at + _SLICE)
        corner = np.stack([x[part], y[part]], -1)
        polygon = np.zeros((len(corner), _MOST_CORNERS, 2))
        polygon[:, :4] = corner[:, None] + square
        count = np.full(len(polygon), 4)
        own = uv[triangle[part]]
        for k in range(3):
            _clip(polygon, count, own[:, k], own[:, (k + 1) % 3])
        kept = np.flatnonzero(count > 2)
        found.append((polygon[kept], count[kept], triangle[part][kept], x[part][kept], y[part][kept]))
    if not found:
        none = np.zeros(0, np.int64)
        return np.zeros((0, _MOST_CORNERS, 2)), none, none, none, none
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def _clip(polygon: np.ndarray, count: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    """Leave of convex polygons (m, 7, 2) with `count` (m,) corners what is left of the lines from a to b, each (m, 2).

    Most polygons lie on one side of a line; only the others are cut.
    """
    edge = b - a
    away = edge[:, None, 0] * (polygon[..., 1] - a[:, None, 1]) - edge[:, None, 1] * (polygon[..., 0] - a[:, None, 0])
    used = np.arange(_MOST_CORNERS) < count[:, None]
    outside = ((away < 0.0) & used).sum(1)
    crossing = np.flatnonzero((outside > 0) & (outside < count))
    count[outside == count] = 0
    if len(crossing):
        polygon[crossing], count[crossing] = _cut(polygon[crossing], count[crossing], away[crossing], used[crossing])


def _cut(polygon: np.ndarray, count: np.ndarray, away: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Polygons (m, 7, 2) and their numbers of corners where `away` (m, 7), a distance, is not negative."""
    m, k, _ = polygon.shape
    corner = np.arange(k)
    following = np.where(corner + 1 < count[:, None], corner + 1, 0)
    away_next = np.take_along_axis(away, following, 1)
    inside = away >= 0.0
    crosses = used & (inside != (away_next >= 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        t = away / (away - away_next)
        cut = polygon + t[..., None] * (np.take_along_axis(polygon, following[..., None], 1) - polygon)
    corners = np.stack([polygon, cut], 2).reshape(m, 2 * k, 2)
    kept = np.stack([inside & used, crosses], 2).reshape(m, 2 * k)
    order = np.argsort(~kept, axis=1, kind="stable")[:, :k]
    return np.take_along_axis(corners, order[..., None], 1), kept.sum(1)


def polygon_areas(polygon: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Areas (m,) of polygons (m, k, 2) with `count` corners."""
    corner = np.arange(polygon.shape[1])
    shifted = polygon - polygon[:, :1]
    x, y = shifted[..., 0], shifted[..., 1]
    with np.errstate(invalid="ignore", over="ignore"):  # corners beyond `count` hold anything
        cross = x[:, :-1] * y[:, 1:] - y[:, :-1] * x[:, 1:]
    return 0.5 * np.where(corner[1:] < count[:, None], cross, 0.0).sum(1)
