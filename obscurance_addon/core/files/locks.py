"""Files that a process keeps locked while it lives, by which others know that it does.

They hold the name of the machine, because some network drives do not tell one machine of the locks of another.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows: there nobody knows, and what kills leave stays
    fcntl = None


def locked(path: str | Path) -> IO | None:
    """Make a file and lock it until it is closed; None, and no file, where the system has no locks.

    Raises
    ------
    OSError
        The file cannot be made.
    """
    if fcntl is None:
        return None
    while True:
        file = open(path, "ab", buffering=0)  # noqa: SIM115 - open for as long as the lock is to last
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
            if os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                file.write(_machine())
                return file
        except FileNotFoundError:
            pass  # somebody took it for abandoned between the two calls: once more
        except OSError:  # a file system without locks
            file.close()
            os.unlink(path)
            return None
        file.close()


def abandoned(path: str | Path) -> IO | None:
    """The lock file of a process that has ended, locked by this one now; None where the owner may be alive."""
    if fcntl is None:
        return None
    try:
        file = open(path, "r+b")  # noqa: SIM115
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if file.read() == _machine():
            return file
    except OSError:
        pass
    file.close()
    return None


def _machine() -> bytes:
    return platform.node().encode()
