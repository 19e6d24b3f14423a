"""Blender's images as linear texels, read on the main thread and filtered by whichever thread first needs them."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

import numpy as np

from .color_arithmetic import srgb_to_linear
from .texture_pyramid import Pyramid

if TYPE_CHECKING:
    import bpy

logger = logging.getLogger(__name__)

MEGATEXEL = 1 << 20  # converted at once: temporaries stay small beside the image


class ImageCache:
    """Textures read during one bake; each image is read once for each way of treating its alpha. Main thread only."""

    def __init__(self) -> None:
        self._textures: dict[tuple[int, str], Texture | None] = {}

    def __len__(self) -> int:
        return len(self._textures)

    def texture(self, image: bpy.types.Image, alpha_linked: bool) -> Texture | None:
        """The image's texture, or None if Blender has no pixels for it.

        Parameters
        ----------
        image : bpy.types.Image
        alpha_linked : bool
            The node's Alpha output is used: Cycles then hands out the colour without alpha in it.
        """
        alpha = _alpha_treatment(image, alpha_linked)
        key = (image.session_uid, alpha)
        if key not in self._textures:
            self._textures[key] = _read_image(image, alpha)
        return self._textures[key]


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

    @property
    def pyramid(self) -> Pyramid:
        with self._lock:
            if self._pyramid is None:
                _make_linear(self._stored, self._byte_curve, self._alpha)
                self._pyramid = Pyramid.of(self._stored)
                self._stored = None
            return self._pyramid


def is_linear(image: bpy.types.Image) -> bool:
    """Whether the stored values are linear: float images always, byte images by the name of their colour space."""
    name = image.colorspace_settings.name
    return image.is_float or name == "Non-Color" or name.startswith("Linear") or name == "scene_linear"


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


def _alpha_treatment(image: bpy.types.Image, alpha_linked: bool) -> str:
    """What Cycles does to the colour. Blender keeps byte images straight and float images with alpha in them."""
    if image.colorspace_settings.is_data or image.alpha_mode in {"CHANNEL_PACKED", "NONE"}:
        return "KEEP"
    if image.is_float:
        return "DIVIDE" if alpha_linked else "KEEP"
    return "KEEP" if alpha_linked else "MULTIPLY"


def _read_image(image: bpy.types.Image, alpha: str) -> Texture | None:
    width, height = image.size
    count = len(image.pixels)
    if not width or not height or count < width * height:
        return None
    channels = count // (width * height)
    stored = np.empty(width * height * channels, np.float32)
    image.pixels.foreach_get(stored)
    stored = stored.reshape(height, width, channels)
    if channels < 4:
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = stored[..., :3] if channels == 3 else stored[..., :1]
        if channels == 2:
            rgba[..., 3] = stored[..., 1]
        stored = rgba
    if image.alpha_mode == "NONE":
        stored[..., 3] = 1.0
    np.nan_to_num(stored, copy=False, posinf=0.0, neginf=0.0)
    logger.debug("read image %s, %d x %d", image.name, width, height)
    return Texture(stored, byte_curve=not is_linear(image), alpha=alpha)
