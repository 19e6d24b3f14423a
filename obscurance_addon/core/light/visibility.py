"""How much light comes along rays: shadows of opaque surfaces, and what transparent ones let through."""

from __future__ import annotations

import numpy as np

from ..tracing import FAR, LEAST_LIGHT, MAX_SURFACES, Passage, TracedScene, shadowed, starts_inside


def visible_share(
    scene: TracedScene, origins: np.ndarray, directions: np.ndarray, distances: np.ndarray, may_be_inside: np.ndarray
) -> np.ndarray:
    """As `light_share`, without colour: (n,) bool where everything is opaque, else float32."""
    rays = origins, directions, distances, may_be_inside
    return ~shadowed(scene, *rays) if scene.transparency is None else light_share(scene, *rays).mean(1)


def light_share(
    scene: TracedScene, origins: np.ndarray, directions: np.ndarray, distances: np.ndarray, may_be_inside: np.ndarray
) -> np.ndarray:
    """Share of the light from `distances` (n,) away that transparent surfaces let through, (n, 3) float32.

    Parameters as for `shadowed`; of a scene with something transparent.
    """
    share = np.ones((len(origins), 3), np.float32)
    sought = may_be_inside | scene.intersector.occluded(origins, directions, distances.copy())
    rays = np.flatnonzero(sought)
    limits = np.where(may_be_inside, FAR, distances).astype(np.float32)
    origins, directions, limits, distances = (array[rays] for array in (origins, directions, limits, distances))
    hits = scene.intersector.intersect(origins, directions, limits.copy())
    passage = Passage(scene.intersector, origins, directions, limits, hits, np.arange(len(rays)))
    for _ in range(MAX_SURFACES):
        before = passage.distance < distances[passage.rays]  # of what shines
        transmission, _ = passage.looked_up(scene.transparency)
        transmission[~before | (passage.triangle < 0)] = 1.0
        if scene.solid is not None:
            inside = starts_inside(scene, passage.directions, passage.hits())
            transmission[inside & (passage.triangle >= 0)] = 0.0
        share[rays[passage.rays]] *= transmission[:, :3]
        through = scene.transparency.lets_through(passage.triangle)
        passage.keep(through & (share[rays[passage.rays]].max(1) > LEAST_LIGHT))
        if not len(passage.rays):
            break
        passage.go_on()
    return share
