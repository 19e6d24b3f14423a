"""Writes the linear pixels of a lightmap to a file: EXR through Blender, PNG and Radiance HDR here.

Blender's own PNG and HDR are not used because they lose errors: on a full disk Blender reports success and leaves a
truncated file. Its PNG also divides the colour by alpha, which in a lightmap means coverage, and its HDR rounds down.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

import bpy
import numpy as np

BLOCK_TEXELS = 1 << 20  # converted at once: temporaries stay small beside the page
_SCRATCH_NAME = ".obscurance"

_PNG_LEVEL = 4  # of zlib
_PNG_UP = 2  # filter: each byte minus the one above it

_RGBE_LITERALS = 128  # the most that one run of bytes may hold
_RGBE_RUN_WIDTHS = range(8, 32768)  # other widths are stored pixel by pixel
_RGBE_MAX = 1.6e38  # just below exponent 128, which a byte cannot hold
_RGBE_MIN = 1e-38


def write_exr(path: str, pixels: np.ndarray, full: bool) -> None:
    """Write an OpenEXR file with lossless ZIP compression, half or full floats, linear. Main thread only.

    Parameters
    ----------
    path : str
    pixels : ndarray, (height, width, 4) float32
        The bottom row first, as for all writers here. The file has an alpha channel unless all alpha is 1.
    full : bool
        32 bits a channel instead of 16.

    Raises
    ------
    OSError
        Blender could not write the file, or not all of it.
    RuntimeError
        Blender has no memory for another copy of the pixels.
    """
    height, width = pixels.shape[:2]
    image = scene = None
    try:
        image = bpy.data.images.new(_SCRATCH_NAME, width, height, alpha=True, float_buffer=True)
        image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).reshape(-1))
        scene = bpy.data.scenes.new(_SCRATCH_NAME)  # only its settings tell Blender the depth and the compression
        settings = scene.render.image_settings
        settings.file_format = "OPEN_EXR"
        settings.exr_codec = "ZIP"
        settings.color_depth = "32" if full else "16"
        settings.color_mode = "RGBA" if has_alpha(pixels) else "RGB"
        try:
            image.save_render(path, scene=scene)
        except RuntimeError as error:  # it names the file and often the wrong cause
            raise OSError("the console may tell the cause") from error
    finally:
        if scene is not None:
            bpy.data.scenes.remove(scene)
        if image is not None:
            bpy.data.images.remove(image)
    with open(path, "rb+") as written:
        os.fsync(written.fileno())


def write_png(path: str, pixels: np.ndarray, bits: int) -> None:
    """Write a PNG file of sRGB-encoded colour, clamped to 0 .. 1, and linear alpha unless all of it is 1.

    Parameters
    ----------
    path : str
    pixels : ndarray, (height, width, 4) float32
        Linear.
    bits : {8, 16}
        Of each channel.

    Raises
    ------
    OSError
        The file could not be written.
    """
    height, width = pixels.shape[:2]
    channels = 4 if has_alpha(pixels) else 3
    dtype = np.dtype(">u2" if bits == 16 else "u1")
    packer = zlib.compressobj(_PNG_LEVEL)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        _png_chunk(file, b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 6 if channels == 4 else 2, 0, 0, 0))
        _png_chunk(file, b"sRGB", b"\0")
        above = np.zeros((1, width * channels * dtype.itemsize), np.uint8)
        for block in _from_the_top(pixels):
            values = np.clip(np.nan_to_num(block[..., :channels]), 0.0, 1.0)
            values[..., :3] = linear_to_srgb(values[..., :3])
            values *= 2**bits - 1
            rows = np.rint(values, out=values).astype(dtype).view(np.uint8).reshape(len(block), -1)
            filtered = np.full((len(rows), 1 + rows.shape[1]), _PNG_UP, np.uint8)
            filtered[:, 1:] = rows - np.concatenate([above, rows[:-1]])
            _png_chunk(file, b"IDAT", packer.compress(filtered))
            above = rows[-1:]
        _png_chunk(file, b"IDAT", packer.flush())
        _png_chunk(file, b"IEND", b"")
        file.flush()
        os.fsync(file.fileno())


def write_hdr(path: str, pixels: np.ndarray) -> None:
    """Write a Radiance HDR file: linear colour with a common exponent, nothing negative, no alpha.

    Parameters
    ----------
    path : str
    pixels : ndarray, (height, width, 4) float32

    Raises
    ------
    OSError
        The file could not be written.
    """
    height, width = pixels.shape[:2]
    with open(path, "wb") as file:
        file.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
        for block in _from_the_top(pixels):
            rgbe = _to_rgbe(block[..., :3])
            file.write(_as_literal_runs(rgbe) if width in _RGBE_RUN_WIDTHS else rgbe)
        file.flush()
        os.fsync(file.fileno())


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB-encoded values (IEC 61966-2-1) of linear ones, float32 of any shape; values below 0 stay linear."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1.0 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, linear * 12.92, curve).astype(np.float32)


def has_alpha(pixels: np.ndarray) -> bool:
    """Whether any alpha of a page is not 1."""
    return bool((pixels[..., 3] != 1.0).any())


def _from_the_top(pixels: np.ndarray) -> Iterator[np.ndarray]:
    """The rows of a page as files have them, the top one first, some at a time."""
    rows = max(1, BLOCK_TEXELS // pixels.shape[1])
    for start in range(0, len(pixels), rows):
        yield pixels[::-1][start : start + rows]


def _png_chunk(file: BinaryIO, kind: bytes, data: bytes) -> None:
    if not data and kind == b"IDAT":
        return  # the packer has not filled a buffer yet
    file.write(struct.pack(">I", len(data)) + kind)
    file.write(data)
    file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(kind))))


def _to_rgbe(color: np.ndarray) -> np.ndarray:
    """(rows, width, 4) uint8: colour as three mantissas, rounded to nearest, and the exponent of the largest."""
    color = np.clip(np.nan_to_num(color, posinf=_RGBE_MAX), 0.0, _RGBE_MAX)
    largest = color.max(axis=-1)
    mantissa, exponent = np.frexp(largest)
    exponent += mantissa * 256.0 >= 255.5  # would round up to 256
    rgbe = np.empty((*largest.shape, 4), np.uint8)
    rgbe[..., :3] = np.rint(np.ldexp(color, 8 - exponent[..., None]))
    rgbe[..., 3] = exponent + 128
    rgbe[largest < _RGBE_MIN] = 0
    return rgbe


def _as_literal_runs(rgbe: np.ndarray) -> np.ndarray:
    """Scanlines in the layout of run-length encoding, but all of their bytes as they are."""
    rows, width = rgbe.shape[:2]
    whole, rest = divmod(width, _RGBE_LITERALS)
    planes = rgbe.transpose(0, 2, 1)
    out = np.empty((rows, 4, whole * (_RGBE_LITERALS + 1) + (rest + 1 if rest else 0)), np.uint8)
    runs = out[..., : whole * (_RGBE_LITERALS + 1)].reshape(rows, 4, whole, _RGBE_LITERALS + 1)
    runs[..., 0] = _RGBE_LITERALS
    runs[..., 1:] = planes[..., : width - rest].reshape(rows, 4, whole, _RGBE_LITERALS)
    out[..., : whole * (_RGBE_LITERALS + 1)] = runs.reshape(rows, 4, -1)
    if rest:
        out[..., -rest - 1] = rest
        out[..., -rest:] = planes[..., width - rest :]
    start = np.broadcast_to(np.array([2, 2, width >> 8, width & 255], np.uint8), (rows, 4))
    return np.concatenate([start, out.reshape(rows, -1)], axis=1)
