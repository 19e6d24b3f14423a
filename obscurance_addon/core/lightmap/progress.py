"""How far the texels of a lightmap are, while several bands of them are in work."""

from __future__ import annotations

import threading

from ..monitor import Monitor


class TexelProgress:
    """Tells a monitor how many texels are done, from the rays cast for those of the bands in work.

    Parameters
    ----------
    monitor : Monitor
        In a phase whose total is the number of texels.
    rays : int
        Cast from each texel, about.
    """

    def __init__(self, monitor: Monitor, rays: int) -> None:
        self._monitor, self._rays = monitor, rays
        self._lock = threading.Lock()
        self._open = self._cast = 0  # texels of bands in work, and the rays cast for them
        self._finished = self._told = 0  # texels

    def begin(self, texels: int) -> None:
        """A band of so many texels begins."""
        with self._lock:
            self._open += texels

    def cast(self, rays: int) -> None:
        """So many rays more were cast; from any thread, and may raise to cancel."""
        with self._lock:
            self._cast += rays
            news = self._news()
        self._monitor.advance(news)

    def end(self, texels: int) -> None:
        """A band of so many texels is done, however few rays it took."""
        with self._lock:
            self._open -= texels
            self._finished += texels
            self._cast = max(self._cast - texels * self._rays, 0)
            news = self._news()
        self._monitor.advance(news)

    def _news(self) -> int:
        """Texels done beyond those that the monitor was told of."""
        done = self._finished + min(self._cast // self._rays, self._open)
        news = max(done - self._told, 0)
        self._told += news
        return news
