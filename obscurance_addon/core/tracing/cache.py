"""Keeps the ray tracer of the last bake, so that baking the same geometry again need not build it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from .embree import EmbreeIntersector
from .intersector import Intersector

BYTES_PER_TRIANGLE = 100  # of an Embree scene with its buffers: 70 to 100 measured for grids and soups up to 2 million


class IntersectorCache:
    """Builds intersectors like `build` itself, but returns the last one again for the same arrays.

    Equal arrays, bit for bit, give equal hits, so a bake's result does not depend on what is kept.

    Parameters
    ----------
    build : callable
        (vertices, triangles, progress) -> Intersector.

    Attributes
    ----------
    ceiling_bytes : int
        A tracer that is larger than this is not kept; 0 keeps none.
    """

    def __init__(self, build: Callable[..., Intersector] = EmbreeIntersector) -> None:
        self.ceiling_bytes = 0
        self._build = build
        self._kept: tuple[bytes, Intersector] | None = None  # one tuple, so that threads see both or neither

    def __call__(
        self, vertices: np.ndarray, triangles: np.ndarray, progress: Callable[[int], None] | None = None
    ) -> Intersector:
        """The intersector of these arrays; parameters as for `EmbreeIntersector`."""
        if BYTES_PER_TRIANGLE * len(triangles) > self.ceiling_bytes:
            self.clear()
            return self._build(vertices, triangles, progress)
        key = _fingerprint(vertices, triangles)
        kept = self._kept
        if kept is None or kept[0] != key:
            self.clear()  # before building, so that two never take memory at once
            kept = key, self._build(vertices, triangles, progress)
            self._kept = kept
        return kept[1]

    def clear(self) -> None:
        """Let go of what is kept."""
        self._kept = None


def _fingerprint(vertices: np.ndarray, triangles: np.ndarray) -> bytes:
    """Identity of the arrays as the tracer sees them, in single precision."""
    digest = hashlib.blake2b(digest_size=16)
    for array in (np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(triangles, np.int32)):
        digest.update(str(array.shape).encode())
        digest.update(array)
    return digest.digest()
