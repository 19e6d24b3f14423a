"""First hits that do not mean what they seem: doubled faces, and what lies behind the inside of solids."""

from __future__ import annotations

import numpy as np

from .intersector import Hits
from .traced_scene import TracedScene

SAME_DIRECTION = 0.999  # cosine above which two touching faces count as doubles of each other
COPLANAR_OFFSETS = 4.0  # hits within this many ray offsets are looked at for doubled faces
MAX_DOUBLES = 8  # stacked doubled faces that a ray passes


def pass_doubled_faces(
    scene: TracedScene,
    cells: np.ndarray,
    n: int,
    origins: np.ndarray,
    directions: np.ndarray,
    limit: np.float32,
    hits: Hits,
) -> None:
    """Let rays through faces that double the one they leave (decals, duplicates), by tracing on from behind them.

    Faces that touch with opposite normals are in contact and do occlude.
    """
    offset = scene.cells.offset[cells]
    rays = _near_hits(scene, cells, n, hits)
    for _ in range(MAX_DOUBLES):
        rays = _that_meet_doubles(scene, cells, n, hits, rays)
        if not len(rays):
            return
        step = hits.distance[rays] + offset[rays // n]
        onward = origins[rays] + step[:, None] * directions[rays]
        beyond = scene.intersector.intersect(onward, directions[rays], np.maximum(limit - step, 0.0))
        # Where d_max is less than the step, nothing is beyond, and rho must not rise above 1.
        hits.distance[rays], hits.triangle[rays] = np.minimum(beyond.distance + step, limit), beyond.triangle
        hits.normal[rays] = beyond.normal
        rays = rays[(hits.triangle[rays] >= 0) & (hits.distance[rays] < COPLANAR_OFFSETS * offset[rays // n])]


def meet_doubled_faces(scene: TracedScene, cells: np.ndarray, n: int, hits: Hits) -> np.ndarray:
    """Indices (k,) of the rays that `pass_doubled_faces` would let through; cells (m,) int have n rays each."""
    return _that_meet_doubles(scene, cells, n, hits, _near_hits(scene, cells, n, hits))


def _near_hits(scene: TracedScene, cells: np.ndarray, n: int, hits: Hits) -> np.ndarray:
    """Indices of the rays that meet something within a few ray offsets."""
    reach = COPLANAR_OFFSETS * scene.cells.offset[cells]
    near = np.flatnonzero(hits.distance < reach.max())  # few or none
    return near[(hits.distance[near] < reach[near // n]) & (hits.triangle[near] >= 0)]


def _that_meet_doubles(scene: TracedScene, cells: np.ndarray, n: int, hits: Hits, rays: np.ndarray) -> np.ndarray:
    """Those of the rays (k,) int whose hit looks the same way as the face that they leave."""
    normal, other = scene.cells.frames[cells[rays // n], 2, 3:], hits.normal[rays]
    cosine = np.einsum("ij,ij->i", normal, other)
    return rays[cosine > SAME_DIRECTION * np.sqrt(np.einsum("ij,ij->i", other, other))]


def shadowed(
    scene: TracedScene,
    origins: np.ndarray,
    directions: np.ndarray,
    distances: np.ndarray,
    may_be_inside: np.ndarray,
    rooms: np.ndarray | None,
) -> np.ndarray:
    """(n,) bool: rays that meet something nearer than `distances`, or that start inside of a solid.

    `may_be_inside` (n,) bool tells the rays for which that must be found out, `rooms` as of `Bodies.start_inside`.
    """
    blocked = scene.intersector.occluded(origins, directions, distances)
    unsure = np.flatnonzero(may_be_inside & ~blocked)
    if len(unsure) and scene.bodies is not None:
        rooms = None if rooms is None else rooms[unsure]
        rays = np.take(origins, unsure, axis=0), np.take(directions, unsure, axis=0)
        blocked[unsure] = scene.bodies.start_inside(*rays, rooms)[0]
    return blocked
