"""Embree through embreex: the only file that imports it.

Robust mode closes the cracks between neighbouring triangles. embreex fills its buffers element by element while it
holds the interpreter lock, so geometry goes in by slices small enough that a window stays responsive, and each scene is
built once. Only features of Embree 4.3 are used: inside a Blender executable embreex binds to Blender's own, older
library.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import BackendError
from ..native_library import why_missing
from .intersector import Hits

_SLICE = 1 << 15  # triangles filled per call, about 20 ms under the interpreter lock


class EmbreeIntersector:
    """Traces blocks of rays with Embree; safe to call from several threads.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float32
        Finite coordinates, of the order of 1 (see `core.scene.patches.Normalisation`).
    triangles : ndarray, (t, 3) int
    progress : callable, optional
        Called between slices with the number of triangles done; may raise to cancel.

    Raises
    ------
    BackendError
        When embreex is missing or does not load.
    """

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, progress: Callable[[int], None] | None = None
    ) -> None:
        self.embreex_scene = fill_scene(vertices, triangles, progress)
        # The first query commits the scene (builds the hierarchy); that must happen before threads share it.
        ray = np.zeros((1, 3), np.float32)
        self.occluded(ray, ray + 1.0, np.zeros(1, np.float32))

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        found = self.embreex_scene.run(origins, directions, dists=limits, output=True)
        triangle = found["geomID"]  # -1 for a miss, and then so is primID
        triangle *= _SLICE
        triangle += found["primID"]
        return Hits(found["tfar"], triangle, found["Ng"])

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        return self.embreex_scene.run(origins, directions, dists=limits, query="OCCLUDED") >= 0


def fill_scene(vertices: np.ndarray, triangles: np.ndarray, progress: Callable[[int], None] | None = None) -> object:
    """An embreex scene with these triangles, not yet committed; parameters as for `EmbreeIntersector`."""
    scene_type, mesh_type = _load_embreex()
    scene = scene_type(robust=True)
    vertices = np.ascontiguousarray(vertices, np.float32)
    used, index = np.zeros(len(vertices), bool), np.empty(len(vertices), np.int32)
    for first in range(0, len(triangles), _SLICE):
        part = triangles[first : first + _SLICE]
        used[:] = False
        used[part] = True
        kept = np.flatnonzero(used)
        index[kept] = np.arange(len(kept), dtype=np.int32)
        mesh_type(scene, vertices[kept], index[part])
        if progress is not None:
            progress(min(first + _SLICE, len(triangles)))
    return scene


def _load_embreex() -> tuple[type, type]:
    if missing := why_missing("embreex"):
        raise BackendError(f"the ray tracer {missing}")
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    return EmbreeScene, TriangleMesh
