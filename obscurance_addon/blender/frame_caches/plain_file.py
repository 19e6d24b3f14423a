"""Opens files whose names come from elsewhere, as those of a frame cache that was given away."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A plain file, to be read; never a device or a pipe, which may have no end and may wait for ever.

    Raises
    ------
    OSError, ValueError
        When there is none.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):  # opening a device may be an act already
        raise ValueError("something in it is no plain file")
    with open(path, "rb", opener=_opened_at_once) as file:
        yield file


def exactly(file: BinaryIO, count: int) -> bytes:
    """The next `count` bytes; raises ValueError where the file ends before."""
    data = file.read(count)
    if len(data) < count:
        raise ValueError("a file is cut off")
    return data


def _opened_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
