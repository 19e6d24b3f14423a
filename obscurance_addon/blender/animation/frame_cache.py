"""Values of every frame of an animation on disk, which play back without a ray.

A folder holds `index.json` and one `.npz` for each frame in which values changed, with the colours (n, 3) float32 of
the objects that did. The index tells what they were baked with, and for each object the frames that hold it.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import zipfile
from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.order import OutputSettings, Target
from ..reading import read_face_start
from ..writing import color_attribute, records, spread

_INDEX = "index.json"
_VERSION = 1


class FrameCacheError(ObscuranceError):
    """A frame cache that cannot be read or written; the message names the folder and the cure."""


class FrameCache:
    """A frame cache that is read.

    Parameters
    ----------
    folder : Path
    index : dict
        What `index.json` holds.

    Attributes
    ----------
    output : OutputSettings
        Where the values belong.
    frames : tuple of int
        The first and the last frame.
    """

    def __init__(self, folder: Path, index: dict) -> None:
        self.folder = folder
        self.output = OutputSettings(**index["output"])
        self._stored = index["stored"]
        self.frames = tuple(index["frames"])
        self._objects: dict[str, list[int]] = index["objects"]
        self.forget_shown()

    @classmethod
    def open(cls, folder: str | Path) -> FrameCache:
        """Open a folder that `FrameCacheWriter` wrote.

        Raises
        ------
        FrameCacheError
            When there is none, or it is broken.
        """
        path = Path(folder) / _INDEX
        try:
            index = json.loads(path.read_text(encoding="utf-8"))
            if index["version"] != _VERSION:
                raise FrameCacheError(f"the frame cache '{folder}' is of another version: bake the frames again")
            return cls(Path(folder), index)
        except FileNotFoundError:
            raise FrameCacheError(
                f"there is no frame cache at '{folder}': bake the frames again, or clear Frame Cache"
            ) from None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FrameCacheError(
                f"the frame cache '{folder}' cannot be read ({error}): bake the frames again, or clear Frame Cache"
            ) from None

    @staticmethod
    def written_at(folder: str | Path) -> float:
        """When the cache in a folder was written, seconds; 0 where there is none."""
        try:
            return (Path(folder) / _INDEX).stat().st_mtime
        except OSError:
            return 0.0

    def has(self, frame: int) -> bool:
        """Whether the cache reaches to this frame."""
        return self.frames[0] <= frame <= self.frames[1]

    @property
    def names(self) -> list[str]:
        """Names of the objects that have values."""
        return list(self._objects)

    def stored_frames(self) -> set[int]:
        """The frames that have a file."""
        return set().union(*self._objects.values())

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
            When an object has other faces than the cache.
        AttributeNameError
            When a layer of the user's has the name of the result; nothing is written then.
        """
        wanted, objects = {}, bpy.context.view_layer.objects
        for name, frames in self._objects.items():
            at = bisect_right(frames, frame)
            if at and name in objects and self._shown.get(name) != frames[at - 1]:
                wanted[name] = frames[at - 1]
        for ob in (objects[name] for name in wanted if objects[name].type == "MESH"):
            for layer in self.output.layer_names():
                color_attribute.check_name(ob, layer)
        for stored in sorted(set(wanted.values())):
            values = self._load(stored)
            for name in (name for name, at in wanted.items() if at == stored):
                self._write(objects[name], values[name])
                self._shown[name] = stored
        return list(wanted), [name for name in self._objects if name not in objects]

    def _load(self, frame: int) -> dict[str, np.ndarray]:
        path = self.folder / _name(frame)
        try:
            with np.load(path) as stored:
                place = {name: str(i) for i, name in enumerate(json.loads(str(stored["names"])))}
                return {name: stored[place[name]] for name, frames in self._objects.items() if frame in frames}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise FrameCacheError(f"'{path}' cannot be read ({error}): bake the frames again") from None

    def _write(self, ob: bpy.types.Object, colours: np.ndarray) -> None:
        mesh, output = ob.data, self.output
        if ob.type != "MESH" or mesh.is_editmode:
            raise FrameCacheError(f"object '{ob.name}' is in Edit Mode, or not a mesh: its cached values have no place")
        elements = {
            Target.FACE: len(mesh.polygons),
            Target.CORNER: len(mesh.loops),
            Target.POINT: len(mesh.vertices),
        }[output.target]
        if elements != len(colours):
            raise FrameCacheError(
                f"object '{ob.name}' has other faces than the frame cache '{self.folder}': bake the frames again, or "
                "clear Frame Cache"
            )
        for name, domain in output.layers():
            layer = color_attribute.prepare(mesh, name, domain)
            face_start = read_face_start(mesh) if domain != output.target else None
            color_attribute.fill(mesh, layer, name, spread(colours, face_start))
            records.remember(mesh, name, self._stored, output.exposure)


class FrameCacheWriter:
    """Writes a frame cache beside its place, and puts it there whole at the end.

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
        When the folder holds anything but a frame cache, or cannot be made.
    """

    def __init__(self, folder: Path, output: OutputSettings, stored: str, settings: dict) -> None:
        self._folder = folder
        self._part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
        _check_replaceable(folder)
        try:
            self._part.mkdir()
        except OSError as error:
            raise FrameCacheError(
                f"the folder '{folder}' cannot be made ({error.strerror}): choose another one"
            ) from None
        self._index = {
            "version": _VERSION,
            "stored": stored,
            "output": {name: getattr(output, name) for name in ("target", "attribute_name", "scale", "corner_copy")}
            | {"exposure": output.exposure},
            "settings": settings,
            "frames": None,
            "objects": {},
        }

    def add(self, frame: int, values: Mapping[str, np.ndarray]) -> None:
        """Add the values (n, 3) of the objects that changed in a frame; frames come in ascending order."""
        self._index["frames"] = [self._index["frames"][0] if self._index["frames"] else frame, frame]
        if not values:
            return
        arrays = {str(i): np.asarray(colours, np.float32) for i, colours in enumerate(values.values())}
        np.savez(self._part / _name(frame), names=np.array(json.dumps(list(values))), **arrays)
        for name in values:
            self._index["objects"].setdefault(name, []).append(frame)

    def finish(self) -> None:
        """Put the cache in its place."""
        (self._part / _INDEX).write_text(json.dumps(self._index, indent=1) + "\n", encoding="utf-8")
        old = self._folder.with_name(f".{self._folder.name}.{os.getpid()}.old")
        names = _check_replaceable(self._folder)  # once more: the bake took its time
        try:
            if self._folder.exists():
                self._folder.rename(old)
            try:
                self._part.rename(self._folder)
            except OSError:
                if old.exists():
                    old.rename(self._folder)
                raise
        except OSError as error:
            raise FrameCacheError(
                f"the folder '{self._folder}' cannot be replaced ({error.strerror}): choose another one"
            ) from None
        if old.exists():
            for name in names:
                (old / name).unlink(missing_ok=True)
            old.rmdir()

    def discard(self) -> None:
        """Remove what was written so far; harmless after `finish`."""
        if self._part.exists():
            shutil.rmtree(self._part)


def _name(frame: int) -> str:
    return f"frame_{frame:06d}.npz"


def _check_replaceable(folder: Path) -> list[str]:
    """Names of the files of the frame cache that a folder holds; none where it is empty or not there.

    Raises
    ------
    FrameCacheError
        When it holds anything else, which a bake must not remove.
    """
    if folder.is_file():
        raise FrameCacheError(f"'{folder}' is a file: choose another name")
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    own: set[str] = set()
    if _INDEX in names:
        with contextlib.suppress(ObscuranceError):  # an index that cannot be read is somebody else's
            own = {_INDEX, *map(_name, FrameCache.open(folder).stored_frames())}
    if others := sorted(names - own):
        raise FrameCacheError(f"'{folder}' holds '{others[0]}', which is not of a frame cache: choose another folder")
    return sorted(names)
