"""What the command line says on the terminal."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Terminal:
    """Progress and messages of one file: one line that renews itself on a terminal, few lines in a log."""

    _LOG_EVERY_S = 5.0

    def __init__(self, scene: Path, quiet: bool) -> None:
        self._scene, self._quiet = scene, quiet
        self._renews = sys.stdout.isatty()
        self._last = time.perf_counter()

    def progress(self, job) -> None:
        if self._quiet or (not self._renews and time.perf_counter() - self._last < self._LOG_EVERY_S):
            return
        self._last = time.perf_counter()
        left = "" if job.remaining is None else f", {job.remaining:.0f} s left"
        text = f"{self._scene}: {job.progress:.0%}{left}"
        print(f"\r\x1b[K{text}" if self._renews else text, end="" if self._renews else "\n", flush=True)

    def frame(self, frame: int, report) -> None:
        """One frame of many is done."""
        full = f", everything since {report.full}" if report.full else ""
        self.line(
            f"{self._scene}: frame {frame}: {report.patches:,} of {report.all_patches:,} patches, "
            f"{report.rays:,} rays, {1e3 * report.seconds:.1f} ms{full}"
        )

    def end(self) -> None:
        if self._renews and not self._quiet:
            print("\r\x1b[K", end="", flush=True)

    def line(self, text: str) -> None:
        if not self._quiet:
            print(text, flush=True)


def complain(text: str) -> None:
    print(f"obscurance: error: {text}", file=sys.stderr, flush=True)


@contextmanager
def blender_silent() -> Iterator[None]:
    """Keep Blender's own chatter about files off the terminal; errors come back as exceptions anyway."""
    sys.stdout.flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
