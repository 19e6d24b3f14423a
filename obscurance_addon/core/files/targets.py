"""Whether a path can be written to, as far as one can tell before; and whether two paths are one file."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from pathlib import Path

from ..errors import ObscuranceError

_MAX_PATH_BYTES = 1000  # Blender cuts off what is longer
_ANY_WRITE_BIT = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
_KINDS = {
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}
_REASONS = {
    errno.ELOOP: "links lead in a circle: remove one of them, or choose another name",
    errno.ENAMETOOLONG: "the name is too long for the disk: choose a shorter one",
}


class TargetError(ObscuranceError):
    """Something cannot be written where it should go; the message names the path and the cure."""


def check_target(path: str | Path, needs_room: bool = True) -> None:
    """Make sure that a file can be written, or replaced, as far as one can tell before.

    Parameters
    ----------
    path : str or Path
        A link stands for what it leads to.
    needs_room : bool
        Whether anything is still to be written, beside what is there.

    Raises
    ------
    TargetError
        When it is a folder, a device, a pipe or a socket, is write-protected, has a name that is too long, or lies in a
        folder that is missing, write-protected or on a full disk.
    """
    found = _status(path)
    if found is not None and stat.S_ISDIR(found.st_mode):
        raise TargetError(f"'{path}' is a folder: name a file in it")
    _check_folder_of(path, needs_room)
    if found is None:
        return
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no file")
        raise TargetError(f"'{path}' is {kind}, which must not be replaced: name a file")
    if not found.st_mode & _ANY_WRITE_BIT or not os.access(path, os.W_OK):
        raise TargetError(f"'{path}' is write-protected: change its permissions or choose another name")


def check_folder_target(path: str | Path) -> None:
    """As `check_target`, for a folder that can be made or replaced; what it holds is not looked at."""
    found = _status(path)
    if found is not None and not stat.S_ISDIR(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "a file")
        raise TargetError(f"'{path}' is {kind}: name a folder, or a new one")
    _check_folder_of(path, True)
    if found is not None and not (found.st_mode & _ANY_WRITE_BIT and os.access(path, os.W_OK)):
        raise TargetError(f"the folder '{path}' cannot be written to: change its permissions or choose another")


def is_stream(path: str | Path) -> bool:
    """Whether a path is a device or a pipe, which can be written into but never replaced."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return False
    own = os.path.abspath(path).startswith(("/dev/", "/proc/"))  # /dev/stdout, also where it leads to a file
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or (own and not stat.S_ISDIR(mode))


def identities(path: str | Path) -> set[object]:
    """What two paths share if they are one file: the place that links lead to, and the file itself if there is one."""
    found: set[object] = {os.path.normcase(os.path.realpath(path))}
    try:
        status = os.stat(path)
    except OSError:
        return found
    return found | {(status.st_dev, status.st_ino)} if status.st_ino else found


def _status(path: str | Path) -> os.stat_result | None:
    """Of what is there; None where nothing is."""
    if len(os.fsencode(os.path.abspath(path))) > _MAX_PATH_BYTES:
        raise TargetError(f"'{path}' is too long for Blender: choose a shorter path")
    try:
        return os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except PermissionError:
        raise TargetError(
            f"'{path}' cannot be reached: change the permissions of its folder or choose another"
        ) from None
    except OSError as error:
        reason = _REASONS.get(error.errno, f"{error.strerror}: choose another name")
        raise TargetError(f"'{path}' cannot be used, {reason}") from None


def _check_folder_of(path: str | Path, needs_room: bool) -> None:
    """The folder that a file or folder would be made in."""
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):
        link = f"the link '{path}' leads nowhere: " if os.path.islink(path) else ""
        shown = folder if link else os.path.dirname(path) or folder
        raise TargetError(f"{link}the folder '{shown}' does not exist: create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise TargetError(f"the folder '{folder}' cannot be written to: change its permissions or choose another")
    room = shutil.disk_usage(folder)
    if needs_room and room.total and not room.free:
        raise TargetError(f"the disk of the folder '{folder}' is full: make room on it, or choose another")
