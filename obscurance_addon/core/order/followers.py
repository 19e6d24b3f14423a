"""Who follows a scene that changes: this process while the caller waits, or a child process."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from typing import Protocol

import numpy as np

from ..errors import BackendError
from ..process import ChildEndedError, ChildProcess
from .child_runs import NO_CHILD, SERVER, ChildRun, RunWithFallback
from .following import Followed, Following, FollowOrder
from .monitor import JobMonitor
from .runs import Run
from .snapshot import Change

Objects = Mapping[Hashable, Change]
_LOOK_S = 0.5  # between looks whether a process that is waited for is alive
_PATIENCE_S = 60.0  # with an update that gives no sign of life, while Blender waits


class Follower(Protocol):
    """Bakes a scene and follows its changes."""

    def begin(self, order: FollowOrder, monitor: JobMonitor) -> Run:
        """Start the bake of the scene as it is; the run's result is a `Followed`."""
        ...

    def update(
        self, known: Mapping[Hashable, Change], changes: Mapping[Hashable, Change | None], rewrite: bool
    ) -> Followed:
        """As of `Following.update`, with all objects that there are now; waits for the result."""
        ...

    def values(self, key: Hashable) -> np.ndarray:
        """As of `Following.values`; waits for the result."""
        ...

    def end(self) -> None:
        """Let go of everything."""
        ...


class _Done:
    """A run that has ended."""

    progress, remaining = 1.0, 0.0

    def __init__(self, result: object, notes: list[str]) -> None:
        self.result, self.notes = result, notes

    def step(self, _seconds: float) -> bool:
        return True

    def cancel(self) -> None:
        """There is nothing to stop."""


class LocalFollower:
    """In this process, while the caller waits."""

    def __init__(self, *notes: str) -> None:
        self._notes = list(notes)
        self._following: Following | None = None

    def begin(self, order: FollowOrder, monitor: JobMonitor) -> Run:
        self._following = Following(order, monitor)
        return _Done(self._following.first(), self._notes)

    def update(
        self, known: Mapping[Hashable, Change], changes: Mapping[Hashable, Change | None], rewrite: bool
    ) -> Followed:
        return self._following.update(changes, rewrite)

    def values(self, key: Hashable) -> np.ndarray:
        return self._following.values(key)

    def end(self) -> None:
        self._following = None


class ChildFollower:
    """In a child process of its own, which keeps the scene; where it does not start, in this process."""

    def __init__(self) -> None:
        self._child = ChildProcess(SERVER)
        self._sent: set[int] = set()  # ids of parts that the child has; the channel keeps them alive
        self._instead: LocalFollower | None = None

    def begin(self, order: FollowOrder, monitor: JobMonitor) -> Run:
        if self._instead is not None:
            return self._instead.begin(order, monitor)

        def instead(_error: ChildEndedError) -> Run | None:
            if self._child.answered:
                return None
            self._child.end()
            self._instead = LocalFollower(NO_CHILD)
            return self._instead.begin(order, monitor)

        message = "follow", order, monitor.made_of
        try:
            return RunWithFallback(ChildRun(self._child, message, self._keep(order.objects)), instead)
        except ChildEndedError as error:
            run = instead(error)
            if run is None:
                raise
            return run

    def update(self, known: Objects, changes: Mapping[Hashable, Change | None], rewrite: bool) -> Followed:
        if self._instead is not None:
            return self._instead.update(known, changes, rewrite)
        new = any(id(part) not in self._sent for change in changes.values() if change for part in _parts(change))
        return self._ask(("update", dict(changes), rewrite), self._keep(known) if new else None)

    def values(self, key: Hashable) -> np.ndarray:
        if self._instead is not None:
            return self._instead.values(key)
        return self._ask(("values", key), None)

    def end(self) -> None:
        self._child.end()

    def _keep(self, known: Objects) -> list[object]:
        parts = [part for change in known.values() for part in _parts(change)]
        self._sent = {id(part) for part in parts}
        return parts

    def _ask(self, message: tuple, keep: list[object] | None) -> object:
        try:
            run = ChildRun(self._child, message, keep, _PATIENCE_S)
            while not run.step(_LOOK_S):
                continue
        except ChildEndedError as error:
            raise BackendError(
                f"the process that followed the scene has ended ({error}): switch Live Preview off and on again"
            ) from error
        return run.result


def make_follower(in_child: bool) -> Follower:
    """Where no child process starts, this process follows, and the notes of its run say so."""
    if not in_child:
        return LocalFollower()
    try:
        return ChildFollower()
    except ChildEndedError:
        return LocalFollower(NO_CHILD)


def _parts(change: Change) -> Iterator[object]:
    """What stays the same from one update to the next, and is large."""
    yield change.snapshot.mesh
    yield change.snapshot.surface
    yield from change.snapshot.shadings
    if change.baked is not None:
        yield change.baked.base
        yield change.baked.snapshot.mesh
        yield change.baked.snapshot.surface
