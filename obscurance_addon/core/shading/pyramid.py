"""Box-filtered copies of an image, and lookups in them as Cycles looks up images. numpy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .arithmetic import lerp

# Copies are kept no larger than this on a side (90 MB with their pyramid): a face mean needs no finer texels.
MAX_SIDE = 2048


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Box-filtered copies of an image, each half the size of the one before, down to one texel.

    Attributes
    ----------
    texels : ndarray, (n, 4) float32
        All levels one after the other, linear RGBA.
    start, width, height : ndarray, (levels,) int
    """

    texels: np.ndarray
    start: np.ndarray
    width: np.ndarray
    height: np.ndarray

    @classmethod
    def of(cls, image: np.ndarray) -> Pyramid:
        """Pyramid of a linear (height, width, 4) float32 image; larger ones are first halved to MAX_SIDE."""
        while max(image.shape[:2]) > MAX_SIDE:
            image = _halve(_halve(image, 0), 1)
        levels = [image]
        while max(levels[-1].shape[:2]) > 1:
            levels.append(_halve(_halve(levels[-1], 0), 1))
        sizes = np.array([level.shape[:2] for level in levels])
        start = np.concatenate(([0], np.cumsum(sizes.prod(axis=1))[:-1]))
        texels = np.concatenate([level.reshape(-1, 4) for level in levels])
        return cls(texels, start, sizes[:, 1], sizes[:, 0])

    @property
    def mean(self) -> np.ndarray:
        """(4,) float32 mean of the whole image."""
        return self.texels[-1]

    def lookup(self, uv: np.ndarray, level: np.ndarray, extension: str, closest: bool) -> np.ndarray:
        """RGBA at texture coordinates.

        Parameters
        ----------
        uv : ndarray, (..., 2) float32
        level : ndarray of int, broadcastable to uv.shape[:-1]
        extension : {'REPEAT', 'EXTEND', 'CLIP', 'MIRROR'}
        closest : bool
            The nearest texel instead of the four around, bilinearly.

        Returns
        -------
        ndarray, (..., 4) float32
        """
        wrap, fold = EXTENSIONS[extension]
        start, sizes = self.start[level], (self.width[level], self.height[level])
        low, high, weight = [], [], []
        for axis, size in enumerate(sizes):
            x = fold(uv[..., axis]) * size.astype(np.float32) - np.float32(0.0 if closest else 0.5)
            floor = np.floor(x)
            whole = floor.astype(np.int64)
            low.append(wrap(whole, size))
            high.append(wrap(whole + 1, size))
            weight.append((x - floor)[..., None])
        rows = [start + y * sizes[0] for y in (low[1], high[1])]
        if closest:
            value = self.texels[rows[0] + low[0]]
        else:
            below, above = (lerp(weight[0], self.texels[row + low[0]], self.texels[row + high[0]]) for row in rows)
            value = lerp(weight[1], below, above)
        if extension == "CLIP":
            value *= np.all((uv >= 0.0) & (uv <= 1.0), axis=-1, keepdims=True)
        return value


def _halve(image: np.ndarray, axis: int) -> np.ndarray:
    """Box-filter one axis to half its length, rounded down. Odd lengths split texels, so the mean stays what it was."""
    image = np.moveaxis(image, axis, 0)
    length = image.shape[0]
    half = length // 2
    if length == 1:
        small = image
    elif length % 2 == 0:
        small = (image[0::2] + image[1::2]) * np.float32(0.5)
    else:
        i = np.arange(half, dtype=np.float32).reshape((-1,) + (1,) * (image.ndim - 1))
        small = ((half - i) * image[0:-1:2] + half * image[1::2] + (i + 1) * image[2::2]) / np.float32(length)
    return np.moveaxis(small, 0, axis)


def _stop_at_edges(index: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.clip(index, 0, size - 1)


# How texel indexes wrap, and how coordinates fold before they are scaled to texels. Repeating folds too: texel
# coordinates stay small, so that float32 keeps its precision far from the origin.
EXTENSIONS: dict[str, tuple[Callable, Callable]] = {
    "REPEAT": (np.mod, lambda u: u - np.floor(u)),
    "EXTEND": (_stop_at_edges, lambda u: np.clip(u, 0.0, 1.0)),
    "CLIP": (_stop_at_edges, lambda u: np.clip(u, 0.0, 1.0)),
    "MIRROR": (_stop_at_edges, lambda u: np.abs(u - 2.0 * np.round(u * 0.5))),
}
