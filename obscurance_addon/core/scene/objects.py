"""Objects of a scene that may change one by one, and the scene that they make together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .patches import Patches, Surfaces
from .solids import Shells
from .transmission import join_transmissions


@dataclass(frozen=True)
class SceneObject:
    """What rays can hit of one object, and the patches on it.

    Attributes
    ----------
    surfaces : Surfaces
        With vertices of its own.
    patches : Patches
        May be none.
    reflectance : ndarray, (p, 3) float
        Mean reflectance of each patch; NaN where nothing sees its colour.
    neighbours : tuple of two ndarray (m,) int, or None
        Pairs (patch, node) as `bake_obscurances` takes them.
    opacity : ndarray, (p,) float, or None
        Mean opacity of each patch; None for opaque ones.
    """

    surfaces: Surfaces
    patches: Patches
    reflectance: np.ndarray
    neighbours: tuple[np.ndarray, np.ndarray] | None = None
    opacity: np.ndarray | None = None

    def has_shape_of(self, other: SceneObject) -> bool:
        """Whether the two differ in nothing but colours; where rays pass is a matter of shape."""
        one, two = self.surfaces.transmission, other.surfaces.transmission
        if not (two is None if one is None else one.equals(two)):
            return False
        mine, others = (
            (
                s.vertices,
                s.triangles,
                s.shells.shell,
                s.shells.body,
                occluding(s),
                p.corners,
                p.patch,
                p.ids,
                *(neighbours or ()),
            )
            for s, p, neighbours in ((o.surfaces, o.patches, o.neighbours) for o in (self, other))
        )
        return len(mine) == len(others) and all(map(same_numbers, mine, others))

    def has_colours_of(self, other: SceneObject) -> bool:
        """Whether every triangle and every patch of the two reflects alike."""
        return same_numbers(self.surfaces.reflectance, other.surfaces.reflectance) and same_numbers(
            self.reflectance, other.reflectance
        )


@dataclass(frozen=True)
class JoinedObjects:
    """Arguments of `bake_obscurances` for several objects: their patches and triangles in order.

    Attributes
    ----------
    surfaces : Surfaces
    patches : Patches
    patch_reflectance : ndarray, (p, 3) float64
    neighbours : tuple of two ndarray (m,) int, or None
        Nodes of different objects stay apart.
    patch_opacity : ndarray, (p,) float64, or None
    """

    surfaces: Surfaces
    patches: Patches
    patch_reflectance: np.ndarray
    neighbours: tuple[np.ndarray, np.ndarray] | None
    patch_opacity: np.ndarray | None


def join_objects(objects: Iterable[SceneObject]) -> JoinedObjects:
    """The scene that objects make, each of them an object of `Surfaces.object_starts`."""
    objects = list(objects)
    surfaces, patches = [o.surfaces for o in objects], [o.patches for o in objects]
    vertex = _starts(len(s.vertices) for s in surfaces)
    patch = _starts(map(len, patches))
    node = _starts(0 if o.neighbours is None else int(o.neighbours[1].max(initial=-1)) + 1 for o in objects)
    neighbours = [
        (o.neighbours[0] + patch[i], o.neighbours[1] + node[i]) for i, o in enumerate(objects) if o.neighbours
    ]
    triangle = _starts(len(s.triangles) for s in surfaces)
    shell_of_patch = None
    if all(p.shell is not None for p in patches):
        shells = [np.where(p.shell > 0, p.shell + np.int32(triangle[i]), 0) for i, p in enumerate(patches)]
        shell_of_patch = np.concatenate([np.zeros(0, np.int32), *shells]).astype(np.int32)
    return JoinedObjects(
        Surfaces(
            np.concatenate([np.zeros((0, 3)), *(s.vertices for s in surfaces)]),
            np.concatenate(
                [np.zeros((0, 3), np.int32), *(s.triangles + np.int32(vertex[i]) for i, s in enumerate(surfaces))]
            ),
            np.concatenate([np.zeros((0, 3), np.float32), *(s.reflectance for s in surfaces)]),
            Shells.joined([s.shells for s in surfaces]),
            triangle[:-1],
            occludes=np.concatenate([np.zeros(0, bool), *map(occluding, surfaces)])
            if any(s.occludes is not None for s in surfaces)
            else None,
            transmission=join_transmissions([(len(s.triangles), s.transmission) for s in surfaces]),
        ),
        Patches(
            np.concatenate([np.zeros((0, 3, 3)), *(p.corners for p in patches)]),
            np.concatenate([np.zeros(0, np.int64), *(p.patch + patch[i] for i, p in enumerate(patches))]),
            np.concatenate([np.zeros(0, np.uint32), *(p.ids for p in patches)]),
            shell_of_patch,
        ),
        np.concatenate([np.zeros((0, 3)), *(o.reflectance for o in objects)]),
        tuple(map(np.concatenate, zip(*neighbours, strict=True))) if neighbours else None,
        join_opacities([(len(o.patches), o.opacity) for o in objects]),
    )


def occluding(surfaces: Surfaces) -> np.ndarray:
    """(t,) bool: the triangles that rays meet."""
    return np.ones(len(surfaces.triangles), bool) if surfaces.occludes is None else surfaces.occludes


def join_opacities(parts: Sequence[tuple[int, np.ndarray | None]]) -> np.ndarray | None:
    """Opacity (p,) of the patches of several objects, given the number of each one's; None if all are opaque."""
    if all(part is None for _, part in parts):
        return None
    return np.concatenate([np.ones(count) if part is None else part for count, part in parts])


def _starts(counts: Iterable[int]) -> np.ndarray:
    """Where each of several consecutive parts starts, and the end of the last, (k + 1,) int64."""
    return np.cumsum([0, *counts], dtype=np.int64)


def same_numbers(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays hold the same, numbers that are none included."""
    if np.array_equal(one, other) or one.shape != other.shape:
        return one.shape == other.shape
    return bool(((one == other) | (np.isnan(one) & np.isnan(other))).all())
