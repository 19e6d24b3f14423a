"""How a file takes the place of another: written beside it, checked, then renamed.

A kill at any moment leaves the old file or the new one, whole. What it leaves besides has names that begin with those
of a lock file; the next run that writes to the folder finds that nobody holds the lock, and removes it.
"""

from __future__ import annotations

import os
import shutil
import uuid
import weakref
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager, suppress
from pathlib import Path

from .locks import abandoned, locked
from .targets import TargetError, check_target

_PREFIX, _LOCK = ".obscurance-", ".lock"
_open: weakref.WeakSet[Parts] = weakref.WeakSet()


class Parts:
    """Names in a folder for files and folders that will replace others; what still has one at the end is removed.

    Parameters
    ----------
    folder : str or Path
        On the disk of what is to be replaced.

    Raises
    ------
    OSError
        When the folder cannot be written to.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder, self._made = Path(folder), 0
        self._kept: set[Path] = set()
        _sweep(self._folder)
        self._stem = f"{_PREFIX}{uuid.uuid4().hex[:12]}"
        self._lock = locked(self._folder / (self._stem + _LOCK))
        _open.add(self)

    def __enter__(self) -> Parts:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def new(self, suffix: str, kind: str = ".part") -> Path:
        """A path that nobody else uses; writers may add to its name."""
        self._made += 1
        return self._folder / f"{self._stem}.{self._made}{kind}{suffix}"

    def keep(self, path: Path) -> None:
        """Let a file stay at the end."""
        self._kept.add(path)

    def close(self) -> None:
        """Remove what is left; harmless to repeat."""
        _open.discard(self)
        _remove(self._folder, self._stem, self._kept)
        if self._lock is not None:
            self._lock.close()


def let_go_of_all() -> None:
    """Remove what is half-written, for a process that ends at once."""
    for parts in list(_open):
        parts.close()


@contextmanager
def written_whole(target: str | Path, check: Callable[[Path], None]) -> Iterator[Path]:
    """A path beside a file, to write to: at the end of the body it is checked, and takes the file's place.

    Parameters
    ----------
    target : str or Path
        A link stays a link: the file behind it is replaced, and keeps its permissions.
    check : callable
        Raises when what was written is not whole; see `CHECKS`.

    Raises
    ------
    TargetError
        When the target is nothing that may be replaced, or cannot be written; an OSError of the body becomes this.
    """
    place = Path(os.path.realpath(target))
    try:
        with Parts(place.parent) as parts:
            part = parts.new(place.suffix)
            yield part
            finished(part, check)
            _put(part, place)
    except OSError as error:
        raise TargetError(
            f"'{target}' could not be written ({error.strerror or error}): make room on the disk, or choose another "
            "folder"
        ) from error


def finished(part: str | Path, check: Callable[[Path], None]) -> None:
    """Make sure that a file is on the disk, and whole; raises OSError."""
    with open(part, "rb+") as written:
        os.fsync(written.fileno())
    check(Path(part))


@contextmanager
def replaced(files: Sequence[tuple[str, str]], parts: Parts | None) -> Iterator[None]:
    """Put finished part files in the place of others for good, or, when the body fails, only until then.

    Parameters
    ----------
    files : sequence of (str, str)
        Part and target, without links.
    parts : Parts, optional
        That the part files are of; None where there are no files.
    """
    aside: list[tuple[Path | None, str]] = []  # the old file under another name, if there was one, and the target
    try:
        for part, target in files:
            old = _set_aside(target, parts)
            aside.append((old, target))
            _put(part, target)
        yield
    except BaseException:
        for old, target in aside:
            _restore(old, target, parts)
        raise


def _put(part: str | Path, target: str | Path) -> None:
    """Rename a finished part to its target; the one place where something of the user's is replaced."""
    check_target(target, needs_room=False)  # once more: the bake took its time
    if os.path.exists(target):
        shutil.copymode(target, part)
    os.replace(part, target)


def _set_aside(target: str, parts: Parts) -> Path | None:
    """Give an existing file a second name, and return that."""
    if not os.path.lexists(target):
        return None
    old = parts.new("", ".old")
    try:
        os.link(target, old)
    except OSError:  # the file system has no links
        shutil.copy2(target, old)
    return old


def _restore(old: Path | None, target: str, parts: Parts) -> None:
    """Undo the replacement of a file, if there has been one; where this fails the old file stays beside it."""
    try:
        if old is None:
            os.unlink(target)
        else:
            os.replace(old, target)  # if the two are one file still, both names stay
    except OSError:
        if old is not None:
            parts.keep(old)


def _sweep(folder: Path) -> None:
    """Remove what killed runs left in a folder."""
    with suppress(OSError):
        for path in list(folder.glob(f"{_PREFIX}*{_LOCK}")):
            lock = abandoned(path)
            if lock is not None:
                with lock:
                    _remove(folder, path.name.removesuffix(_LOCK))


def _remove(folder: Path, stem: str, kept: Set[Path] = frozenset()) -> None:
    """Remove all that has a name of these parts, the lock at the end."""
    lock = folder / (stem + _LOCK)
    for path in [*(set(folder.glob(f"{stem}.*")) - kept - {lock}), lock]:
        with suppress(OSError):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
