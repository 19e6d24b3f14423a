"""Parts of meshes that hang together, and which way round their triangles are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_EVEN = 1e-6  # difference between the areas of two sides, as a share of both, that is none


def connected_components(n: int, links: np.ndarray) -> np.ndarray:
    """Label nodes by the smallest index of their connected component.

    Parameters
    ----------
    n : int
        Number of nodes.
    links : ndarray, (m, 2) int
        Pairs of connected nodes.

    Returns
    -------
    ndarray, (n,) int64
        The smallest node index of each node's component.
    """
    label = np.arange(n)
    a, b = links.T
    while len(a):
        low, high = np.minimum(label[a], label[b]), np.maximum(label[a], label[b])
        differs = low != high
        a, b = a[differs], b[differs]
        np.minimum.at(label, high[differs], low[differs])
        while True:  # pointer jumping: each label moves to its label's label until all point at roots
            shorter = label[label]
            if np.array_equal(shorter, label):
                break
            label = shorter
    return label


def places(points: np.ndarray) -> np.ndarray:
    """(n,) int64: a number for each of the points (n, 3) float64, the same for those that are equal bit for bit.

    The two zeros count as one; no coordinate may be NaN.
    """
    points = points + 0.0
    order = np.lexsort(points.T)
    is_new = np.r_[False, (points[order[1:]] != points[order[:-1]]).any(1)]
    number = np.empty(len(points), np.int64)
    number[order] = np.cumsum(is_new)
    return number


@dataclass(frozen=True)
class EdgeUses:
    """How triangles (t, 3) share edges; half-edges are numbered 3 t + k, from corner k to the next.

    Attributes
    ----------
    tail, head : ndarray, (3 t,) int64
        Vertices of each half-edge.
    pairs : ndarray, (m, 2) int64
        Half-edges that are the only two of their edge.
    alike : ndarray, (m,) bool
        Whether the two run in opposite directions, so that their triangles are the same way round.
    single : ndarray, (s,) int64
        Half-edges that are alone.
    crowded : ndarray, (c,) int64
        Those of edges with more than two.
    """

    tail: np.ndarray
    head: np.ndarray
    pairs: np.ndarray
    alike: np.ndarray
    single: np.ndarray
    crowded: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, triangles: np.ndarray) -> EdgeUses:
        """Those of triangles (t, 3) int whose vertices (v, 3) float64 are finite.

        Edges are shared by common vertices, and those that are alone so by the places of their ends.
        """
        tail = triangles.astype(np.int64).ravel()
        head = triangles[:, [1, 2, 0]].astype(np.int64).ravel()
        pairs, single, crowded = _matched(tail, head, len(vertices))
        alike = tail[pairs[:, 0]] != tail[pairs[:, 1]]
        if len(single):
            ends = np.unique([tail[single], head[single]])
            place = np.zeros(len(vertices), np.int64)
            place[ends] = places(vertices[ends])
            single = single[place[tail[single]] != place[head[single]]]
            start, end = place[tail[single]], place[head[single]]
            more, left, others = _matched(start, end, len(ends))
            alike = np.append(alike, start[more[:, 0]] != start[more[:, 1]])
            pairs, crowded = np.concatenate([pairs, single[more]]), np.append(crowded, single[others])
            single = single[left]
        return cls(tail, head, pairs, alike, single, crowded)


def _matched(tail: np.ndarray, head: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half-edges between vertices 0 .. n - 1: pairs (m, 2) of one edge, single ones (s,), and crowded ones (c,)."""
    edge = np.minimum(tail, head) * n + np.maximum(tail, head)
    order = np.argsort(edge, kind="stable")
    edge = edge[order]
    first = np.flatnonzero(np.r_[True, edge[1:] != edge[:-1]][: len(edge)])
    count = np.diff(np.r_[first, len(edge)])
    pairs = order[first[count == 2][:, None] + np.arange(2)]
    return pairs, order[first[count == 1]], order[np.repeat(count > 2, count)]


def sides(edges: EdgeUses, area: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Components of triangles over paired edges, and which triangles look to the side of the smaller area.

    Found on the double cover: each triangle is there once for each way round, and neighbours hang together in the ways
    that agree. A component whose two ways round hang together has one side only.

    Parameters
    ----------
    edges : EdgeUses
    area : ndarray, (t,) float64

    Returns
    -------
    component : ndarray, (t,) int64
        The lowest triangle of each component.
    other_side : ndarray, (t,) bool
        Triangles of the side of less area, of the one without that lowest triangle where both are equal.
    kind : ndarray, (t,) int8
        0 where the component has one side only, 1 where the two are of equal area and neither is empty, else 2.
    """
    n, alike = len(area), edges.alike
    one, two = (edges.pairs // 3).T
    if alike.all():
        return connected_components(n, np.stack([one, two], -1)), np.zeros(n, bool), np.full(n, 2, np.int8)
    links = [np.stack([2 * one + way, 2 * two + np.where(alike, way, 1 - way)], -1) for way in (0, 1)]
    label = connected_components(2 * n, np.concatenate(links))
    component, other_side, one_sided = label[::2] >> 1, (label[::2] & 1).astype(bool), label[::2] == label[1::2]
    areas = np.bincount(2 * component + other_side, area, 2 * n).reshape(n, 2)
    less = areas[:, 1] - areas[:, 0]
    is_even = (areas[:, 1] > 0.0) & (np.abs(less) <= _EVEN * areas.sum(1))
    other_side ^= ((less > 0.0) & ~is_even)[component]
    kind = np.where(one_sided, 0, np.where(is_even[component], 1, 2)).astype(np.int8)
    return component, other_side & ~one_sided, kind
