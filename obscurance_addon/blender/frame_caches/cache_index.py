"""The index of a frame cache: what was baked, and which frames hold values of which objects."""

from __future__ import annotations

import json
import os
import re
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import ObscuranceError
from ...core.light import Quantity
from ...core.order import OutputSettings, Target
from ..writing import INDIRECT
from . import frame_file
from .plain_file import exactly, opened

NAME = "index.json"
_VERSION, _FIRST_VERSION = 2, 1
_MAX_BYTES = 32 << 20  # of JSON, which takes some 20 times as much memory at worst
_MAX_FRAME = 1048574  # of Blender
_MAX_NAME_BYTES = 256
_OUTPUT = {
    "target": (str,),
    "attribute_name": (str,),
    "scale": (str,),
    "corner_copy": (bool,),
    "exposure": (int, float),
}
_TARGETS = {target.value for target in Target if target is not Target.LIGHTMAP}
_STORED = {quantity.value for quantity in Quantity} | {INDIRECT}
_NOT_AN_INDEX = "the index is not that of a frame cache"
is_generation = re.compile(r"frames-[0-9a-f]{12}").fullmatch

Runs = list[tuple[int, int]]  # ascending frames, as first and last of those that follow each other


class FrameCacheError(ObscuranceError):
    """A frame cache that cannot be read or written; the message names the folder and the cure."""

    def __init__(self, message: str) -> None:
        super().__init__(message.encode(errors="replace").decode())  # Blender shows no half characters, as of a path


@dataclass(frozen=True)
class CacheIndex:
    """What the file says.

    Attributes
    ----------
    output : OutputSettings
        Where the values belong.
    stored : str
        What they are, as of `records`.
    frames : (int, int)
        The first and the last frame.
    objects : dict of str to Runs
        For each object the frames in which its values changed.
    generation : str
        The folder below that of the cache with the files; '' where they lie beside the index, as those of version 1.
    former : frozenset of str
        Files beside the index that belonged to a cache of version 1 which this one replaced.
    """

    output: OutputSettings
    stored: str
    frames: tuple[int, int]
    objects: dict[str, Runs]
    generation: str = ""
    former: frozenset[str] = frozenset()

    @classmethod
    def read(cls, folder: Path) -> CacheIndex:
        """Read the index of a folder.

        Raises
        ------
        OSError, ValueError, TypeError, KeyError, RecursionError
            When there is none, or it is not what `text` makes,
        FrameCacheError
            or of a version that is not known.
        """
        with opened(folder / NAME) as file:
            size = os.fstat(file.fileno()).st_size
            _demand(size <= _MAX_BYTES)
            found = json.loads(exactly(file, size).decode())
        _demand(isinstance(found, dict) and type(found.get("version")) is int)
        if found["version"] not in {_FIRST_VERSION, _VERSION}:
            raise FrameCacheError(
                f"the frame cache '{folder}' is of another version of the add-on: choose another folder for a bake, or "
                "clear Frame Cache"
            )
        return cls._checked(found)

    @classmethod
    def _checked(cls, found: dict) -> CacheIndex:
        output, first_version = found["output"], found["version"] == _FIRST_VERSION
        _demand(isinstance(output, dict) and output.keys() == _OUTPUT.keys())
        _demand(all(type(output[name]) in kinds for name, kinds in _OUTPUT.items()))
        _demand(output["target"] in _TARGETS and _is_name(output["attribute_name"]))
        _demand(type(found["stored"]) is str and found["stored"] in _STORED)
        frames, objects = found["frames"], found["objects"]
        _demand(isinstance(frames, list) and len(frames) == 2 and isinstance(objects, dict))
        _demand(all(map(_is_name, objects)))
        ((first, last),) = _runs([frames])
        runs = {}
        for name, listed in objects.items():
            _demand(isinstance(listed, list) and len(listed) > 0)
            runs[name] = _runs([[frame, frame] for frame in listed] if first_version else listed)
            _demand(first <= runs[name][0][0] and runs[name][-1][1] <= last)
        generation, former = ("", []) if first_version else (found["generation"], found["former"])
        _demand(first_version or (isinstance(generation, str) and is_generation(generation) is not None))
        _demand(isinstance(former, list) and all(isinstance(name, str) and frame_file.is_name(name) for name in former))
        return cls(OutputSettings(**output), found["stored"], (first, last), runs, generation, frozenset(former))

    def text(self, settings: dict) -> str:
        """The index as it is written, together with settings for people to read."""
        output = {name: getattr(self.output, name) for name in _OUTPUT}
        return (
            json.dumps(
                {
                    "version": _VERSION,
                    "generation": self.generation,
                    "stored": self.stored,
                    "output": output,
                    "settings": settings,
                    "frames": self.frames,
                    "objects": self.objects,
                    "former": sorted(self.former),
                }
            )
            + "\n"
        )

    def files_beside(self) -> set[str]:
        """Names of files of the cache that lie beside the index."""
        if self.generation:
            return set(self.former)
        runs = (run for runs in self.objects.values() for run in runs)
        return {frame_file.name_of(frame) for first, last in runs for frame in range(first, last + 1)}

    def in_file(self, frame: int) -> list[str]:
        """Names of the objects that the file of a frame holds."""
        return [name for name, runs in self.objects.items() if latest(runs, frame) == frame]


def latest(runs: Runs, frame: int) -> int | None:
    """The frame of `runs` that holds at a frame; None where all of them come later."""
    at = bisect_right(runs, frame, key=lambda run: run[0])
    return min(frame, runs[at - 1][1]) if at else None


def add_frame(runs: Runs, frame: int) -> None:
    """Add a frame that follows all of `runs`."""
    if runs and runs[-1][1] == frame - 1:
        runs[-1] = runs[-1][0], frame
    else:
        runs.append((frame, frame))


def _runs(listed: list) -> Runs:
    runs, before = [], -_MAX_FRAME - 1
    for run in listed:
        _demand(isinstance(run, list) and len(run) == 2 and all(type(frame) is int for frame in run))
        first, last = run
        _demand(before < first <= last <= _MAX_FRAME)
        runs.append((first, last))
        before = last
    return runs


def _is_name(name: object) -> bool:
    return isinstance(name, str) and 0 < len(name.encode()) <= _MAX_NAME_BYTES and "\0" not in name


def _demand(holds: bool) -> None:
    if not holds:
        raise ValueError(_NOT_AN_INDEX)
