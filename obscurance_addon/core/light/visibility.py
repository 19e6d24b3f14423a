"""How much light comes along rays: shadows of opaque surfaces, and what transparent ones let through."""

from __future__ import annotations

import numpy as np

from ..tracing import LEAST_LIGHT, MAX_SURFACES, Passage, TracedScene, shadowed


def visible_share(
    scene: TracedScene,
    origins: np.ndarray,
    directions: np.ndarray,
    distances: np.ndarray,
    may_be_inside: np.ndarray,
    rooms: np.ndarray | None,
) -> np.ndarray:
    """As `light_share`, without colour: (n,) bool where everything is opaque, else float32."""
    rays = origins, directions, distances, may_be_inside, rooms
    return ~shadowed(scene, *rays) if scene.transparency is None else light_share(scene, *rays).mean(1)


def light_share(
    scene: TracedScene,
    origins: np.ndarray,
    directions: np.ndarray,
    distances: np.ndarray,
    may_be_inside: np.ndarray,
    rooms: np.ndarray | None,
) -> np.ndarray:
    """Share of the light from `distances` (n,) away that transparent surfaces let through, (n, 3) float32.

    Parameters as for `shadowed`; of a scene with something transparent.
    """
    share = np.ones((len(origins), 3), np.float32)
    if scene.bodies is not None:
        unsure = np.flatnonzero(may_be_inside)
        rays = np.take(origins, unsure, axis=0), np.take(directions, unsure, axis=0)
        share[unsure[scene.bodies.start_inside(*rays, None if rooms is None else rooms[unsure])[0]]] = 0.0
    rays = np.flatnonzero(share[:, 0] > 0.0)
    rays = rays[scene.intersector.occluded(origins[rays], directions[rays], distances[rays])]
    origins, directions, limits = (array[rays] for array in (origins, directions, distances))
    hits = scene.intersector.intersect(origins, directions, limits.copy())
    passage = Passage(scene.intersector, origins, directions, limits, hits, np.arange(len(rays)))
    for _ in range(MAX_SURFACES):
        transmission, _ = passage.looked_up(scene.transparency)
        transmission[passage.triangle < 0] = 1.0
        share[rays[passage.rays]] *= transmission[:, :3]
        through = scene.transparency.lets_through(passage.triangle)
        passage.keep(through & (share[rays[passage.rays]].max(1) > LEAST_LIGHT))
        if not len(passage.rays):
            break
        passage.go_on()
    return share
