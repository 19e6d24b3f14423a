"""Reads Blender's images."""

from __future__ import annotations

import logging

import bpy
import numpy as np

from ...core.shading import Texture

logger = logging.getLogger(__name__)


class ImageCache:
    """Textures read during one bake; each image is read once for each way of treating its alpha. Main thread only."""

    def __init__(self) -> None:
        self._textures: dict[tuple[int, str], Texture | None] = {}

    def __len__(self) -> int:
        return len(self._textures)

    @property
    def uids(self) -> set[int]:
        """Session uids of the images that were read."""
        return {uid for uid, _alpha in self._textures}

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


def is_linear(image: bpy.types.Image) -> bool:
    """Whether the stored values are linear: float images always, byte images by the name of their colour space."""
    name = image.colorspace_settings.name
    return image.is_float or name == "Non-Color" or name.startswith("Linear") or name == "scene_linear"


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
