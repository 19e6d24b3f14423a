"""One page of an atlas while it is being filled."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import GeometryError
from .filling import dilate, fill_inside_charts

_BLOCK_TEXELS = 1 << 18  # turned into colours at once
_BYTES_PER_TEXEL = 20  # pixels and chart


@dataclass
class AtlasPage:
    """One page while it is being filled.

    Attributes
    ----------
    pixels : ndarray, (size * size, 4) float32
    chart : ndarray, (size * size,) int32
        -1 for empty texels.
    size : int
    missing : list of ndarray of int64
        Covered texels without a value of their own, in any order.
    """

    pixels: np.ndarray
    chart: np.ndarray
    size: int
    missing: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def empty(cls, size: int, on_disk: bool) -> AtlasPage:
        """A page without values, kept in a temporary file if it is one of many."""

        def array(shape: tuple[int, ...], dtype: type) -> np.ndarray:
            if not on_disk:
                return np.zeros(shape, dtype)
            with tempfile.TemporaryFile() as file:
                return np.memmap(file, dtype, "w+", shape=shape)

        chart = array((size * size,), np.int32)
        chart[:] = -1
        return cls(array((size * size, 4), np.float32), chart, size)

    def put(self, texel: np.ndarray, values: np.ndarray, chart: np.ndarray, valid: np.ndarray) -> None:
        """Set texels (n,) to values (n, 4), and note their charts, and which of them have no value after all.

        Several threads may do so at once, each with its own texels.
        """
        self.pixels[texel], self.chart[texel] = values, chart
        self.missing.append(texel[~valid])

    def finish(
        self, to_color: Callable[[np.ndarray], None], open_color: np.ndarray, margin: int, check: Callable[[], None]
    ) -> np.ndarray:
        """Turn values into colours and continue them into what has none; (size, size, 4) float32, bottom row first.

        `to_color` works in place on values (k, 4), `open_color` (3,) is for texels of which nothing is known, `margin`
        in texels, and `check` raises to cancel.
        """
        for at in range(0, len(self.pixels), _BLOCK_TEXELS):
            check()
            to_color(self.pixels[at : at + _BLOCK_TEXELS])
        missing = np.sort(np.concatenate(self.missing or [np.zeros(0, np.int64)]))
        alone = fill_inside_charts(self.pixels, self.chart, missing, self.size)
        self.pixels[alone, :3] = open_color
        dilate(self.pixels, self.chart, self.size, margin)
        self.pixels[:, 3] = self.chart >= 0
        self.pixels[self.chart < 0, :3] = 0.0
        return self.pixels.reshape(self.size, self.size, 4)


def check_room(pages: int, size: int) -> None:
    """Make sure that pages fit into temporary files: writing to one that has no room would end the process."""
    folder = tempfile.gettempdir()
    needed, free = pages * size * size * _BYTES_PER_TEXEL, shutil.disk_usage(folder).free
    if needed > free:
        raise GeometryError(
            f"{pages} pages of {size} need {needed / 2**30:.1f} GiB for temporary files, but '{folder}' has "
            f"{free / 2**30:.1f} GiB left: make room, or use a lower texel density"
        )
