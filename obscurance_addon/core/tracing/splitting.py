"""Triangles that float32 cannot trace as they are, cut into pieces that it can; hits still name the whole triangle.

A vertex of a triangle that is much larger than what is baked is rounded by more than rays are long, and so is the
plane; pieces near what is baked have their corners near. The plane of a needle is as uncertain as its length is large
beside its height, so that rays meet the face that they leave; short pieces have planes of their own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..scene import triangle_areas
from .intersector import MISS, Hits, Intersector

LARGE = 512.0  # normalised units: longer edges are cut unless they are as far away as they are long
_FAR = 1.5  # distance of the middle of an edge, in lengths of it, from which on its rounding is no matter
_MOST_ROUNDS = 400  # 2 to 3 for each halving
_PIECE = 4.6  # length of a piece over the square root of its height times the extent: its plane is then safe


class WholeTriangles:
    """An `Intersector` over pieces that tells which triangle was hit.

    Parameters
    ----------
    pieces : Intersector
    whole : ndarray, (n,) int32
        Triangle of each piece.
    """

    def __init__(self, pieces: Intersector, whole: np.ndarray) -> None:
        self._pieces, self._whole = pieces, whole

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        hits = self._pieces.intersect(origins, directions, limits)
        whole = np.where(hits.triangle >= 0, np.take(self._whole, hits.triangle, mode="clip"), np.int32(MISS))
        return Hits(hits.distance, whole, hits.normal)

    def occluded(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        return self._pieces.occluded(origins, directions, limits)


def make_intersector(
    intersector: Callable[..., Intersector],
    vertices: np.ndarray,
    triangles: np.ndarray,
    slender: np.ndarray,
    progress: Callable[[int], None],
) -> Intersector:
    """The ray tracer over triangles, cut where that is needed.

    Parameters
    ----------
    intersector : callable
        Builds ray tracers, as for `bake_obscurances`.
    vertices : ndarray, (v, 3) float64
        Finite, normalised.
    triangles : ndarray, (t, 3) int
    slender : ndarray, (t,) bool
        As of `usable_triangles`.
    progress : callable
        As for `EmbreeIntersector`.
    """
    large = _large(vertices, triangles)
    needles = np.setdiff1d(np.flatnonzero(slender), large)
    if not (len(needles) or len(large)):
        return intersector(vertices, triangles, progress)
    whole = [np.setdiff1d(np.arange(len(triangles)), np.concatenate([needles, large]))]
    corners = []
    for pieces, owner in (cut_large(vertices[triangles[large]]), cut_needles(vertices[triangles[needles]])):
        corners.append(pieces)
        whole.append((large, needles)[len(whole) - 1][owner])
    corners = np.concatenate(corners).reshape(-1, 3)
    new = len(vertices) + np.arange(len(corners)).reshape(-1, 3)
    cut = intersector(np.concatenate([vertices, corners]), np.concatenate([triangles[whole[0]], new]), progress)
    return WholeTriangles(cut, np.concatenate(whole).astype(np.int32))


def _large(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (k,) int with an edge that is to be cut."""
    if np.abs(vertices).max(initial=0.0) * 2.0 * 3.0**0.5 <= LARGE:
        return np.zeros(0, np.int64)
    return np.flatnonzero(_cut_lengths(vertices[triangles]).max(1) > 0.0)


def _cut_lengths(corners: np.ndarray) -> np.ndarray:
    """Lengths (m, 3) of the edges from each corner to the next that are to be cut, 0 for others.

    The same for both triangles at an edge, so that their pieces meet.
    """
    after = np.roll(corners, -1, axis=1)
    length = np.linalg.norm(after - corners, axis=2)
    distance = np.linalg.norm(0.5 * (after + corners), axis=2)
    return np.where((length > LARGE) & (distance < _FAR * length), length, 0.0)


def cut_large(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut edges in the middle that are long and near the origin, the longest of each triangle first.

    Parameters
    ----------
    corners : ndarray, (m, 3, 3) float64
        Normalised.

    Returns
    -------
    pieces : ndarray, (n, 3, 3) float64
    owner : ndarray, (n,) int
    """
    done, owners = [], []
    owner = np.arange(len(corners))
    for _ in range(_MOST_ROUNDS):
        length = _cut_lengths(corners)
        edge, is_cut = length.argmax(1), length.max(1) > 0.0
        done.append(corners[~is_cut])
        owners.append(owner[~is_cut])
        if not is_cut.any():
            break
        turn = (edge[is_cut, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners[is_cut], turn[:, :, None], axis=1).transpose(1, 0, 2)
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        owner = np.tile(owner[is_cut], 2)
    return np.concatenate(done), np.concatenate(owners)


def cut_needles(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles across their longest edge; parameters and results as for `cut_large`."""
    edges = np.roll(corners, -1, axis=1) - corners
    turn = (np.linalg.norm(edges, axis=2).argmax(1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners, turn[:, :, None], axis=1).transpose(1, 0, 2)  # the longest edge is a to b
    along = b - a
    length = np.linalg.norm(along, axis=1)
    height = 2.0 * triangle_areas(corners) / length
    foot = np.clip(np.einsum("ij,ij->i", c - a, along) / length**2, 0.0, 1.0)[:, None]
    piece = _PIECE * np.sqrt(height * np.abs(corners).max((1, 2)))
    below = a + foot * along
    pieces, owners = [], []
    for tip, share in ((a, foot[:, 0]), (b, 1.0 - foot[:, 0])):  # from the tip to below the third corner
        count = np.maximum(np.ceil(share * length / piece), 1.0).astype(np.int64)
        owner = np.repeat(np.arange(len(corners)), count)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        near, far = (step / count[owner])[:, None], ((step + 1) / count[owner])[:, None]
        tip, base, top = tip[owner], below[owner], c[owner]
        base_near, base_far = tip + near * (base - tip), tip + far * (base - tip)
        top_near, top_far = tip + near * (top - tip), tip + far * (top - tip)
        two = np.stack([np.stack([base_near, base_far, top_far], 1), np.stack([base_near, top_far, top_near], 1)], 1)
        if pieces:
            two = two[:, :, ::-1]  # mirrored
        kept = np.stack([np.ones(len(step), bool), step > 0], 1)
        pieces.append(two[kept])
        owners.append(np.repeat(owner, 2)[kept.ravel()])
    return np.concatenate(pieces), np.concatenate(owners)
