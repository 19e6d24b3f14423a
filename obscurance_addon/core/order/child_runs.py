"""Carries an order out in a child process, or by turns where none starts."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from ..errors import BackendError
from ..process import ChildEndedError, ChildProcess
from .monitor import JobMonitor
from .runs import Order, Run, TurnRun

SERVER = "order.server"  # module of the core that child processes run
NO_CHILD = "bakes run in Blender's own process, because a process of their own does not start"
PATIENCE_S = 300.0  # without a sign of life; a scene of ten million triangles takes a minute to build
_LONGEST_LOOK_S = 1.0  # that counts as silence: the machine may have slept, or Blender been busy

_log = logging.getLogger(__name__)


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
    patience : float
        Seconds without a sign of life after which the child counts as ended.
    """

    def __init__(
        self, child: ChildProcess, message: tuple, keep: list | None = None, patience: float = PATIENCE_S
    ) -> None:
        self.result: object = None
        self.notes: list[str] = []
        self.is_over = False
        self.child = child
        self._beats, self._silence, self._looked = 0.0, 0.0, time.monotonic()
        self._patience = patience
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
        beats, now = self.child.page.read()[0], time.monotonic()
        self._silence += min(now - self._looked, _LONGEST_LOOK_S)
        self._looked = now
        if beats != self._beats:
            self._beats, self._silence = beats, 0.0
        elif self._silence > self._patience:
            raise ChildEndedError(f"it gave no sign of life for {self._patience:.0f} s")

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
        while not self._cannot_start:
            try:
                return self._start(order, monitor, intersector, ceiling_bytes)
            except ChildEndedError as error:  # a kept one may have ended meanwhile: another is started
                is_new = self._child is None or not self._child.answered
                self.end()
                if is_new:
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
        self._last = None
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
