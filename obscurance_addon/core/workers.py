"""Threads to work in."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def workers(threads: int) -> Iterator[Executor]:
    """An executor with so many threads for as long as the block lasts; the caller's own if that is fewer than two."""
    with ThreadPoolExecutor(threads) if threads > 1 else _Alone() as executor:
        yield executor


class _Alone(Executor):
    """Does what it is given at once."""

    def map(self, function: Callable, *iterables: Iterable) -> Iterator:  # the one method that is used here
        return map(function, *iterables)
