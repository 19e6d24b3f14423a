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
    hit : ndarray, (k, 4) float32
        T rho R per RGB channel, and T rho times the opacity.
    miss : ndarray, (k, 4) float32
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
    found = Layered(
        rays,
        np.zeros((len(rays), 4), np.float32),
        np.zeros((len(rays), 4), np.float32),
        np.zeros(len(rays), bool),
        hits.distance[rays],
    )
    index = np.arange(len(rays))  # of the rays that are still on their way
    light, counts = np.ones((len(rays), 4), np.float32), np.ones(len(rays), bool)
    for _ in range(MAX_SURFACES):
        if not len(index):
            break
        met = passage.triangle >= 0
        near = met & (passage.distance < scene.limit)
        transmission, cover = passage.looked_up(scene.transparency)
        if scene.falloff is not Falloff.STEP:  # of which a hit adds nothing
            found.hit[index] += _scattered(scene, light, passage, near, cover)
        escaped = counts & ~near
        found.miss[index[escaped]] = light[escaped]
        counts &= near
        found.farthest[index[met]] = passage.distance[met]
        if scene.solid is not None:
            found.inside[index] = met & starts_inside(scene, passage.directions, passage.hits())
        light *= transmission
        onward = light.max(1) > LEAST_LIGHT  # opaque ones let nothing through
        passage.keep(onward)
        index, light, counts = index[onward], light[onward], counts[onward]
        passage.go_on()
    found.miss[index[counts]] = light[counts]
    found.hit[found.inside], found.miss[found.inside] = 0.0, 0.0
    return found


def _scattered(
    scene: TracedScene, light: np.ndarray, passage: Passage, near: np.ndarray, cover: np.ndarray
) -> np.ndarray:
    """What one surface on each of some rays adds, (m, 4) float32; 0 where there is none nearer than d_max."""
    weight = apply_falloff(scene.falloff, passage.distance * scene.scale)
    weight *= cover
    weight[~near] = 0.0
    opacity = np.float32(1.0) - scene.transparency.mean_of(passage.triangle)
    if scene.palette is None:
        colour = np.zeros((len(weight), 4), np.float32)
    else:
        colour = np.take(scene.palette, passage.triangle.astype(np.intp) + 1, axis=0, mode="clip")
    colour[:, 3] = opacity
    colour *= weight[:, None]
    colour *= light
    return colour
