"""Values for texels that have none of their own: from their neighbours, ring by ring."""

from __future__ import annotations

import numpy as np

_AROUND = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]


def fill_inside_charts(pixels: np.ndarray, chart: np.ndarray, missing: np.ndarray, size: int) -> np.ndarray:
    """Give texels of a chart without a value the mean of their neighbours of the same chart, inwards ring by ring.

    Parameters
    ----------
    pixels : ndarray, (size * size, k) float32
        Overwritten at `missing`.
    chart : ndarray, (size * size,) int32
        -1 where there is none.
    missing : ndarray, (m,) int64
        Texels without a value, ascending.
    size : int

    Returns
    -------
    ndarray, (r,) int64
        The texels of which no neighbour, however far, has a value.
    """
    unknown = np.zeros(len(chart), bool)
    unknown[missing] = True
    ring = missing
    while len(ring):
        total, count = np.zeros((len(ring), pixels.shape[1])), np.zeros(len(ring), np.int64)
        for neighbour, exists in _neighbours(ring, size):
            has = exists & (chart[neighbour] == chart[ring]) & ~unknown[neighbour]
            total[has] += pixels[neighbour[has]]
            count += has
        found = count > 0
        filled = ring[found]
        pixels[filled] = total[found] / count[found, None]
        unknown[filled] = False
        beside = (
            neighbour[exists & unknown[neighbour] & (chart[neighbour] == chart[filled])]
            for neighbour, exists in _neighbours(filled, size)
        )
        ring = np.unique(np.concatenate(list(beside)))
    return missing[unknown[missing]]


def dilate(pixels: np.ndarray, chart: np.ndarray, size: int, rings: int) -> None:
    """Continue the values of each chart into the empty texels around it, never into another chart.

    An empty texel takes the mean of its neighbours in the chart that is nearest, counted in rings; where two are as
    near, the one of the higher number.

    Parameters
    ----------
    pixels : ndarray, (size * size, k) float32
    chart : ndarray, (size * size,) int32
        -1 where there is none; texels that get a value get its chart too.
    size : int
    rings : int
        How far to go, in texels.
    """
    ring = _empty_beside(chart, size)
    for _ in range(rings):
        if not len(ring):
            return
        owner = np.full(len(ring), -1, np.int32)
        for neighbour, exists in _neighbours(ring, size):
            np.maximum(owner, np.where(exists, chart[neighbour], -1), out=owner)
        total, count = np.zeros((len(ring), pixels.shape[1])), np.zeros(len(ring), np.int64)
        for neighbour, exists in _neighbours(ring, size):
            has = exists & (chart[neighbour] == owner)
            total[has] += pixels[neighbour[has]]
            count += has
        pixels[ring] = total / count[:, None]
        chart[ring] = owner
        beside = [neighbour[exists & (chart[neighbour] < 0)] for neighbour, exists in _neighbours(ring, size)]
        ring = np.unique(np.concatenate(beside))


def _empty_beside(chart: np.ndarray, size: int) -> np.ndarray:
    """Empty texels (m,) int64 with a neighbour in a chart, ascending."""
    filled = (chart >= 0).reshape(size, size)
    near = filled.copy()
    near[1:] |= filled[:-1]
    near[:-1] |= filled[1:]
    wide = near.copy()
    wide[:, 1:] |= near[:, :-1]
    wide[:, :-1] |= near[:, 1:]
    return np.flatnonzero(wide & ~filled)


def _neighbours(texel: np.ndarray, size: int):
    """The eight neighbours (m,) of texels (m,), one direction at a time, and whether each lies on the page."""
    row, column = texel // size, texel % size
    for y, x in _AROUND:
        exists = (row + y >= 0) & (row + y < size) & (column + x >= 0) & (column + x < size)
        yield np.where(exists, texel + y * size + x, 0), exists
