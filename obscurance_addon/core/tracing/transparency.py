"""Rays that go on behind transparent surfaces.

A ray carries a weight, not a coin: a surface of transmission T adds what it scatters, and leaves T of the rest to what
is behind it. Textures are looked up where the ray meets them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene import Lookup, Normalisation, Transmission
from .intersector import MISS, Hits, Intersector

# A ray ends where less is left of its light: what it would still find is worth at most this.
LEAST_LIGHT = 1e-3
MAX_SURFACES = 256  # that a ray passes; what is left of its light has then got through
# A ray goes on this fraction of the largest coordinate behind a hit, ten times the rounding of float32 positions.
_BEHIND, _NEAREST = np.float32(1e-6), np.float32(1e-3)
_RETRIES, _FARTHER = 8, np.float32(4.0)  # it may meet the same triangle once more, and goes on farther behind then


@dataclass(frozen=True)
class Transparency:
    """What passes the triangles of a scene, ready for casting.

    Attributes
    ----------
    row : ndarray, (t + 1,) int32
        Row of each triangle in `transmission`, -1 for opaque ones; entry 0 for misses.
    transmission : ndarray, (k, 4) float32
        Per RGB channel and without colour, the mean over each triangle.
    textured : ndarray, (k,) int32
        Row in the arrays below, -1 for those that are the same all over.
    corner, edge1, edge2 : ndarray, (m, 3) float64
        Where they stand, in the scene's normalised coordinates.
    local, lookup : ndarray, (m,) int32
        Number in the mesh, and which of the `lookups` knows it.
    """

    row: np.ndarray
    transmission: np.ndarray
    textured: np.ndarray
    corner: np.ndarray
    edge1: np.ndarray
    edge2: np.ndarray
    local: np.ndarray
    lookup: np.ndarray
    lookups: tuple[Lookup, ...]

    @classmethod
    def of(cls, transmission: Transmission | None, normalisation: Normalisation) -> Transparency | None:
        """That of triangles in the order of the intersector; None if all are opaque."""
        if transmission is None:
            return None
        clear = np.flatnonzero(transmission.mean.any(1))
        if not len(clear):
            return None
        row = np.full(len(transmission.mean) + 1, -1, np.int32)
        row[clear + 1] = np.arange(len(clear), dtype=np.int32)
        mean = transmission.mean[clear]
        corners = normalisation.apply(transmission.corners)
        return cls(
            row,
            np.column_stack([mean, mean.mean(1)]),
            transmission.textured[clear],
            corners[:, 0],
            corners[:, 1] - corners[:, 0],
            corners[:, 2] - corners[:, 0],
            transmission.local,
            transmission.lookup,
            transmission.lookups,
        )

    def lets_through(self, triangle: np.ndarray) -> np.ndarray:
        """(n,) bool: which of the triangles hit, negative for none, are transparent."""
        return self._rows(triangle) >= 0

    def mean_of(self, triangle: np.ndarray) -> np.ndarray:
        """Mean transmission (n,) float32 of triangles, without colour; 0 for opaque ones."""
        rows = self._rows(triangle)
        return np.where(rows >= 0, self.transmission[rows, 3], np.float32(0.0))

    def at(
        self, triangle: np.ndarray, origins: np.ndarray, directions: np.ndarray, distance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What passes where rays meet triangles.

        Returns
        -------
        transmission : ndarray, (n, 4) float32
            Per RGB channel and without colour; 0 for opaque triangles and misses.
        cover : ndarray, (n,) float32
            How much more the triangle covers there than on the average.
        """
        rows = self._rows(triangle)
        opaque = rows < 0
        passing, cover = np.take(self.transmission, rows, axis=0, mode="clip"), np.ones(len(rows), np.float32)
        passing[opaque] = 0.0
        if not len(self.local):
            return passing, cover
        textured = np.take(self.textured, rows, mode="clip")
        rays = np.flatnonzero((textured >= 0) & ~opaque)
        textured = textured[rays]
        if len(rays):
            points = origins[rays].astype(np.float64) + distance[rays, None].astype(np.float64) * directions[rays]
            found = self._look_up(textured, self._places(textured, points))
            mean = np.float32(1.0) - passing[rays, 3]
            passing[rays] = np.column_stack([found, found.mean(1)])
            here = np.float32(1.0) - passing[rays, 3]
            cover[rays] = np.where(mean > 0.0, here / np.where(mean > 0.0, mean, np.float32(1.0)), np.float32(0.0))
        return passing, cover

    def _rows(self, triangle: np.ndarray) -> np.ndarray:
        return np.take(self.row, triangle.astype(np.intp) + 1, mode="clip")

    def _places(self, textured: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Barycentric coordinates (n, 3) float32 of points (n, 3) on textured triangles (n,)."""
        offset, edge1, edge2 = points - self.corner[textured], self.edge1[textured], self.edge2[textured]
        a, b, c, d, e = (
            x[:, 0] * y[:, 0] + x[:, 1] * y[:, 1] + x[:, 2] * y[:, 2]
            for x, y in ((edge1, edge1), (edge1, edge2), (edge2, edge2), (offset, edge1), (offset, edge2))
        )
        with np.errstate(all="ignore"):
            determinant = a * c - b * b
            u = np.clip(np.nan_to_num((c * d - b * e) / determinant), 0.0, 1.0)
            v = np.clip(np.nan_to_num((a * e - b * d) / determinant), 0.0, 1.0 - u)
        return np.stack([1.0 - u - v, u, v], -1).astype(np.float32)

    def _look_up(self, textured: np.ndarray, places: np.ndarray) -> np.ndarray:
        found = np.empty((len(textured), 3), np.float32)
        which = self.lookup[textured]
        for number in np.unique(which):
            of = np.flatnonzero(which == number)
            found[of] = self.lookups[number](self.local[textured[of]], places[of])
        return found


class Passage:
    """Rays on their way through transparent surfaces, one after the other.

    Parameters
    ----------
    intersector : Intersector
    origins, directions : ndarray, (n, 3) float32
    limits : float32 or ndarray, (n,) float32
        Lengths beyond which nothing counts.
    hits : Hits
        The first hits of all n rays.
    rays : ndarray, (k,) int
        Those that are followed.

    Attributes
    ----------
    rays : ndarray, (k,) int
        Those that are still on their way.
    directions : ndarray, (k, 3) float32
    distance, triangle, normal : ndarray
        What they meet now, as of `Hits`, with distances from their origins.
    """

    def __init__(
        self,
        intersector: Intersector,
        origins: np.ndarray,
        directions: np.ndarray,
        limits: np.ndarray | np.float32,
        hits: Hits,
        rays: np.ndarray,
    ) -> None:
        self._intersector = intersector
        self.rays = rays
        self._origins, self.directions = np.take(origins, rays, axis=0), np.take(directions, rays, axis=0)
        self._limits = np.take(np.broadcast_to(np.float32(limits), len(origins)), rays)
        self.distance, self.triangle = np.take(hits.distance, rays), np.take(hits.triangle, rays)
        self.normal = np.take(hits.normal, rays, axis=0)

    def looked_up(self, transparency: Transparency) -> tuple[np.ndarray, np.ndarray]:
        """`Transparency.at` where the rays are now."""
        return transparency.at(self.triangle, self._origins, self.directions, self.distance)

    def hits(self) -> Hits:
        """What the rays meet now."""
        return Hits(self.distance, self.triangle, self.normal)

    def keep(self, chosen: np.ndarray) -> None:
        """Leave all but the chosen (k,) bool of the rays."""
        if chosen.all():
            return
        left = np.flatnonzero(chosen)
        for name in ("rays", "directions", "distance", "triangle", "normal", "_origins", "_limits"):
            setattr(self, name, np.take(getattr(self, name), left, axis=0))

    def go_on(self) -> None:
        """All rays go on to what is behind the triangle that they met."""
        before = self.triangle
        points = self._origins + self.distance[:, None] * self.directions
        margin = _BEHIND * np.maximum(np.abs(points).max(1, initial=_NEAREST), self.distance)
        self._meet(slice(None), margin)
        again = np.flatnonzero(self.triangle == before)
        for _ in range(_RETRIES):
            if not len(again):
                return
            margin[again] *= _FARTHER
            self._meet(again, margin[again])
            again = again[self.triangle[again] == before[again]]
        self.triangle[again], self.distance[again] = MISS, self._limits[again]

    def _meet(self, rays: np.ndarray | slice, margin: np.ndarray) -> None:
        """Find what is farther behind the present hits of some rays (m,) than margins (m,)."""
        step, limits = self.distance[rays] + margin, self._limits[rays]
        onward = self._origins[rays] + step[:, None] * self.directions[rays]
        found = self._intersector.intersect(onward, self.directions[rays], np.maximum(limits - step, np.float32(0.0)))
        distance = np.minimum(found.distance + step, limits)
        if isinstance(rays, slice):
            self.distance, self.triangle, self.normal = distance, found.triangle, found.normal
        else:
            self.distance[rays], self.triangle[rays], self.normal[rays] = distance, found.triangle, found.normal
