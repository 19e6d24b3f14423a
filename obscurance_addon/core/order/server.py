"""What a child process does: carries out orders, one after the other, or follows a scene that changes."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path

import numpy as np

from ..errors import BackendError, ObscuranceError
from ..process import Channel, ProgressPage
from ..tracing import IntersectorCache
from .bake_order import BakeOrder, BakeResult
from .following import Followed, Following, FollowOrder
from .monitor import JobMonitor
from .snapshot import Change


class _PageMonitor(JobMonitor):
    """Tells the parent how far it is."""

    def __init__(self, page: ProgressPage, *made_of: object) -> None:
        super().__init__(*made_of)
        self._page = page

    def phase(self, name: str, total: int) -> None:
        super().phase(name, total)
        self._tell()

    def advance(self, amount: int) -> None:
        super().advance(amount)
        self._tell()

    def _tell(self) -> None:
        self._page.write(self.progress, self.remaining)


class _Server:
    """Does what messages say; the names of its methods are their first words."""

    def __init__(self, page: ProgressPage) -> None:
        self._page = page
        self._tracers = IntersectorCache()
        self._following: Following | None = None
        self._made_of: tuple = ()

    def carry_out(self, order: BakeOrder, made_of: tuple, ceiling_bytes: int) -> BakeResult:
        self._tracers.ceiling_bytes = ceiling_bytes
        return order.carry_out(self._monitor(made_of), self._tracers)

    def forget(self) -> None:
        self._tracers.clear()

    def follow(self, order: FollowOrder, made_of: tuple) -> Followed:
        self._following = None  # before another takes its memory
        self._made_of = made_of
        self._following = Following(order, self._monitor(made_of))
        return self._following.first()

    def update(self, changes: Mapping[Hashable, Change | None], rewrite: bool) -> Followed:
        return self._following.update(changes, rewrite, self._monitor(self._made_of))

    def values(self, key: Hashable) -> np.ndarray:
        return self._following.values(key)

    def _monitor(self, made_of: tuple) -> _PageMonitor:
        self._page.write(0.0, None)
        return _PageMonitor(self._page, *made_of)


def serve(channel: Channel, folder: Path) -> None:
    """Answer messages until the parent has gone: with 'done', 'error' or 'bug', and what came of it.

    Once at the beginning 'ready' tells that everything was found.
    """
    channel.send(("ready", None))
    server = _Server(ProgressPage(folder))
    while True:
        word, *rest = channel.receive()
        answer = _answer(getattr(server, word), rest)
        if word != "forget":
            channel.send(answer)
        del rest, answer  # a scene or a result; the next one may need the memory


def _answer(work: Callable, arguments: list) -> tuple[str, object]:
    try:
        return "done", work(*arguments)
    except ObscuranceError as error:
        return "error", type(error)(*error.args)  # without what led to it, which may be anything
    except MemoryError:
        return "error", BackendError("there is not enough memory for this bake: use fewer rays or objects at once")
    except Exception:
        return "bug", traceback.format_exc()
