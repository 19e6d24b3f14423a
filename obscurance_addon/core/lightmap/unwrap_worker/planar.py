"""Triangles in the plane: areas, overlaps, and polygons laid flat."""

from __future__ import annotations

import numpy as np

PENETRATION = 5.0e-5  # of a chart's extent: overlaps less deep are rounding, 0.1 texel on a page of 2048
PAIRS_AT_ONCE, PAIRS_PER_MESH = 1 << 19, 5 * 10**7  # bounds memory and time
FLAT = 1.0e-9  # relative area below which a polygon's own normal says nothing


def twice_areas(triangles: np.ndarray) -> np.ndarray:
    """Twice the area of triangles (t, 3, 2 or 3); signed in the plane."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    if triangles.shape[-1] == 2:
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.linalg.norm(np.cross(a, b), axis=1)


def bounds_of(triangles: np.ndarray, chart: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (count, 2) of the triangles (t, 3, 2) of each chart; 0 for charts without any."""
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, triangles.min(1))
    np.maximum.at(high, chart, triangles.max(1))
    used = np.isfinite(low)
    return np.where(used, low, 0.0), np.where(used, high, 0.0)


def overlapping(triangles: np.ndarray, chart: np.ndarray) -> tuple[np.ndarray, bool]:
    """Pairs (p, 2) of triangles (t, 3, 2) of one chart whose insides meet, and whether the search was complete."""
    low, high = triangles.min(1), triangles.max(1)
    count = int(chart.max(initial=-1)) + 1
    start, end = bounds_of(triangles, chart, count)
    scaled = (triangles - start[chart][:, None]) / np.maximum((end - start).max(1), 1e-300)[chart][:, None, None]
    longest = np.linalg.norm(scaled - np.roll(scaled, 1, 1), axis=2).max(1)
    wide = np.flatnonzero(np.abs(twice_areas(scaled)) > 2.0 * PENETRATION * longest)
    place = scaled[wide].min(1)[:, 0] + 2.0 * chart[wide]
    wide = wide[np.argsort(place, kind="stable")]
    shape = scaled[wide]
    shape[twice_areas(shape) < 0.0] = shape[twice_areas(shape) < 0.0][:, ::-1]
    low, high, place = shape.min(1), shape.max(1), np.sort(place, kind="stable")
    last = np.searchsorted(place, high[:, 0] + 2.0 * chart[wide] - PENETRATION)
    partners = np.maximum(last - np.arange(len(wide)) - 1, 0)
    total = np.concatenate([[0], np.cumsum(partners)])
    found, first = [np.zeros((0, 2), np.int64)], 0
    while first < len(wide) and total[first] < PAIRS_PER_MESH:
        stop = max(first + 1, int(np.searchsorted(total, total[first] + PAIRS_AT_ONCE, "right")) - 1)
        a = np.repeat(np.arange(first, stop), partners[first:stop])
        b = a + 1 + np.arange(len(a)) - (total[a] - total[first])
        near = (low[b, 1] < high[a, 1] - PENETRATION) & (low[a, 1] < high[b, 1] - PENETRATION)
        a, b = a[near], b[near]
        meet = ~(apart(shape[a], shape[b]) | apart(shape[b], shape[a]))
        found.append(np.stack([wide[a[meet]], wide[b[meet]]], 1))
        first = stop
    return np.concatenate(found), first == len(wide)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(p,) whether an edge of the anticlockwise triangle a (p, 3, 2) has all of b beyond it."""
    edge = np.roll(a, -1, 1) - a
    outwards = np.stack([edge[..., 1], -edge[..., 0]], -1) / np.linalg.norm(edge, axis=2)[..., None]
    depth = np.einsum("pek,pvk->pev", outwards, b) - np.einsum("pek,pek->pe", outwards, a)[..., None]
    return (depth.min(2) > -PENETRATION).any(1)


def overlaps_itself(triangles: np.ndarray) -> bool:
    """Whether the triangles (t, 3, 2) of a face are turned over or lie on each other."""
    signed = twice_areas(triangles)
    if np.abs(signed).sum() - signed.sum() > PENETRATION * np.abs(signed).sum():
        return True
    return len(triangles) > 2 and len(overlapping(triangles, np.zeros(len(triangles), int))[0]) > 0


def projected(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The corners (n, 2) of a polygon (n, 3) of triangles (t, 3, 3) on its own plane (Newell's normal)."""
    points = points - points.mean(0)
    normal = np.cross(points, np.roll(points, -1, 0)).sum(0)
    if not np.linalg.norm(normal) > FLAT * twice_areas(triangles).sum():
        edges = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        normal = np.cross(*edges)[twice_areas(triangles).argmax()]
    edges = np.roll(points, -1, 0) - points
    along = edges[(edges**2).sum(1).argmax()]
    across = np.cross(normal, along)
    return points @ np.stack([along / np.linalg.norm(along), across / (np.linalg.norm(across) or 1.0)], 1)


def unfolded(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The corners (n, 2) of a polygon (n, 3), its triangles (t, 3) turned about their common edges into one plane."""
    flat = np.zeros((len(points), 2))
    left = [tuple(triangle) for triangle in triangles.tolist()]
    a, b, c = left.pop(int(twice_areas(points[triangles]).argmax()))
    flat[b] = np.linalg.norm(points[b] - points[a]), 0.0
    flat[c] = flat[a] + hinged(points, flat, a, b, c)
    placed = {a, b, c}
    while left:
        turns = [(n, k) for n, t in enumerate(left) for k in range(3) if {t[k], t[k - 2]} <= placed]
        if not turns:
            break  # not one piece
        n, k = turns[0]
        triangle = left.pop(n)
        a, b, c = triangle[k], triangle[k - 2], triangle[k - 1]
        if c not in placed:
            flat[c] = flat[a] + hinged(points, flat, a, b, c)
            placed.add(c)
    return flat


def hinged(points: np.ndarray, flat: np.ndarray, a: int, b: int, c: int) -> np.ndarray:
    """From a to c (2,) in the plane where a and b have their places already, c on the left of these."""
    edge, to = points[b] - points[a], points[c] - points[a]
    length = float(np.linalg.norm(edge))
    along = float(to @ edge) / length if length else 0.0
    away = max(float(to @ to) - along**2, 0.0) ** 0.5
    direction = flat[b] - flat[a]
    direction = direction / (np.linalg.norm(direction) or 1.0) if length else np.array([1.0, 0.0])
    return along * direction + away * np.array([-direction[1], direction[0]])
