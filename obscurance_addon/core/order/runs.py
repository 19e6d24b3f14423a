"""Who carries an order out: this process while the caller waits, a child process, or this process by turns.

run = start(order)
while not run.step(0.1):
    show(run.progress, run.remaining)
run.result
"""

from __future__ import annotations

import dataclasses
import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

from ..errors import BackendError
from ..monitor import Monitor
from ..process import ChildEndedError, ChildProcess
from .monitor import JobMonitor

SERVER = "order.server"  # module of the core that child processes run
NO_CHILD = "bakes run in Blender's own process, because a process of their own does not start"
_TURN_S = 0.03  # a turn of work at least
_PATIENCE_S = 300.0  # without a sign of life; a scene of ten million triangles takes a minute to build

_log = logging.getLogger(__name__)


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


class ChildRun:
    """Carried out in a child process, which this one never waits for but in `step`.

    Parameters
    ----------
    child : ChildProcess
        Of `SERVER`, without work.
    message : tuple
        What it is to do, as `server` understands it.
    keep : list, optional
        As of `ChildProcess.send`.
    """

    def __init__(self, child: ChildProcess, message: tuple, keep: list | None = None) -> None:
        self.result: object = None
        self.notes: list[str] = []
        self.is_over = False
        self.child = child
        self._beats, self._heard = 0.0, time.monotonic()
        child.send(message, keep)

    @property
    def progress(self) -> float:
        return 1.0 if self.result is not None else self.child.page.read()[1]

    @property
    def remaining(self) -> float | None:
        return self.child.page.read()[2]

    def step(self, seconds: float) -> bool:
        if self.result is not None:
            return True
        if not self.child.poll(seconds):
            self._mind_silence()
            return False
        word, answer = self.child.receive()
        if word == "ready":
            return False
        self.is_over = True
        if word == "error":
            raise answer
        if word == "bug":
            raise BackendError(f"the bake failed; please report this: {answer}")
        self.result = answer
        return True

    def _mind_silence(self) -> None:
        beats = self.child.page.read()[0]
        if beats != self._beats:
            self._beats, self._heard = beats, time.monotonic()
        elif time.monotonic() - self._heard > _PATIENCE_S:
            raise ChildEndedError(f"it gave no sign of life for {_PATIENCE_S:.0f} s")

    def cancel(self) -> None:
        """Stop it at once, by ending the process; the next bake starts another."""
        if not self.is_over:
            self.child.end()


class KeptChild:
    """A child process that is kept from one bake to the next, with its ray tracer.

    Where none can be started, `run` lets this process do the work by turns.
    """

    def __init__(self) -> None:
        self._child: ChildProcess | None = None
        self._last: ChildRun | None = None
        self._cannot_start = self._is_told = False

    def run(self, order: Order, monitor: JobMonitor, intersector: Callable, ceiling_bytes: int) -> Run:
        """Start an order. One that is not finished is stopped.

        Parameters
        ----------
        order : Order
        monitor : JobMonitor
            Tells the phases; hears of nothing else where a child does the work.
        intersector : callable
            For work in this process.
        ceiling_bytes : int
            What the child may keep of its ray tracer.
        """
        if self._last is not None and not self._last.is_over:
            self.end()
        if not self._cannot_start:
            try:
                return self._start(order, monitor, intersector, ceiling_bytes)
            except ChildEndedError as error:
                self._gave_up(error)
        return self._by_turns(order, monitor, intersector)

    def _by_turns(self, order: Order, monitor: JobMonitor, intersector: Callable) -> Run:
        notes = () if self._is_told else (NO_CHILD,)
        self._is_told = True
        return TurnRun(order, monitor, intersector, *notes)

    def _start(self, order: Order, monitor: JobMonitor, intersector: Callable, ceiling_bytes: int) -> Run:
        if self._child is None or not self._child.is_alive():
            self.end()
            self._child = ChildProcess(SERVER)
        self._last = ChildRun(self._child, ("carry_out", order, monitor.made_of, ceiling_bytes))
        return RunWithFallback(self._last, lambda error: self._instead(error, order, monitor, intersector))

    def _instead(self, error: ChildEndedError, order: Order, monitor: JobMonitor, intersector: Callable) -> Run | None:
        """Another run, where the child did not even begin; None where it ended at work."""
        began = self._child is None or self._child.answered
        self.end()
        if began:
            return None
        self._gave_up(error)
        return self._by_turns(order, monitor, intersector)

    def _gave_up(self, error: ChildEndedError) -> None:
        self._cannot_start = True
        _log.warning("no process for bakes: %s", error)

    def forget(self) -> None:
        """Let go of the ray tracer, unless a bake is under way."""
        if self._last is not None and self._last.is_over:
            try:
                self._child.send(("forget",))
            except ChildEndedError:
                self.end()

    def end(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.end()
        self._child = self._last = None


class RunWithFallback:
    """A run in a child process, which another run replaces if the process does not start."""

    def __init__(self, run: ChildRun, instead: Callable[[ChildEndedError], Run | None]) -> None:
        self._run: Run = run
        self._instead = instead

    @property
    def result(self) -> object:
        return self._run.result

    @property
    def notes(self) -> list[str]:
        return self._run.notes

    @property
    def progress(self) -> float:
        return self._run.progress

    @property
    def remaining(self) -> float | None:
        return self._run.remaining

    def step(self, seconds: float) -> bool:
        try:
            return self._run.step(seconds)
        except ChildEndedError as error:
            other = self._instead(error)
            if other is None:
                raise BackendError(
                    f"the process that baked has ended ({error}); nothing was changed. Bake again, with fewer rays or "
                    "objects if memory ran out"
                ) from error
            self._run = other
            return False

    def cancel(self) -> None:
        self._run.cancel()
