"""Formats of lightmap files, where the files go, and how they get there whole."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import bpy

from ...core.errors import ObscuranceError
from ...core.order import ImageFormat

UDIM = "<UDIM>"  # stands for the number of a tile in the name of a file
FIRST_TILE = 1001
MAX_TILES = 1000  # Blender's tiles end at 2000
_MAX_PATH_BYTES = 1000  # Blender cuts off what is longer


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
        When the folder is missing or write-protected, the path names a folder, the extension belongs to another
        format, or '//' has no meaning because the .blend has not been saved.
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
    _check_target(full)
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


@contextmanager
def moved(files: Sequence[tuple[str, str]]) -> Iterator[None]:
    """Rename part files onto their targets for good, or, when the body fails, only until then.

    A kill at any moment leaves each target whole, the old one or the new one.
    """
    aside: list[tuple[str, str]] = []  # the old file under another name, or '' if there was none, and the target
    try:
        for part, target in files:
            old = _set_aside(target)
            aside.append((old, target))
            if old:
                shutil.copymode(old, part)
            os.replace(part, target)
        yield
    except BaseException:
        for old, target in aside:
            with suppress(OSError):
                _restore(old, target)
        raise
    for old in filter(None, (old for old, _ in aside)):
        with suppress(OSError):
            os.unlink(old)


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


def _check_target(path: str) -> None:
    """What can be known of the file and its folder before there is anything to write."""
    target = tile_file(absolute_path(path), FIRST_TILE)
    if len(os.fsencode(target)) > _MAX_PATH_BYTES:
        raise ImageFileError(f"'{path}' is too long for Blender: choose a shorter path")
    if os.path.isdir(target):
        raise ImageFileError(f"'{path}' is a folder: choose another name")
    folder = os.path.dirname(os.path.realpath(target))
    if not os.path.isdir(folder):
        raise ImageFileError(f"'{path}': the folder '{folder}' does not exist: create it first")
    if not os.access(folder, os.W_OK):
        raise ImageFileError(
            f"'{path}': the folder '{folder}' cannot be written to: change its permissions or choose another"
        )
    try:
        exists = bool(os.stat(target))
    except FileNotFoundError:
        exists = False
    except OSError as error:
        raise ImageFileError(f"'{path}' cannot be used ({error.strerror}): choose another name") from error
    if exists and not os.access(target, os.W_OK):
        raise ImageFileError(f"'{path}' is write-protected: change its permissions or choose another name")


def _set_aside(target: str) -> str:
    """Give an existing file a second name, and return that."""
    if not os.path.lexists(target):
        return ""
    old = os.path.join(os.path.dirname(target), f".obscurance-{uuid.uuid4().hex[:12]}.old")
    try:
        os.link(target, old)
    except OSError:  # the file system has no links
        shutil.copy2(target, old)
    return old


def _restore(old: str, target: str) -> None:
    """Undo the replacement of a file, if there has been one; where this fails the old file stays beside it."""
    if not old:
        os.unlink(target)
        return
    os.replace(old, target)
    if os.path.lexists(old):  # the two are one file still, which renaming leaves alone
        os.unlink(old)
