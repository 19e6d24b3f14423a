"""What the command line says on the terminal; no bake depends on whether anybody can read it."""

from __future__ import annotations

import os
import sys
import time
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

_UNSHOWN = {"Cc", "Cs", "Zl", "Zp"}  # Unicode's control characters, halves of characters, separators of lines


class Terminal:
    """Progress and messages of one file: one line that renews itself on a terminal, few lines in a log."""

    _LOG_EVERY_S = 5.0

    def __init__(self, scene: Path, quiet: bool) -> None:
        self._scene, self._quiet = scene, quiet
        self._renews = _is_terminal(sys.stdout)
        self._last = time.perf_counter()

    def progress(self, job) -> None:
        if self._quiet or (not self._renews and time.perf_counter() - self._last < self._LOG_EVERY_S):
            return
        self._last = time.perf_counter()
        left = "" if job.remaining is None else f", {job.remaining:.0f} s left"
        text = f"{self._scene}: {job.progress:.0%}{left}"
        if self._renews:
            _write(sys.stdout, f"\r\x1b[K{shown(text)}")
        else:
            self.line(text)

    def frame(self, frame: int, report) -> None:
        """One frame of many is done."""
        full = f", everything since {report.full}" if report.full else ""
        self.line(
            f"{self._scene}: frame {frame}: {report.patches:,} of {report.all_patches:,} patches, "
            f"{report.rays:,} rays, {1e3 * report.seconds:.1f} ms{full}"
        )

    def end(self) -> None:
        if self._renews and not self._quiet:
            _write(sys.stdout, "\r\x1b[K")

    def line(self, text: str) -> None:
        if not self._quiet:
            _write(sys.stdout, shown(text) + "\n")


def complain(text: str) -> None:
    """Say on one line of stderr what is wrong."""
    _write(sys.stderr, f"obscurance: error: {shown(text)}\n")


def explain(text: str) -> None:
    """Say lines on stderr as they are."""
    _write(sys.stderr, text)


def shown(text: str) -> str:
    """A text with what would steer a terminal, or what it cannot show at all, as escapes."""
    return "".join(
        c if unicodedata.category(c) not in _UNSHOWN else c.encode("unicode_escape").decode("ascii") for c in text
    )


def flush() -> None:
    """Let out what Python holds back of its two streams."""
    for stream in (sys.stdout, sys.stderr):
        _write(stream, "")


@contextmanager
def blender_silent() -> Iterator[None]:
    """Keep Blender's own chatter about files off the terminal; errors come back as exceptions anyway."""
    flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is no standard output
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _write(stream: TextIO | None, text: str) -> None:
    """Write to a stream in its encoding, with escapes for what that lacks; one that fails is silent from then on."""
    if stream is None:  # it was closed when Python began
        return
    encoding = getattr(stream, "encoding", None) or "utf-8"
    try:
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        stream.flush()
    except (OSError, ValueError):  # nobody reads it any more, the disk of the log is full, it was closed
        _silence(stream)


def _silence(stream: TextIO) -> None:
    """Let a stream lead nowhere, so that what it still holds, and what C code writes there, finds a way out."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def _is_terminal(stream: TextIO | None) -> bool:
    try:
        return stream is not None and stream.isatty()
    except ValueError:  # it is closed
        return False
