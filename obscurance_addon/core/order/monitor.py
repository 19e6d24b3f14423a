"""How far a bake is, and how it is told to stop."""

from __future__ import annotations

import threading
import time
from typing import ClassVar

import numpy as np

from ..errors import BakeCancelledError
from ..light import Quantity
from ..monitor import Monitor

# What the core does for each quantity, in order.
_PHASES = {
    Quantity.OBSCURANCE: ("build", "trace"),
    Quantity.DIRECT: ("build", "light"),
    Quantity.AMBIENT: ("build", "trace", "light", "redistribute"),
    Quantity.COMBINED: ("build", "trace", "light", "redistribute"),
    Quantity.RADIOSITY: ("build", "light", "radiosity"),
}
_LIGHTMAP_PHASES = {
    Quantity.OBSCURANCE: ("build", "trace"),
    Quantity.DIRECT: ("build", "light", "trace"),
    Quantity.AMBIENT: ("build", "light", "redistribute", "trace"),
    Quantity.COMBINED: ("build", "light", "redistribute", "trace"),
    Quantity.RADIOSITY: ("build", "light", "radiosity", "trace"),
}


class JobMonitor(Monitor):
    """Progress and cancellation, shared by the job's threads.

    Parameters
    ----------
    quantity : Quantity
        What is baked, which tells the phases to come.
    is_lightmap : bool
    """

    # Of the progress bar, relative to each other: building takes about a tenth of a bake at 64 rays.
    _SHARES: ClassVar = {"unwrap": 0.3, "build": 0.1, "trace": 0.9, "light": 1.5, "redistribute": 0.6, "radiosity": 1.5}

    def __init__(self, quantity: Quantity, is_lightmap: bool = False) -> None:
        self.made_of = quantity, is_lightmap  # what another one for the same bake is made of
        self.cancelled = threading.Event()
        self._lock = threading.Lock()
        self._phases = ("unwrap", *_LIGHTMAP_PHASES[quantity]) if is_lightmap else _PHASES[quantity]
        self._low, self._high = 0.0, 1.0
        self._total, self._done, self._since = 1, 0, time.perf_counter()

    def check(self) -> None:
        """Raise BakeCancelledError once the user has cancelled."""
        if self.cancelled.is_set():
            raise BakeCancelledError("cancelled")

    def phase(self, name: str, total: int) -> None:
        self.check()
        with self._lock:
            ends = np.cumsum([self._SHARES[phase] for phase in self._phases])
            ends /= ends[-1]
            at = self._phases.index(name)
            self._low, self._high = (float(ends[at - 1]) if at else 0.0), float(ends[at])
            self._total, self._done, self._since = max(total, 1), 0, time.perf_counter()

    def advance(self, amount: int) -> None:
        self.check()
        with self._lock:
            self._done += amount

    @property
    def progress(self) -> float:
        """Share of the work done, 0 .. 1."""
        return self._place()[0]

    def _place(self) -> tuple[float, float, float]:
        """Progress, where the phase under way began, and when."""
        with self._lock:
            share = min(self._done / self._total, 1.0)
            return self._low + (self._high - self._low) * share, self._low, self._since

    @property
    def remaining(self) -> float | None:
        """Estimated seconds left, from the pace of the phase under way; None while it says nothing."""
        progress, low, since = self._place()
        if low == 0.0 or progress == low:
            return None
        return (time.perf_counter() - since) / (progress - low) * (1.0 - progress)
