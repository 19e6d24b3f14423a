"""Turns baked pixels into an image of the .blend and into files, whole or not at all.

Facts that this file works around: `Image.pixels` reaches the first tile only, so that tiles go through files; an image
with tiles finds its tiles by looking for files, those of an earlier bake too; reloading a packed image packs the file
again; packing remembers where the file was.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress

import bpy
import numpy as np

from ...core.files import Parts, TargetError, check_whole, finished, replaced
from ...core.order import ImageFormat
from ..marks import MADE_HERE
from .image_files import (
    FIRST_TILE,
    MAX_TILES,
    ImageFileError,
    absolute_path,
    check_path,
    comparable,
    has_tile_token,
    loaded_files,
    stored_path,
    tile_file,
    tiled_path,
)
from .image_formats import write_exr, write_hdr, write_png

_MAX_NAME_BYTES = 59  # Blender keeps 63 with its number
_NUMBER = r"(\.\d{3,})?"  # which Blender adds to a name that is taken


class StagedImage:
    """A lightmap that has been written to part files; nothing of the user's has changed yet.

    Either `land` or `discard` ends it. Main thread only.
    """

    def __init__(self, name: str, path: str, image_format: ImageFormat, tiles: Sequence[int]) -> None:
        self._name, self._path, self._format = name, path, image_format
        self._tiles = list(tiles)  # empty for a plain image
        self._scratch = "" if path else _temporary_folder()
        self._load_path = absolute_path(path) if path else os.path.join(self._scratch, "page" + image_format.extension)
        if tiles:
            self._path = path and tiled_path(path)
            self._load_path = tiled_path(self._load_path)
        self._parts: list[tuple[str, str]] = []  # part file, and the file that it becomes
        self._names: Parts | None = None  # of the part files

    @property
    def files(self) -> list[str]:
        """Files that landing makes; none for a packed image."""
        return [target for _, target in self._parts] if self._path else []

    def write_page(self, pixels: np.ndarray) -> None:
        """Write the next page.

        Raises
        ------
        ImageFileError
            The file could not be written.
        """
        index = len(self._parts)
        target = os.path.realpath(tile_file(self._load_path, self._tiles[index]) if self._tiles else self._load_path)
        try:
            self._parts.append((self._part_for(target), target))
            _write(self._parts[-1][0], pixels, self._format)
            finished(self._parts[-1][0], check_whole)
        except (OSError, RuntimeError) as error:
            place = f"'{target}'" if self._path else f"the temporary file '{target}'"
            raise ImageFileError(
                f"{place} could not be written ({_reason(error)}): make room on the disk, or choose another folder"
            ) from error

    def _part_for(self, target: str) -> str:
        """Where a page is written first: beside its file, or in place in the temporary folder."""
        if not self._path:
            return target
        if self._names is None:
            self._names = Parts(os.path.dirname(target))
        return str(self._names.new(self._format.extension))

    def land(self) -> bpy.types.Image:
        """Put the files where they belong and the image into the .blend; on failure everything is as it was.

        An image that an earlier bake made for this name is updated in place, so that materials keep it.

        Raises
        ------
        ImageFileError
            A file could not be replaced, or Blender could not load or pack it.
        """
        try:
            with replaced(self._parts if self._path else [], self._names):
                image = self._into_blend()
            _reload_others(image, self.files)
            return image
        except TargetError as error:
            raise ImageFileError(str(error)) from error
        except (OSError, RuntimeError) as error:
            where = f"'{self._path}'" if self._path else f"the packed image '{self._name}'"
            raise ImageFileError(
                f"{where} could not be replaced ({_reason(error)}): close what else uses it, or choose another name"
            ) from error
        finally:
            self.discard()

    def discard(self) -> None:
        """Remove the part files; harmless when there are none any more."""
        if self._names is not None:
            self._names.close()
        if self._scratch:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def _into_blend(self) -> bpy.types.Image:
        image = _made_before(self._name)
        backup = image.copy() if image else None
        if image is None:
            image = bpy.data.images.new(_short(self._name), 1, 1)
        try:
            self._fill(image)
        except BaseException:
            if backup:  # a copy has everything, packed files too
                backup.use_fake_user = image.use_fake_user
                image.user_remap(backup)
            name = image.name
            bpy.data.images.remove(image)
            if backup:
                backup.name = name
            raise
        if backup:
            bpy.data.images.remove(backup)
        return image

    def _fill(self, image: bpy.types.Image) -> None:
        """Let an image show the files."""
        if image.packed_files:
            image.unpack(method="REMOVE")
        image.filepath_raw = stored_path(self._path) if self._path else self._load_path
        image.source = "TILED" if self._tiles else "FILE"
        with suppress(TypeError):  # a studio's own colour configuration may lack it
            image.colorspace_settings.name = "Linear Rec.709" if self._format.is_linear else "sRGB"
        image.alpha_mode = "CHANNEL_PACKED"  # alpha is coverage: it must not change the colour
        image.reload()
        if self._tiles:
            _keep_tiles(image, self._tiles)
        if not self._path:
            self._pack(image)
        if MADE_HERE not in image:
            image.use_fake_user = True  # a lightmap that no material uses yet must be saved all the same
        image[MADE_HERE] = self._name
        image.update_tag()

    def _pack(self, image: bpy.types.Image) -> None:
        """Pack the files, and forget the temporary folder that they come from."""
        image.pack()
        if len(image.packed_files) != len(self._parts):
            raise RuntimeError("Blender has not packed all of it")
        path = f"//{bpy.path.clean_name(image.name)}{self._format.extension}"
        image.filepath_raw = tiled_path(path) if self._tiles else path
        for packed in image.packed_files:
            packed.filepath = tile_file(image.filepath_raw, packed.tile_number)


def stage(
    pages: Sequence[np.ndarray | Callable[[], np.ndarray]], name: str, path: str, image_format: ImageFormat
) -> StagedImage:
    """Write a lightmap to part files beside where it will land. Main thread only.

    Parameters
    ----------
    pages : sequence of (size, size, 4) float32 arrays, or of functions that return them
        Linear values of Rec. 709, which may exceed 1, the bottom row first; alpha is coverage. Page i becomes tile
        1001 + i, which covers the UVs from (i % 10, i // 10) to one more; a single page is a plain image, unless the
        path has <UDIM> in it. A function is called when its page's turn has come, so that only one page needs to be
        in memory.
    name : str
        Of the image; one that an earlier bake made for this name is updated.
    path : str
        As for `check_path`; '' packs the image into the .blend.
    image_format : ImageFormat

    Raises
    ------
    ImageFileError
        The path cannot be used, or a file could not be written. Nothing is left behind.
    """
    image_format = ImageFormat(image_format)
    path = check_path(path, image_format)
    if len(pages) > MAX_TILES:
        raise ImageFileError(
            f"'{path or name}' would need {len(pages)} tiles, but Blender has {MAX_TILES}: choose larger pages"
        )
    tiles = range(FIRST_TILE, FIRST_TILE + len(pages)) if len(pages) > 1 or has_tile_token(path) else ()
    staged = StagedImage(name, path, image_format, tiles)
    try:
        for page in pages:
            staged.write_page(page() if callable(page) else page)
    except BaseException:
        staged.discard()
        raise
    return staged


def _write(path: str, pixels: np.ndarray, image_format: ImageFormat) -> None:
    if image_format is ImageFormat.HDR:
        write_hdr(path, pixels)
    elif image_format.is_linear:
        write_exr(path, pixels, full=image_format is ImageFormat.EXR_FULL)
    else:
        write_png(path, pixels, bits=16 if image_format is ImageFormat.PNG_16 else 8)


def _temporary_folder() -> str:
    try:
        return tempfile.mkdtemp(dir=bpy.app.tempdir or None)
    except OSError as error:
        raise ImageFileError(
            f"there is no folder for temporary files ({_reason(error)}): choose one in the preferences, or let the "
            "image go to a file"
        ) from error


def _made_before(name: str) -> bpy.types.Image | None:
    """The image that an earlier bake made for this name; the user may have an image of that name as well."""
    own = re.compile(re.escape(_short(name)) + _NUMBER)
    found = [
        image
        for image in bpy.data.images
        if image.get(MADE_HERE) == name and image.library is None and own.fullmatch(image.name)
    ]
    return min(found, key=lambda image: image.name, default=None)


def _short(name: str) -> str:
    """As much of a name as Blender keeps of it."""
    return name.encode()[:_MAX_NAME_BYTES].decode(errors="ignore")


def _keep_tiles(image: bpy.types.Image, wanted: Sequence[int]) -> None:
    """Let an image have these tiles, and none whose files lie about from an earlier bake."""
    for number in [tile.number for tile in image.tiles]:
        if number not in wanted:
            image.tiles.remove(image.tiles.get(number))
    missing = set(wanted) - {tile.number for tile in image.tiles}
    if missing:
        raise RuntimeError(f"Blender does not find the tiles {', '.join(map(str, sorted(missing)))}")


def _reload_others(image: bpy.types.Image, files: Sequence[str]) -> None:
    """Let other images that show these files show them as they are now, unless the user has painted on them."""
    written = {comparable(file) for file in files}
    for other in bpy.data.images:
        if other != image and not other.is_dirty and written & loaded_files(other):
            other.reload()


def _reason(error: Exception) -> str:
    """An error in a few words; the lines that Blender adds name files that the user does not know."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).splitlines()[0].removeprefix("Error: ") if str(error) else type(error).__name__
