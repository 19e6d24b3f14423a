"""How much light passes the triangles of a scene: the same all over each, or looked up where a ray meets it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

LEAST_TRANSMISSION = 1e-3  # a surface that lets less through is opaque


class Lookup(Protocol):
    """Transmission at places on the triangles of one mesh. Calls may come from several threads at once."""

    def __call__(self, triangles: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(n, 3) float32, 0 .. 1, on triangles (n,) int at barycentric coordinates (n, 3) float32."""
        ...


@dataclass(frozen=True)
class Transmission:
    """Share of the light that passes each triangle and goes on straight.

    Attributes
    ----------
    mean : ndarray, (t, 3) float32
        Per RGB channel, 0 for opaque ones.
    textured : ndarray, (t,) int32
        Row in the arrays below of each triangle over which it varies, -1 for the others.
    corners : ndarray, (k, 3, 3) float64
        Where they stand in the world, metres, in the order that `lookups` know.
    local : ndarray, (k,) int32
        Their numbers in their own mesh.
    lookup : ndarray, (k,) int32
        Which of the lookups knows each.
    lookups : tuple of Lookup
    """

    mean: np.ndarray
    textured: np.ndarray
    corners: np.ndarray
    local: np.ndarray
    lookup: np.ndarray
    lookups: tuple[Lookup, ...] = ()

    @classmethod
    def uniform(cls, mean: np.ndarray) -> Transmission | None:
        """The same all over each triangle, (t, 3); None if all are opaque."""
        mean = np.asarray(mean, np.float32)
        none = np.zeros(0, np.int32)
        return cls(mean, np.full(len(mean), -1, np.int32), np.zeros((0, 3, 3)), none, none) if mean.any() else None

    def only(self, kept: np.ndarray) -> Transmission | None:
        """That of some triangles (k,) int; None if they are opaque."""
        mean, textured = self.mean[kept], self.textured[kept]
        rows = textured[textured >= 0]
        textured[textured >= 0] = np.arange(len(rows), dtype=np.int32)
        return (
            Transmission(mean, textured, self.corners[rows], self.local[rows], self.lookup[rows], self.lookups)
            if mean.any()
            else None
        )

    def equals(self, other: Transmission | None) -> bool:
        """Whether as much light passes the same places."""
        return (
            other is not None
            and self.lookups == other.lookups
            and all(
                np.array_equal(getattr(self, name), getattr(other, name), equal_nan=True)
                for name in ("mean", "textured", "corners")
            )
            and all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("local", "lookup"))
        )


def join_transmissions(parts: Sequence[tuple[int, Transmission | None]]) -> Transmission | None:
    """That of the triangles of several objects, given the number of each one's; None if all are opaque."""
    known = [part for _, part in parts if part is not None]
    if not known:
        return None
    rows = iter(np.cumsum([0, *(len(part.local) for part in known)]))
    first_lookups = np.cumsum([0, *(len(part.lookups) for part in known)])
    mean, textured = [], []
    for count, part in parts:
        if part is None:
            mean.append(np.zeros((count, 3), np.float32))
            textured.append(np.full(count, -1, np.int32))
        else:
            mean.append(part.mean)
            textured.append(np.where(part.textured >= 0, part.textured + np.int32(next(rows)), np.int32(-1)))
    return Transmission(
        np.concatenate(mean),
        np.concatenate(textured).astype(np.int32),
        np.concatenate([part.corners for part in known]),
        np.concatenate([part.local for part in known]),
        np.concatenate([part.lookup + np.int32(first) for part, first in zip(known, first_lookups, strict=False)]),
        tuple(itertools.chain.from_iterable(part.lookups for part in known)),
    )


def opacity(transmission: np.ndarray) -> np.ndarray:
    """Share of the light that surfaces of a transmission (n, 3) stop, without colour, (n,) float64."""
    return 1.0 - transmission.mean(1, dtype=np.float64)
