"""A few numbers that two processes share, so that telling how far a bake is never waits for anyone."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

_NUMBERS = struct.Struct("=ddd")


class ProgressPage:
    """A mapped file that one process writes and the other reads.

    Parameters
    ----------
    folder : Path
        The private folder of both.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / "progress"
        if not path.exists():
            path.write_bytes(bytes(mmap.PAGESIZE))
        with open(path, "r+b") as file:
            self._memory = mmap.mmap(file.fileno(), 0)
        self._beats = 0.0
        self._read: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def write(self, progress: float, remaining: float | None) -> None:
        """Tell the share that is done, 0 .. 1, and the seconds left, if known; also that this process is alive."""
        self._beats += 1.0
        _NUMBERS.pack_into(self._memory, 0, self._beats, progress, -1.0 if remaining is None else remaining)

    def read(self) -> tuple[float, float, float | None]:
        """A number that grows while the other process is alive, the share that is done, and the seconds left.

        After `close`, what was read last.
        """
        if not self._memory.closed:
            self._read = _NUMBERS.unpack_from(self._memory)
        beats, progress, remaining = self._read
        return beats, progress, None if remaining < 0.0 else remaining

    def close(self) -> None:
        """Let go of the file."""
        self._memory.close()
