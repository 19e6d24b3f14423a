"""Values of every frame of an animation on disk, which play back without a ray.

There is a file for each frame in which values changed, with those of the objects that did. The index tells what they
were baked with, and for each object the frames that hold it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...core.order import OutputSettings, Target
from ..reading import read_face_start
from ..writing import color_attribute, records, spread
from . import frame_file
from .cache_folder import UNREADABLE, CacheFolder, cannot_write
from .cache_index import NAME, CacheIndex, FrameCacheError, Runs, add_frame, latest

_CURE = "bake the frames again, or clear Frame Cache"


class FrameCache:
    """A frame cache that is read.

    Parameters
    ----------
    folder : Path
    index : CacheIndex

    Attributes
    ----------
    output : OutputSettings
        Where the values belong.
    frames : tuple of int
        The first and the last frame.
    """

    def __init__(self, folder: Path, index: CacheIndex) -> None:
        self.folder, self._index = folder, index
        self.output, self.frames = index.output, index.frames
        self.forget_shown()

    @classmethod
    def open(cls, folder: str | Path) -> FrameCache:
        """Open a folder that `FrameCacheWriter` wrote.

        Raises
        ------
        FrameCacheError
            When there is none, or it is broken.
        """
        folder = Path(folder)
        try:
            with _broken_means(folder, f"delete the folder and {_CURE}"):
                return cls(folder, CacheIndex.read(folder))
        except FileNotFoundError:
            raise FrameCacheError(f"there is no frame cache at '{folder}': {_CURE}") from None

    @staticmethod
    def written_at(folder: str | Path) -> tuple[int, int, int] | None:
        """What changes when the cache in a folder is written; None where there is none."""
        try:
            found = (Path(folder) / NAME).stat()
        except (OSError, ValueError):
            return None
        return found.st_mtime_ns, found.st_size, found.st_ino

    def has(self, frame: int) -> bool:
        """Whether the cache reaches to this frame."""
        return self.frames[0] <= frame <= self.frames[1]

    @property
    def names(self) -> list[str]:
        """Names of the objects that have values."""
        return list(self._index.objects)

    def forget_shown(self) -> None:
        """Write all values next time, whatever was written before."""
        self._shown: dict[str, int] = {}

    def show(self, frame: int) -> tuple[list[str], list[str]]:
        """Write the values of a frame into the meshes of the current scene.

        Returns
        -------
        changed, missing : list of str
            Names of objects that got other values, and of those that the scene does not have.

        Raises
        ------
        FrameCacheError
            When the cache is broken, or an object has other faces than it.
        AttributeNameError
            When a layer of the user's has the name of the result; nothing is written then.
        """
        wanted, objects = {}, bpy.context.view_layer.objects
        for name, runs in self._index.objects.items():
            stored = latest(runs, frame)
            if stored is not None and name in objects and self._shown.get(name) != stored:
                wanted[name] = stored
        for ob in (objects[name] for name in wanted if objects[name].type == "MESH"):
            for layer in self.output.layer_names():
                color_attribute.check_name(ob, layer)
        for stored in sorted(set(wanted.values())):
            places = {name: self._places(objects[name]) for name, at in wanted.items() if at == stored}
            for name, values in self._load(stored, places).items():
                self._write(objects[name], values)
                self._shown[name] = stored
        return list(wanted), [name for name in self._index.objects if name not in objects]

    def _load(self, frame: int, places: Mapping[str, int]) -> dict[str, np.ndarray]:
        """The values (n, 3) that the file of a frame has for objects with so many places."""
        path = self.folder / self._index.generation / frame_file.name_of(frame)
        try:
            with _broken_means(self.folder, _CURE):
                return frame_file.read(path, self._index.in_file(frame), places)
        except FileNotFoundError:
            raise FrameCacheError(f"the frame cache '{self.folder}' lacks files: {_CURE}") from None
        except frame_file.OtherElementsError as error:
            raise FrameCacheError(
                f"object '{error}' has other faces than the frame cache '{self.folder}': {_CURE}"
            ) from None

    def _places(self, ob: bpy.types.Object) -> int:
        """How many values an object takes."""
        mesh = ob.data
        if ob.type != "MESH" or mesh.is_editmode:
            raise FrameCacheError(
                f"object '{ob.name}' is in Edit Mode, or not a mesh, so that its cached values have no place: leave "
                "Edit Mode, or clear Frame Cache"
            )
        if not color_attribute.keeps_what_is_written(mesh):
            raise FrameCacheError(
                f"the mesh of object '{ob.name}' is linked, so that its cached values have no place: make it local "
                "(Object > Relations > Make Local), or clear Frame Cache"
            )
        return len(
            {Target.FACE: mesh.polygons, Target.CORNER: mesh.loops, Target.POINT: mesh.vertices}[self.output.target]
        )

    def _write(self, ob: bpy.types.Object, colours: np.ndarray) -> None:
        mesh, output = ob.data, self.output
        for name, domain in output.layers():
            layer = color_attribute.prepare(mesh, name, domain)
            face_start = read_face_start(mesh) if domain != output.target else None
            color_attribute.fill(mesh, layer, name, spread(colours, face_start))
            records.remember(mesh, name, self._index.stored, output.exposure)


class FrameCacheWriter:
    """Writes a frame cache beside the one that is in its folder, and puts it in its place at the end.

    Parameters
    ----------
    folder : Path
        What an earlier cache holds is replaced by `finish`.
    output : OutputSettings
    stored : str
        What the values are, as of `records`.
    settings : dict
        What they were baked with, to be read by people.

    Raises
    ------
    FrameCacheError
        When the folder holds anything but a frame cache, or cannot be made or written to.
    """

    def __init__(self, folder: Path, output: OutputSettings, stored: str, settings: dict) -> None:
        self._folder = CacheFolder(folder)
        self._output, self._stored, self._settings = output, stored, settings
        self._frames: tuple[int, int] | None = None
        self._objects: dict[str, Runs] = {}

    def add(self, frame: int, values: Mapping[str, np.ndarray]) -> None:
        """Add the values (n, 3) of the objects that changed in a frame; frames come in ascending order.

        Raises
        ------
        FrameCacheError
            When they cannot be written, as on a full disk.
        """
        self._frames = self._frames[0] if self._frames else frame, frame
        if not values:
            return
        try:
            frame_file.write(self._folder.generation / frame_file.name_of(frame), values)
        except OSError as error:
            raise cannot_write(self._folder.path, error) from None
        for name in values:
            add_frame(self._objects.setdefault(name, []), frame)

    def finish(self) -> None:
        """Put the cache in its place; raises FrameCacheError when it cannot, which leaves the earlier one."""
        folder = self._folder
        former = folder.former_files()
        index = CacheIndex(self._output, self._stored, self._frames, self._objects, folder.generation.name, former)
        try:
            folder.replace_index(index, self._settings)
        except OSError as error:
            raise cannot_write(folder.path, error) from None

    def discard(self) -> None:
        """Remove what is not in its place; after `finish` the earlier cache, else what was written so far."""
        self._folder.leave()


@contextmanager
def _broken_means(folder: Path, cure: str) -> Iterator[None]:
    """Turn what a broken file raises into an error with the cure; one that is not there stays FileNotFoundError."""
    try:
        yield
    except FileNotFoundError:
        raise
    except UNREADABLE as error:
        plain = isinstance(error, ValueError) and not isinstance(error, (UnicodeError, json.JSONDecodeError))
        why = getattr(error, "strerror", None) or (str(error) if plain else "a file is not of a frame cache")
        raise FrameCacheError(f"the frame cache '{folder}' cannot be read ({why}): {cure}") from None
