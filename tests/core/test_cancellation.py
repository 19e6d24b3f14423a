"""Progress is reported as promised, and a monitor that says stop stops the bake."""

import threading

import pytest

from obscurance_addon.core.errors import BakeCancelledError
from obscurance_addon.core.monitor import Monitor
from obscurance_addon.core.settings import BakeSettings

from .scenes import box, floor, grid, scene

OPEN = [floor((0, 0), (1, 1), 16, 16), grid((0, 0, 0), (0, 1, 0), (0, 0, 1), 4, 4)]


class Recorder(Monitor):
    def __init__(self, stop_in=None, after=0):
        self.phases, self.done, self.threads = [], {}, set()
        self.stop_in, self.after, self.lock = stop_in, after, threading.Lock()

    def phase(self, name, total):
        self.phases.append((name, total))
        self.done[name] = 0

    def advance(self, amount):
        with self.lock:
            name = self.phases[-1][0]
            if name == "trace":
                self.threads.add(threading.current_thread())
            self.done[name] += amount
            if name == self.stop_in and self.done[name] >= self.after:
                raise BakeCancelledError("cancelled")


def test_progress_adds_up():
    """Triangles built and rays cast end at the totals announced, when no solid asks for more rays."""
    monitor = Recorder()
    baked = scene(OPEN).bake(BakeSettings(64), monitor=monitor)
    assert [name for name, _ in monitor.phases] == ["build", "trace"]
    assert monitor.phases == list(monitor.done.items())
    assert monitor.done == {"build": 2 * 272, "trace": baked.rays + baked.error_rays}


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("solids", [[], [box((0.3, 0.3, -0.1), (0.6, 0.6, 0.4), 2)]], ids=["open", "solid"])
def test_a_worker_can_cancel(threads, solids):
    """The error surfaces, no thread stays, and blocks that had not begun are never cast."""
    before = set(threading.enumerate())
    monitor = Recorder("trace", after=5000)
    with pytest.raises(BakeCancelledError):
        scene([*OPEN, *solids]).bake(BakeSettings(4096, threads=threads), monitor=monitor, block_rays=8192)
    assert set(threading.enumerate()) == before
    assert threading.main_thread() not in monitor.threads
    assert monitor.done["trace"] < 0.5 * monitor.phases[-1][1]


def test_the_build_can_be_cancelled():
    before = set(threading.enumerate())
    with pytest.raises(BakeCancelledError):
        scene(OPEN).bake(monitor=Recorder("build"))
    assert set(threading.enumerate()) == before


def test_a_cancelled_bake_can_be_repeated():
    with pytest.raises(BakeCancelledError):
        scene(OPEN).bake(monitor=Recorder("trace"))
    assert scene(OPEN).bake().valid.all()
