"""Tells whether the pixels of images changed, which Blender tells nobody: neither what a script sets nor a new size."""

from __future__ import annotations

import os
import zlib
from collections.abc import Hashable, Iterable

import bpy
import numpy as np


class PixelWatch:
    """Remembers images, and how their pixels were when last looked at."""

    def __init__(self) -> None:
        self._stamps: dict[int, Hashable] = {}  # by session uid

    def add(self, uids: Iterable[int]) -> None:
        """Watch these images too, from how they are now."""
        new = set(uids) - self._stamps.keys()
        if new:
            self._stamps.update(
                {image.session_uid: _stamp(image) for image in bpy.data.images if image.session_uid in new}
            )

    def changed(self) -> bool:
        """Whether pixels of any of the images changed since the last time."""
        if not self._stamps:
            return False
        before = self._stamps
        self._stamps = {image.session_uid: _stamp(image) for image in bpy.data.images if image.session_uid in before}
        return self._stamps != before


def _stamp(image: bpy.types.Image) -> Hashable:
    """What is another value once pixels are others: those that are not saved count themselves, others by their file."""
    packed = image.packed_file
    stamp = tuple(image.size), image.is_dirty, packed and (packed.as_pointer(), packed.size), _written_at(image)
    if not image.is_dirty:
        return stamp
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return *stamp, zlib.crc32(pixels)


def _written_at(image: bpy.types.Image) -> tuple[int, int] | None:
    """Time and size of an image's file, None without one."""
    if image.source != "FILE" or not image.filepath:
        return None
    try:
        found = os.stat(bpy.path.abspath(image.filepath, library=image.library))
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
