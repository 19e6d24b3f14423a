"""Surfaces that shine: sampled by points on them, and met by rays; both together by multiple importance sampling.

Points on emitters find small and distant ones, cosine-distributed rays find large and near ones; the power heuristic
of Veach and Guibas (1995) weighs each sample so that neither spikes and nothing counts twice.
"""

from __future__ import annotations

import numpy as np

from ..sampling import BELOW_ONE, ascending_ends, pick, sample_triangle
from ..scene import LUMINANCE, OFFSET, Surfaces
from ..tracing import Hits
from .lamps import TINY, LampSamples

_LEAST_SHARE = np.float32(1e-15)  # of one density in another: the square of its inverse is finite in float32


class EmissiveTriangles:
    """All triangles of a scene that emit light.

    Closed solids shine outwards, open sheets to both sides, as in Cycles.

    Parameters
    ----------
    surfaces : Surfaces
        In normalised coordinates, in the order in which the intersector numbers triangles; with `emission`.
    unmet : Surfaces, optional
        Triangles that shine although no ray meets them.
    """

    name = "emissive faces"
    casts_shadow = True

    def __init__(self, surfaces: Surfaces, unmet: Surfaces | None = None) -> None:
        parts = [surfaces] if unmet is None else [surfaces, unmet]
        radiance = np.concatenate([part.emission for part in parts]) / np.float32(np.pi)
        brightness = radiance @ LUMINANCE
        shining = np.flatnonzero(brightness > 0.0)
        n_met = len(surfaces.triangles)
        self._is_met = shining < n_met
        met = surfaces.triangles[shining[self._is_met]]
        corners = surfaces.vertices[met].astype(np.float32)
        if unmet is not None:
            of_unmet = unmet.triangles[shining[~self._is_met] - n_met]
            corners = np.concatenate([corners, unmet.vertices[of_unmet].astype(np.float32)])
        edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(edge1, edge2)
        double_area = np.linalg.norm(normal, axis=1)
        power = 0.5 * double_area.astype(np.float64) * brightness[shining]
        total = power.sum()
        self._corner, self._edge1, self._edge2 = corners[:, 0], edge1, edge2
        self._normal = normal / np.maximum(double_area, TINY)[:, None]
        self._offset = OFFSET * np.abs(corners).max((1, 2))
        solid = np.concatenate([part.shells.solid for part in parts])
        self._solid = solid[shining]
        self._radiance = radiance[shining]
        self._ends = ascending_ends(np.zeros(len(shining), np.int64), power / max(total, float(TINY)))
        # Density of a point on each triangle by area, for all triangles of the scene: 0 where nothing shines.
        self._radiance_of = np.concatenate([np.zeros((1, 3), np.float32), radiance])
        self._density_of = np.concatenate([[0.0], brightness / max(total, float(TINY))]).astype(np.float32)
        self._density = self._density_of[shining + 1]
        self._solid_of = np.concatenate([[False], solid])

    def sample(self, points: np.ndarray, normals: np.ndarray, unit: np.ndarray) -> LampSamples:
        """Points on emitters, chosen by power, weighed against the rays that could meet them too."""
        picked, rest = pick(self._ends, 0, np.minimum(unit[:, 0], BELOW_ONE))
        b = sample_triangle(np.stack([rest, unit[:, 1]], -1)).astype(np.float32)
        place = self._corner[picked] + b[:, :1] * self._edge1[picked] + b[:, 1:] * self._edge2[picked]
        normal = self._normal[picked]
        side = np.sign(np.einsum("ij,ij->i", points - place, normal))
        side[self._solid[picked] & (side < 0.0)] = 0.0  # the inside of a solid
        place += (side * self._offset[picked])[:, None] * normal
        towards = place - points
        square = np.maximum(np.einsum("ij,ij->i", towards, towards), TINY)
        distance = np.sqrt(square)
        direction = towards / distance[:, None]
        facing = -side * np.einsum("ij,ij->i", direction, normal)
        cosine = np.einsum("ij,ij->i", direction, normals)
        seen = (facing > 0.0) & (cosine > 0.0)
        by_point = self._density[picked] * square / np.where(seen, facing, 1.0)  # densities by solid angle
        by_ray = np.where(self._is_met[picked], cosine / np.pi, 0.0)
        weight = np.where(seen, _power_heuristic(by_point, by_ray) / by_point, 0.0)
        received = weight[:, None].astype(np.float32) * self._radiance[picked]
        return LampSamples(direction, distance, received)

    def met(self, hits: Hits, directions: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """What cosine-distributed rays that met these hits bring, weighed against `sample`.

        Parameters
        ----------
        hits : Hits
        directions : ndarray, (n, 3) float32
        cosine : ndarray, (n,) float32
            Of the directions with the normal of the surface that they leave.

        Returns
        -------
        ndarray, (n, 3) float32
            W/m^2; the mean over rays is their part of the irradiance.
        """
        found = np.zeros((len(directions), 3), np.float32)
        rays = np.flatnonzero(self._density_of[np.maximum(hits.triangle + 1, 0)] > 0.0)
        if not len(rays):
            return found
        triangle, normal = hits.triangle[rays] + 1, hits.normal[rays]
        along = np.einsum("ij,ij->i", directions[rays], normal)
        outside = ~(self._solid_of[triangle] & (along > 0.0))
        rays, triangle, normal, along = rays[outside], triangle[outside], normal[outside], along[outside]
        facing = np.abs(along) / np.maximum(np.linalg.norm(normal, axis=1), TINY)
        by_point = self._density_of[triangle] * hits.distance[rays] ** 2 / np.maximum(facing, 1e-6)
        weight = np.float32(np.pi) * _power_heuristic(cosine[rays] / np.pi, by_point)
        found[rays] = weight[:, None].astype(np.float32) * self._radiance_of[triangle]
        return found


def _power_heuristic(own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Weight 0 .. 1 of a sample drawn with density `own` that could have been drawn with density `other`."""
    ratio = other / np.maximum(own, np.maximum(_LEAST_SHARE * np.abs(other), TINY))
    return 1.0 / (1.0 + ratio * ratio)
