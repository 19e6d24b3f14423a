"""Names of lightmap files, and where the files go."""

from __future__ import annotations

import os

import bpy

from ...core.errors import ObscuranceError
from ...core.files import TargetError, check_target
from ...core.order import ImageFormat

UDIM = "<UDIM>"  # stands for the number of a tile in the name of a file
FIRST_TILE = 1001
MAX_TILES = 1000  # Blender's tiles end at 2000


class ImageFileError(ObscuranceError):
    """A lightmap cannot be written where it should go; the message names the path and the cure."""


def check_path(path: str, image_format: ImageFormat) -> str:
    """Make sure, as far as one can tell before, that a lightmap can be written to a path.

    Parameters
    ----------
    path : str
        Absolute, relative to the working directory, or after '//' relative to the .blend; '' for an image that is
        packed into the .blend. The name may have <UDIM> in it.
    image_format : ImageFormat

    Returns
    -------
    str
        The path with the format's extension, added if there was none.

    Raises
    ------
    ImageFileError
        When the file cannot be written (`check_target`), the extension belongs to another format, or '//' has no
        meaning because the .blend has not been saved.
    """
    if not path:
        return path
    if path.startswith("//") and not bpy.data.filepath:
        raise ImageFileError(
            f"'{path}' is relative to the .blend, which has not been saved: save it first, or give an absolute path"
        )
    if path.endswith(("/", os.sep)) or os.path.isdir(absolute_path(path)):
        raise ImageFileError(f"'{path}' is a folder: name a file in it")
    full = _with_extension(path, ImageFormat(image_format))
    try:
        check_target(tile_file(absolute_path(full), FIRST_TILE))
    except TargetError as error:
        raise ImageFileError(f"'{path}' cannot be the file of the lightmap: {error}") from None
    return full


def absolute_path(path: str) -> str:
    """Where a user's path leads: '//' is the folder of the .blend, other relative paths start at the working one."""
    return os.path.abspath(bpy.path.abspath(path))


def stored_path(path: str) -> str:
    """The path as an image keeps it: '//' as the user gave it, else relative if the user prefers that."""
    if path.startswith("//"):
        return path
    absolute = absolute_path(path)
    if bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths:
        try:
            return bpy.path.relpath(absolute)
        except ValueError:  # another drive
            pass
    return absolute


def tiled_path(path: str) -> str:
    """The path with <UDIM> in the name of the file, before the extension unless the user has put it elsewhere."""
    if has_tile_token(path):
        return path
    stem, extension = os.path.splitext(path)
    return f"{stem}.{UDIM}{extension}"


def has_tile_token(path: str) -> bool:
    """Whether the name of the file has <UDIM> in it."""
    return UDIM in os.path.basename(path)


def tile_file(path: str, tile: int) -> str:
    """The file of one tile."""
    folder, name = os.path.split(path)
    return os.path.join(folder, name.replace(UDIM, str(tile)))


def loaded_files(image: bpy.types.Image) -> set[str]:
    """Files on disk that an image shows, in a form that can be compared with `comparable`."""
    if image.packed_files or image.source not in {"FILE", "TILED"} or not image.filepath_raw:
        return set()
    path = bpy.path.abspath(image.filepath_raw, library=image.library)
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else [FIRST_TILE]
    return {comparable(tile_file(path, tile)) for tile in tiles}


def comparable(path: str) -> str:
    """The same text for the same file, however it was named."""
    return os.path.normcase(os.path.realpath(path))


def _with_extension(path: str, image_format: ImageFormat) -> str:
    wanted, found = image_format.extension, os.path.splitext(path)[1]
    if found.lower() == wanted:
        return path
    if found.lower() in bpy.path.extensions_image:
        raise ImageFileError(
            f"'{path}' ends in {found}, but files of the format {image_format} end in {wanted}: change the name or "
            "the format"
        )
    return path + wanted
