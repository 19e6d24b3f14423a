"""Images as linear texels, filtered by whichever thread first needs them."""

from __future__ import annotations

import threading

import numpy as np

from .arithmetic import srgb_to_linear
from .pyramid import Pyramid

MEGATEXEL = 1 << 20  # converted at once: temporaries stay small beside the image


class Texture:
    """Linear RGBA pixels of one image and their box-filtered pyramid, built by whichever thread first needs it.

    Parameters
    ----------
    stored : ndarray, (height, width, 4) float32
        Values as Blender hands them out, bottom row first. The texture owns the array and overwrites it.
    byte_curve : bool
        Byte images that hold sRGB-encoded values.
    alpha : {'KEEP', 'MULTIPLY', 'DIVIDE'}
        What Cycles does to the colour: multiply or divide by alpha before the curve, or neither.
    """

    def __init__(self, stored: np.ndarray, byte_curve: bool, alpha: str) -> None:
        self.height, self.width = stored.shape[:2]
        self._stored: np.ndarray | None = stored
        self._byte_curve = byte_curve
        self._alpha = alpha
        self._pyramid: Pyramid | None = None
        self._lock = threading.Lock()

    def __getstate__(self) -> dict:
        with self._lock:
            return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict) -> None:
        vars(self).update(state, _lock=threading.Lock())

    @property
    def pyramid(self) -> Pyramid:
        with self._lock:
            if self._pyramid is None:
                _make_linear(self._stored, self._byte_curve, self._alpha)
                self._pyramid = Pyramid.of(self._stored)
                self._stored = None
            return self._pyramid


def _make_linear(pixels: np.ndarray, byte_curve: bool, alpha: str) -> None:
    """Turn stored values into linear ones in place, a megatexel at a time."""
    table = srgb_to_linear(np.arange(256, dtype=np.float32) / np.float32(255.0))
    rows = max(1, MEGATEXEL // pixels.shape[1])
    for start in range(0, pixels.shape[0], rows):
        color, opacity = pixels[start : start + rows, :, :3], pixels[start : start + rows, :, 3:]
        if alpha == "MULTIPLY":
            color *= opacity
        elif alpha == "DIVIDE":
            color /= np.where(opacity == 0.0, np.float32(1.0), opacity)
        if byte_curve:
            color[...] = table[(color * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)]
