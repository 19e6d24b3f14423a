"""What rays find that pass transparent surfaces: eq. 5 layer by layer.

A surface at distance d adds T rho(d) R, where T is what the surfaces before it let through and R is for all the light
that falls on it. What is left at d_max adds T R_ave. Without colour, T is the mean over the channels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..falloff import Falloff, apply_falloff
from ..tracing import LEAST_LIGHT, MAX_SURFACES, Hits, Passage, TracedScene


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
    """

    rays: np.ndarray
    hit: np.ndarray
    miss: np.ndarray
    inside: np.ndarray


def sum_layers(
    scene: TracedScene,
    origins: np.ndarray,
    directions: np.ndarray,
    hits: Hits,
    rooms: np.ndarray | None,
    inside: np.ndarray | None = None,
) -> Layered:
    """Follow the rays (n,) whose first hit is transparent.

    `inside` (n,) bool tells which rays start inside of a solid. Where it is not given, those do that meet the inside of
    a solid first, of none that is a room (n, depth) of theirs.
    """
    rays = np.flatnonzero(scene.transparency.lets_through(hits.triangle))
    passage = Passage(scene.intersector, origins, directions, scene.limit, hits, rays)
    found = Layered(
        rays,
        np.zeros((len(rays), 4), np.float32),
        np.zeros((len(rays), 4), np.float32),
        np.zeros(len(rays), bool) if inside is None else inside[rays],
    )
    index = np.arange(len(rays))  # of the rays that are still on their way
    light = np.ones((len(rays), 4), np.float32)
    for _ in range(MAX_SURFACES):
        if not len(index):
            break
        met = passage.triangle >= 0
        transmission, cover = passage.looked_up(scene.transparency)
        if scene.falloff is not Falloff.STEP:  # of which a hit adds nothing
            found.hit[index] += _scattered(scene, light, passage, met, cover)
        found.miss[index[~met]] = light[~met]
        if inside is None and scene.bodies is not None:
            of_rays = None if rooms is None else rooms[passage.rays]
            found.inside[index] = scene.meets_inside(passage.directions, passage.hits(), of_rays)
        light *= transmission
        onward = light.max(1) > LEAST_LIGHT  # opaque ones let nothing through
        passage.keep(onward)
        index, light = index[onward], light[onward]
        passage.go_on()
    found.miss[index] = light
    found.hit[found.inside], found.miss[found.inside] = 0.0, 0.0
    return found


def _scattered(
    scene: TracedScene, light: np.ndarray, passage: Passage, met: np.ndarray, cover: np.ndarray
) -> np.ndarray:
    """What one surface on each of some rays adds, (m, 4) float32; 0 where there is none."""
    weight = apply_falloff(scene.falloff, passage.distance * scene.scale)
    weight *= cover
    weight[~met] = 0.0
    opacity = np.float32(1.0) - scene.transparency.mean_of(passage.triangle)
    if scene.palette is None:
        colour = np.zeros((len(weight), 4), np.float32)
    else:
        colour = np.take(scene.palette, passage.triangle.astype(np.intp) + 1, axis=0, mode="clip")
    colour[:, 3] = opacity
    colour *= weight[:, None]
    colour *= light
    return colour
