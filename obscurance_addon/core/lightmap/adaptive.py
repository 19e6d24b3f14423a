"""Texels interpolated from sparse ones where obscurances vary smoothly, after irradiance caching.

The cached places are texels on a lattice of each chart, 16 texels apart, then 8 and 4 where that is too coarse. A block
between four of them is interpolated when its surroundings are far compared with its size (Ward et al. 1988: the
harmonic mean distance R and the change of the normal bound the change of irradiance; with gradients, here those that
the bilinear surface through the corners has, the error is of second order, (r / R)^2 / 2), when nothing is nearer than
the block is wide, when it lies wholly in one chart without a hard edge, and when the value found at its centre agrees.
All lengths are those of the world. Everything else is traced texel by texel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .obscurances import TexelTracer
from .texels import Texels

STRIDES = (16, 8, 4)  # closer sparse texels, with more rays each, would cost as much as all texels
SPARSE_FACTOR = 4  # times the usual rays from a sparse texel: it stands for many
_REPEATED = 16  # of so many sparse texels one is traced twice, which tells the noise
_SECOND_TIME = 3  # its replicate; 1 and 2 are those of the error sample
MOST_EXTRA_RAYS = (SPARSE_FACTOR * (1.0 + 1.0 / _REPEATED) - 1.0) / 8.0  # corners and centres are an eighth of all
_WHOLE = 1.0 - 1e-6
_SURE = 2.0  # standard errors of the noise that the test at the centre allows


@dataclass
class Noise:
    """Variance of sparse values per channel, from all pairs of a band seen so far."""

    total: np.ndarray = field(default_factory=lambda: np.zeros(3))
    count: int = 0

    def add(self, one: np.ndarray, other: np.ndarray) -> None:
        """Note independent estimates (m, 3) of the same values."""
        self.total += (0.5 * (one - other) ** 2).sum(0)
        self.count += len(one)

    def variance(self) -> np.ndarray:
        """(3,) float64."""
        return self.total / max(self.count, 1)


class AdaptiveTexels:
    """Interpolates the texels of bands of rows.

    Parameters
    ----------
    tracer : TexelTracer
    open_value : ndarray, (3,)
        Value of an open texel per channel, about, to which errors are related.
    error_bound : float
    """

    def __init__(self, tracer: TexelTracer, open_value: np.ndarray, error_bound: float) -> None:
        self._tracer = tracer
        self._open = np.where(open_value > 0.0, open_value, 1.0)
        self._bound = error_bound

    def interpolate(self, texels: Texels, rows: tuple[int, int]) -> Band:
        """Find the values of sparse texels and of those between them, in rows that begin at a multiple of 16."""
        band = Band(texels, rows)
        flat = band.flat_blocks()
        for stride in STRIDES:
            blocks = band.open_blocks(stride, flat[stride])
            self._trace(band, blocks.corners)
            blocks = blocks.only(self._far(band, blocks.corners, blocks))
            self._trace(band, blocks.centre)
            agrees = self._far(band, blocks.centre[:, None], blocks) & self._agrees(band, blocks)
            band.fill(blocks.only(agrees))
        return band

    def _trace(self, band: Band, wanted: np.ndarray) -> None:
        """Values of sparse texels, once each."""
        wanted = np.unique(wanted)
        wanted = wanted[~band.known[wanted]]
        if not len(wanted):
            return
        found = self._tracer.trace(band.texels, wanted, factor=SPARSE_FACTOR, with_distances=True)
        again = self._tracer.trace(band.texels, wanted[::_REPEATED], factor=SPARSE_FACTOR, replicate=_SECOND_TIME)
        band.noise.add(self._white(found.values[::_REPEATED]), self._white(again.values))
        band.rays += found.rays + again.rays
        band.known[wanted] = True
        band.values[wanted], band.valid[wanted] = found.values, found.valid
        band.nearness[wanted], band.nearest[wanted] = found.nearness, found.nearest

    def _white(self, values: np.ndarray) -> np.ndarray:
        return (values[:, :3] + values[:, 3:] * self._open) / self._open

    def _far(self, band: Band, places: np.ndarray, blocks: _Blocks) -> np.ndarray:
        """(b,) bool: blocks whose surroundings, seen from places (b, k), are far enough."""
        nearness, nearest = band.nearness[places].max(1), band.nearest[places].min(1)
        exposed = band.valid[places].min(1) >= _WHOLE
        change = (blocks.radius * nearness) ** 2 + blocks.normal_spread**2
        return exposed & (change <= 2.0 * self._bound) & (nearest >= np.sqrt(2.0) * blocks.radius)

    def _agrees(self, band: Band, blocks: _Blocks) -> np.ndarray:
        """(b,) bool: blocks at whose centre is what their corners make it, but for the noise."""
        found = self._white(band.values[blocks.centre])
        expected = self._white(band.values[blocks.corners].mean(1))
        allowed = self._bound + _SURE * np.sqrt(1.25 * band.noise.variance())
        return (np.abs(found - expected) <= allowed).all(1)


@dataclass(frozen=True)
class _Blocks:
    """Blocks of `stride` texels between four corners (b, 4), with a centre (b,), at a row and column of the lattice.

    `radius` (b,) is the distance from the centre to the farthest corner, `normal_spread` (b,) at most how far two
    normals are apart.
    """

    stride: int
    corners: np.ndarray
    centre: np.ndarray
    row: np.ndarray
    column: np.ndarray
    radius: np.ndarray
    normal_spread: np.ndarray

    def only(self, kept: np.ndarray) -> _Blocks:
        """Some of the blocks, (b,) bool."""
        arrays = (self.corners, self.centre, self.row, self.column, self.radius, self.normal_spread)
        return _Blocks(self.stride, *(array[kept] for array in arrays))


@dataclass(frozen=True)
class _FlatBlocks:
    """What the texels of each block of a lattice have in common; (h, w) each, corners on the far side included."""

    chart: np.ndarray  # -1 where there is none, or more than one
    low: np.ndarray  # (h, w, 3) of the normals' components
    high: np.ndarray

    def coarser(self) -> _FlatBlocks:
        """Blocks of twice the side."""
        h, w = self.chart.shape[0] // 2 * 2, self.chart.shape[1] // 2 * 2
        four = [(y, x) for y in (0, 1) for x in (0, 1)]
        chart = np.stack([self.chart[y:h:2, x:w:2] for y, x in four])
        same = (chart == chart[0]).all(0)
        low = np.min([self.low[y:h:2, x:w:2] for y, x in four], axis=0)
        high = np.max([self.high[y:h:2, x:w:2] for y, x in four], axis=0)
        return _FlatBlocks(np.where(same, chart[0], -1), low, high)


class Band:
    """Values of the texels of some rows, as far as they are known.

    Attributes
    ----------
    texels : Texels
    values, valid, nearness, nearest
        As of `TexelValues`, for all texels.
    known : ndarray, (n,) bool
        Traced sparsely.
    between : ndarray, (n,) bool
        Interpolated.
    noise : Noise
    rays : int
        Cast so far.
    """

    def __init__(self, texels: Texels, rows: tuple[int, int]) -> None:
        n, size = len(texels), texels.size
        self.texels, self.noise, self.rays = texels, Noise(), 0
        self.values, self.valid = np.zeros((n, 4)), np.zeros(n)
        self.nearness, self.nearest = np.zeros(n), np.zeros(n)
        self.known, self.between = np.zeros(n, bool), np.zeros(n, bool)
        self._lookup = np.full((rows[1] - rows[0], size), -1)
        self._place = texels.index - rows[0] * size
        self._lookup.ravel()[self._place] = np.arange(n)

    def flat_blocks(self) -> dict[int, _FlatBlocks]:
        """Blocks of every stride that hold one chart and nothing else."""
        texels, least = self.texels, STRIDES[-1]
        chart = np.full(self._lookup.shape, -1, np.int32)
        normal = np.zeros((*self._lookup.shape, 3), np.float32)
        whole = np.flatnonzero(texels.cover >= _WHOLE)
        place = self._place[whole]
        chart.ravel()[place] = texels.chart[whole]
        normal.reshape(-1, 3)[place] = texels.normal[whole]
        first, last = (_of_blocks(reduce, chart, least) for reduce in (np.minimum, np.maximum))
        low, high = (_of_blocks(reduce, normal, least) for reduce in (np.minimum, np.maximum))
        blocks = {least: _FlatBlocks(np.where(first == last, first, -1), low, high)}
        for stride in STRIDES[-2::-1]:
            blocks[stride] = blocks[stride // 2].coarser()
        return blocks

    def open_blocks(self, stride: int, flat: _FlatBlocks) -> _Blocks:
        """Blocks that are flat and not interpolated yet."""
        h, w = flat.chart.shape
        corner = self._lookup[: h * stride : stride, : w * stride : stride]
        row, column = np.nonzero((flat.chart >= 0) & ~self.between[corner])
        y, x = row * stride, column * stride
        corners = np.stack([self._lookup[y + dy, x + dx] for dy in (0, stride) for dx in (0, stride)], -1)
        centre = self._lookup[y + stride // 2, x + stride // 2]
        used, place = np.unique(np.concatenate([corners, centre[:, None]], 1), return_inverse=True)
        position = self.texels.positions(used)[place.reshape(-1, 5)]
        radius = np.linalg.norm(position[:, :4] - position[:, 4:], axis=2).max(1)
        spread = np.linalg.norm(flat.high[row, column] - flat.low[row, column], axis=1)
        return _Blocks(stride, corners, centre, row, column, radius, spread)

    def fill(self, blocks: _Blocks) -> None:
        """Interpolate blocks: bilinearly, with a tent that meets the centre.

        No weight is below 0 and their sum is 1, so that no colour leaves the range of the five that are known.
        """
        stride = blocks.stride
        rows, columns = (a.ravel() for a in np.mgrid[:stride, :stride])
        y, x = rows / stride, columns / stride
        corners = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x], -1)
        least = corners.min(1, keepdims=True)
        weights = np.concatenate([corners - least, 4.0 * least], 1)
        texel = self._lookup[blocks.row[:, None] * stride + rows, blocks.column[:, None] * stride + columns]
        five = np.concatenate([blocks.corners, blocks.centre[:, None]], 1)
        values = weights @ self.values[five]
        new = ~self.known[texel]
        self.values[texel[new]] = values[new]
        self.valid[texel] = 1.0
        self.between[texel] = True


def _of_blocks(reduce: np.ufunc, plane: np.ndarray, side: int) -> np.ndarray:
    """Least or greatest values (h, w, ...) in the blocks of a plane, rows and columns on their far sides included."""
    h, w = ((length - 1) // side for length in plane.shape[:2])
    rows = plane[: h * side : side].copy()
    for k in range(1, side + 1):
        reduce(rows, plane[k : k + h * side : side], out=rows)
    out = rows[:, : w * side : side].copy()
    for k in range(1, side + 1):
        reduce(out, rows[:, k : k + w * side : side], out=out)
    return out
