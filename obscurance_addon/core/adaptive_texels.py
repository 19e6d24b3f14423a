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

from .texel_obscurances import TexelTracer
from .texels import Texels

STRIDES = (16, 8, 4)  # closer sparse texels, with more rays each, would cost as much as all texels
SPARSE_FACTOR = 2  # times the usual rays from a sparse texel, twice over: it stands for many, and tells its own noise
MOST_EXTRA_RAYS = (2 * SPARSE_FACTOR - 1) / 8  # of the usual ones: corners and centres of blocks are an eighth of all
_SECOND_HALF = 3  # replicate of the second time; 1 and 2 are those of the error sample
_WHOLE = 1.0 - 1e-6
_SURE = 2.0  # standard errors of the noise that the test at the centre allows


@dataclass
class Noise:
    """Variance of sparse values per channel, from all pairs of halves seen so far."""

    total: np.ndarray = field(default_factory=lambda: np.zeros(3))
    count: int = 0

    def add(self, one: np.ndarray, other: np.ndarray) -> None:
        """Note two independent halves (m, 3) of the same values."""
        self.total += (0.25 * (one - other) ** 2).sum(0)
        self.count += len(one)

    def variance(self) -> np.ndarray:
        """(3,) float64."""
        return self.total / max(self.count, 1)


class AdaptiveTexels:
    """Interpolates the texels of one band of rows after the other.

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
        self._noise = Noise()

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
        one = self._tracer.trace(band.texels, wanted, factor=SPARSE_FACTOR, with_distances=True)
        other = self._tracer.trace(
            band.texels, wanted, factor=SPARSE_FACTOR, replicate=_SECOND_HALF, with_distances=True
        )
        self._noise.add(self._white(one.values), self._white(other.values))
        band.known[wanted] = True
        band.valid[wanted] = 0.5 * (one.valid + other.valid)
        share = np.stack([one.valid, other.valid], 1)
        share /= np.maximum(share.sum(1), np.finfo(float).tiny)[:, None]
        band.values[wanted] = share[:, :1] * one.values + share[:, 1:] * other.values
        band.nearness[wanted] = np.maximum(one.nearness, other.nearness)
        band.nearest[wanted] = np.minimum(one.nearest, other.nearest)

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
        allowed = self._bound + _SURE * np.sqrt(1.25 * self._noise.variance())
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
    """

    def __init__(self, texels: Texels, rows: tuple[int, int]) -> None:
        n, size = len(texels), texels.size
        self.texels = texels
        self.values, self.valid = np.zeros((n, 4)), np.zeros(n)
        self.nearness, self.nearest = np.zeros(n), np.zeros(n)
        self.known, self.between = np.zeros(n, bool), np.zeros(n, bool)
        self._lookup = np.full((rows[1] - rows[0], size), -1)
        self._lookup.ravel()[texels.index - rows[0] * size] = np.arange(n)

    def flat_blocks(self) -> dict[int, _FlatBlocks]:
        """Blocks of every stride that hold one chart and nothing else."""
        texels, lookup = self.texels, self._lookup
        chart = np.where((lookup >= 0) & (texels.cover >= _WHOLE)[lookup], texels.chart[lookup], -1)
        normal = texels.normal[lookup].astype(np.float32)
        least = STRIDES[-1]
        h, w = ((side - 1) // least for side in lookup.shape)
        first, last, low, high = (np.zeros((h, w), chart.dtype),) * 2 + (np.zeros((h, w, 3), np.float32),) * 2
        if h and w:
            views = [
                (chart[y : y + h * least : least, x : x + w * least : least],
                 normal[y : y + h * least : least, x : x + w * least : least])
                for y in range(least + 1) for x in range(least + 1)
            ]  # fmt: skip
            first, last = (reduce([c for c, _ in views]) for reduce in (_least, _most))
            low, high = (reduce([v for _, v in views]) for reduce in (_least, _most))
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
        position = self.texels.position
        radius = np.linalg.norm(position[corners] - position[centre][:, None], axis=2).max(1)
        spread = np.linalg.norm(flat.high[row, column] - flat.low[row, column], axis=1)
        return _Blocks(stride, corners, centre, row, column, radius, spread)

    def fill(self, blocks: _Blocks) -> None:
        """Interpolate blocks: bilinearly, with a bump that meets the centre."""
        stride = blocks.stride
        rows, columns = (a.ravel() for a in np.mgrid[:stride, :stride])
        y, x = rows / stride, columns / stride
        weights = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x], -1)
        bump = 16.0 * y * (1.0 - y) * x * (1.0 - x)
        texel = self._lookup[blocks.row[:, None] * stride + rows, blocks.column[:, None] * stride + columns]
        known = self.values[blocks.corners]
        excess = self.values[blocks.centre] - known.mean(1)
        values = np.einsum("tk,bkc->btc", weights, known) + bump[:, None] * excess[:, None]
        new = ~self.known[texel]
        self.values[texel[new]] = np.maximum(values[new], 0.0)
        self.valid[texel] = 1.0
        self.between[texel] = True


def _least(arrays: list[np.ndarray]) -> np.ndarray:
    out = arrays[0].copy()
    for array in arrays[1:]:
        np.minimum(out, array, out=out)
    return out


def _most(arrays: list[np.ndarray]) -> np.ndarray:
    out = arrays[0].copy()
    for array in arrays[1:]:
        np.maximum(out, array, out=out)
    return out
