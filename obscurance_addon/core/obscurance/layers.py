"""What rays find that pass transparent surfaces: eq. 5 layer by layer.

A surface at distance d adds T rho(d) R, where T is what the surfaces before it let through and R is for all the light
that falls on it. What is left at d_max adds T R_ave. Without colour, T is the mean over the channels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..falloff import Falloff, apply_falloff
from ..tracing import LEAST_LIGHT, MAX_SURFACES, Hits, Passage, TracedScene, starts_inside


@dataclass(frozen=True)
class Layered:
    """Sums along k rays that meet a transparent surface first.

    Attributes
    ----------
    rays : ndarray, (k,) int
        Which of all rays they are.
    hit : ndarray, (k, 4) float64
        T rho R per RGB channel, and T rho times the opacity.
    miss : ndarray, (k, 4) float64
        What is left where nothing more is met nearer than d_max, per channel and without colour.
    inside : ndarray, (k,) bool
        Rays that start inside of a solid; their sums are 0.
    farthest : ndarray, (k,) float32
        Distance of the last surface that each met.
    """

    rays: np.ndarray
    hit: np.ndarray
    miss: np.ndarray
    inside: np.ndarray
    farthest: np.ndarray


def sum_layers(
    scene: TracedScene, origins: np.ndarray, directions: np.ndarray, limit: np.float32, hits: Hits
) -> Layered:
    """Follow the rays (n,) whose first hit is transparent, up to `limit`.

    Surfaces from d_max on add nothing; they only tell whether the ray started inside of a solid.
    """
    rays = np.flatnonzero(scene.transparency.lets_through(hits.triangle))
    passage = Passage(scene.intersector, origins, directions, limit, hits, rays)
    index = np.arange(len(rays))  # of those that are still on their way
    light, counts = np.ones((len(rays), 4)), np.ones(len(rays), bool)
    found = Layered(rays, np.zeros((len(rays), 4)), np.zeros((len(rays), 4)), ~counts, hits.distance[rays].copy())
    for _ in range(MAX_SURFACES):
        if not len(index):
            break
        transmission, cover = passage.looked_up(scene.transparency)
        met = passage.triangle >= 0
        near = met & (passage.distance < scene.limit)
        _add(scene, found.hit, index[near], light, passage.triangle[near], passage.distance[near], cover[near])
        escaped = index[~near & counts[index]]
        found.miss[escaped], counts[escaped] = light[escaped], False
        found.farthest[index[met]] = passage.distance[met]
        if scene.solid is not None:
            here = Hits(passage.distance, passage.triangle, passage.normal)
            found.inside[index] = starts_inside(scene, directions[passage.rays], here) & met
        light[index] *= transmission
        onward = scene.transparency.lets_through(passage.triangle) & (light[index].max(1) > LEAST_LIGHT)
        passage.keep(onward)
        index = index[onward]
        passage.go_on()
    left = index[counts[index]]
    found.miss[left] = light[left]
    found.hit[found.inside], found.miss[found.inside] = 0.0, 0.0
    return found


def _add(
    scene: TracedScene,
    sums: np.ndarray,
    index: np.ndarray,
    light: np.ndarray,
    triangle: np.ndarray,
    distance: np.ndarray,
    cover: np.ndarray,
) -> None:
    """Add what one surface on each of some rays (m,) int scatters."""
    if scene.falloff is Falloff.STEP or not len(index):  # of which a hit adds nothing
        return
    rho = apply_falloff(scene.falloff, distance * scene.scale).astype(np.float64) * cover
    opacity = 1.0 - scene.transparency.mean_of(triangle)
    if scene.palette is None:
        sums[index, 3] += light[index, 3] * rho * opacity
        return
    colour = scene.palette[triangle + 1].astype(np.float64)
    colour[:, 3] = opacity
    sums[index] += light[index] * rho[:, None] * colour
