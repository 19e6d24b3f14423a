"""Carries an order out in this process: while the caller waits, or by turns; `child_runs` does so in a child process.

run = start(order)
while not run.step(0.1):
    show(run.progress, run.remaining)
run.result
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from typing import Protocol

from ..monitor import Monitor
from .monitor import JobMonitor

_TURN_S = 0.03  # a turn of work at least


class Order(Protocol):
    """What can be carried out: `BakeOrder`, or the start of a `Following`."""

    def carry_out(self, monitor: Monitor, intersector: Callable) -> object:
        """As of `BakeOrder`."""
        ...


class Run(Protocol):
    """An order that is being carried out.

    Attributes
    ----------
    result : object
        What came of it, once `step` returned True.
    notes : list of str
        What the user should know of how it was carried out.
    """

    result: object
    notes: list[str]

    @property
    def progress(self) -> float:
        """Share of the work done, 0 .. 1."""
        ...

    @property
    def remaining(self) -> float | None:
        """Estimated seconds left, None while there is nothing to estimate from."""
        ...

    def step(self, seconds: float) -> bool:
        """Wait so long at most; True once there is a result. Raises what stopped it."""
        ...

    def cancel(self) -> None:
        """Stop it; no thread of it is left then."""
        ...


class ThreadRun:
    """Carried out in this process, for callers that do nothing but wait: a thread computes, so that they hear of it.

    Parameters
    ----------
    order : Order
    monitor : JobMonitor
    intersector : callable
        Builds the ray tracer.
    """

    def __init__(self, order: Order, monitor: JobMonitor, intersector: Callable) -> None:
        self.result: object = None
        self.notes: list[str] = []
        self._order, self._monitor, self._intersector = order, monitor, intersector
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._compute, name="obscurance-bake", daemon=True)
        self._thread.start()

    def _compute(self) -> None:
        try:
            self.result = self._order.carry_out(self._monitor, self._intersector)
        except BaseException as error:  # handed to the thread that steps
            self._error = error

    @property
    def progress(self) -> float:
        return 1.0 if self.result is not None else self._monitor.progress

    @property
    def remaining(self) -> float | None:
        return self._monitor.remaining

    def step(self, seconds: float) -> bool:
        self._thread.join(seconds)
        return self._is_done()

    def _is_done(self) -> bool:
        if self._thread.is_alive():
            return False
        if self._error is not None:
            raise self._error
        return True

    def cancel(self) -> None:
        self._monitor.cancelled.set()
        self._thread.join()


class _TurnMonitor(JobMonitor):
    """Lets the bake go on only during turns."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)
        self.go, self.waits = threading.Event(), threading.Event()
        self.until = 0.0

    def check(self) -> None:
        if time.perf_counter() > self.until and not self.cancelled.is_set():
            self.waits.set()
            self.go.wait()
            self.go.clear()
        super().check()


class TurnRun(ThreadRun):
    """Carried out in this process by turns: the bake's one thread computes only while `step` waits for it.

    For windows where no child process starts. The result is that of any number of threads.
    """

    def __init__(self, order: Order, monitor: JobMonitor, intersector: Callable, *notes: str) -> None:
        turns = _TurnMonitor(*monitor.made_of)
        settings = dataclasses.replace(order.settings, threads=1)
        super().__init__(dataclasses.replace(order, settings=settings), turns, intersector)
        turns.waits.wait()
        self.notes += notes

    def _compute(self) -> None:
        self._monitor.waits.set()
        self._monitor.go.wait()
        self._monitor.go.clear()
        super()._compute()

    def step(self, seconds: float) -> bool:
        turns: _TurnMonitor = self._monitor
        turns.waits.clear()
        turns.until = time.perf_counter() + max(seconds, _TURN_S)
        turns.go.set()
        while self._thread.is_alive() and not turns.waits.wait(0.005):
            continue
        return self._is_done()

    def cancel(self) -> None:
        self._monitor.cancelled.set()
        self._monitor.go.set()
        self._thread.join()
