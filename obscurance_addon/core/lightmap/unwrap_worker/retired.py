"""Atlases that are done with, kept until their threads sleep.

When xatlas 0.0.11 frees an atlas it wakes that atlas's threads without their lock and waits for them to end. A thread
that is just about to sleep misses the call, and the process hangs for good; so each gets a while to fall asleep first.
"""

from __future__ import annotations

import time
from collections import deque

REST = 0.1  # seconds; falling asleep takes a microsecond, or some milliseconds when other processes have the cores

_retired: deque[tuple[float, object]] = deque()


def retire(atlas: object) -> None:
    """Keep an atlas that has nothing more to compute for REST seconds at least; frees those that have rested."""
    now = time.monotonic()
    _retired.append((now, atlas))
    while _retired[0][0] < now - REST:
        _retired.popleft()
