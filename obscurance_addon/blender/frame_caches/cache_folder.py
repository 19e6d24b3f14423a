"""The folder of a frame cache: an index, and below it a folder with the files of the generation that the index names.

A bake writes a generation of its own; then it replaces the index, which is one file, so that a kill leaves the old
cache or the new one; then it removes the old generation. What killed bakes left is removed by the next one. Nothing is
ever removed that is not named as such a bake names it.

    index.json, obscurance.lock, frames-3f2a9c1b07d4/frame_000001.npz...

In version 1 files of frames lay beside the index.
"""

from __future__ import annotations

import errno
import os
import uuid
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

from ...core.files import TargetError, check_folder_target
from . import frame_file
from .cache_index import NAME, CacheIndex, FrameCacheError, is_generation

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
    import msvcrt

_LOCK, _PART = "obscurance.lock", f"{NAME}.part"
UNREADABLE = (OSError, ValueError, TypeError, KeyError, ArithmeticError, RecursionError)  # what a broken file may raise


class CacheFolder:
    """The folder of a cache that is being written; one bake has it at a time.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    generation : Path
        The folder for the files of frames, empty.

    Raises
    ------
    FrameCacheError
        When it holds anything that is not of a frame cache, cannot be made, or another bake writes it.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._is_ours = path, False
        self._undo = ExitStack()
        try:
            self._index = check_folder(path)
            if not path.exists():
                path.mkdir()
                self._undo.callback(_remove_if_empty, path)
            self._lock = open(path / _LOCK, "ab")  # noqa: SIM115 - closed by `leave`
            self._undo.callback(self._unlock)
            if not _is_locked(self._lock):
                raise FrameCacheError(
                    f"another bake is writing the frame cache '{path}': wait until it ends, or choose another folder"
                )
            self._is_ours = True
            self._index = check_folder(path)  # no other bake replaces it from now on
            _sweep(path, self._index)
            self.generation = path / f"frames-{uuid.uuid4().hex[:12]}"
            self.generation.mkdir()
        except OSError as error:
            self._undo.close()
            raise cannot_write(path, error) from None
        except FrameCacheError:
            self._undo.close()
            raise

    def former_files(self) -> frozenset[str]:
        """Names of files beside the index that are of no use once there is another index."""
        named = self._index.files_beside() if self._index else set()
        return frozenset(name for name in named if (self.path / name).is_file())

    def replace_index(self, index: CacheIndex, settings: dict) -> None:
        """Write the index, which names a generation that is there; raises OSError."""
        part = self.path / _PART
        with open(part, "w", encoding="utf-8", newline="\n") as file:
            file.write(index.text(settings))
            file.flush()
            os.fsync(file.fileno())
        part.replace(self.path / NAME)
        self._index = index

    def leave(self) -> None:
        """Remove what no index names, and let others write here; harmless when repeated."""
        with suppress(OSError):  # then the next bake removes it
            if self._is_ours:
                _sweep(self.path, self._index)
        self._undo.close()

    def _unlock(self) -> None:
        self._lock.close()
        if self._is_ours and self._index is None:
            with suppress(OSError):
                (self.path / _LOCK).unlink()
        self._is_ours = False


def cannot_write(folder: Path, error: OSError) -> FrameCacheError:
    """The error that a cache cannot be written, with the reason that the system gives."""
    cure = "make room there" if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG} else "check its place"
    return FrameCacheError(
        f"the frame cache '{folder}' cannot be written ({error.strerror or error}): {cure}, or choose another folder"
    )


def check_folder(folder: Path) -> CacheIndex | None:
    """Make sure that a cache can be written to a folder; the index of the cache that is there.

    Raises
    ------
    FrameCacheError
        When it holds anything that is not of a frame cache, or cannot be made or written to,
    OSError
        or looked at.
    """
    try:
        check_folder_target(folder)
    except TargetError as error:
        raise FrameCacheError(str(error)) from None
    if folder.is_symlink() and not folder.exists():
        raise FrameCacheError(f"'{folder}' is a link to nothing: remove it, or choose another folder")
    if not folder.is_dir():
        return None
    index = _index(folder)
    own = {_LOCK, _PART} | ({NAME} | index.files_beside() if index else set())
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        if is_generation(entry.name) and entry.is_dir(follow_symlinks=False):
            others = [f"{entry.name}/{name}" for name in os.listdir(entry) if not frame_file.is_name(name)]
        else:
            others = [] if entry.name in own and entry.is_file(follow_symlinks=False) else [entry.name]
        if others:
            raise FrameCacheError(
                f"'{folder}' holds '{others[0]}', which is not of a frame cache: choose another folder"
            )
    return index


def _index(folder: Path) -> CacheIndex | None:
    """The index of a folder; None where there is none, or none that can be read."""
    try:
        return CacheIndex.read(folder)
    except UNREADABLE:
        return None


def _sweep(folder: Path, index: CacheIndex | None) -> None:
    """Remove from a folder what is of a frame cache, but not of the one of its index."""
    unnamed = {_PART} | (set(index.former) if index else set())
    for entry in list(os.scandir(folder)):
        if entry.name in unnamed:
            os.unlink(entry)
        elif is_generation(entry.name) and not (index and entry.name == index.generation):
            _remove_generation(entry)


def _remove_generation(entry: os.DirEntry) -> None:
    if entry.is_dir(follow_symlinks=False):
        for name in filter(frame_file.is_name, os.listdir(entry)):
            os.unlink(os.path.join(entry, name))
        _remove_if_empty(Path(entry))


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _is_locked(file: BinaryIO) -> bool:
    """Lock a file for as long as it is open, or this process lives; False where another one has done so."""
    try:
        if fcntl is None:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # others: a file system that knows no locks
        return error.errno not in {errno.EAGAIN, errno.EACCES, errno.EDEADLK}
    return True
