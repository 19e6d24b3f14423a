"""The bake from which Live Preview follows a scene, in a thread of its own."""

from __future__ import annotations

import threading

from ...core.light import Quantity
from ..jobs import JobMonitor
from .frame_update import FrameUpdater


class FirstBake:
    """The first bake of a `FrameUpdater`, whose result is not yet written."""

    def __init__(self, updater: FrameUpdater) -> None:
        self.updater = updater
        self._monitor = JobMonitor(Quantity.OBSCURANCE)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="obscurance-preview", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.updater.compute(self._monitor)
        except BaseException as error:  # handed to the main thread
            self._error = error

    @property
    def progress(self) -> float:
        """Share of the work done, 0 .. 1."""
        return self._monitor.progress

    def is_alive(self) -> bool:
        """Whether it still computes."""
        return self._thread.is_alive()

    def cancel(self, wait: bool = True) -> None:
        """Stop it, and wait for it to end or not."""
        self._monitor.cancelled.set()
        if wait:
            self._thread.join()

    def check(self) -> None:
        """Raise what stopped the bake."""
        if self._error is not None:
            raise self._error
