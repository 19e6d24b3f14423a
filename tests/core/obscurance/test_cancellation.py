"""Progress is reported as promised, and a monitor that says stop stops the bake."""

import threading

import pytest

from obscurance_addon.core.errors import BakeCancelledError
from obscurance_addon.core.light.lamps import PointLamp
from obscurance_addon.core.monitor import Monitor
from obscurance_addon.core.settings import BakeSettings
from tests.core.scenes import box, floor, grid, scene

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
    assert (threading.main_thread() in monitor.threads) == (threads == 1)
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


LAMP = PointLamp("Lamp", [0.05, 0.5, 0.5], [1.0, 1.0, 1.0])
LIGHT_PHASES = {
    "DIRECT": ["build", "light"],
    "COMBINED": ["build", "trace", "light", "redistribute"],
    "RADIOSITY": ["build", "light", "radiosity"],
}


def bake_light_of(quantity, monitor, rays=64):
    """A lamp close to a wall, so that there are reflectors, and a solid."""
    s = scene([*OPEN, box((0.3, 0.3, 0.1), (0.6, 0.6, 0.4), 2)])
    return s.bake_light(quantity, [LAMP], BakeSettings(rays, distance=0.5), reflectors=8, monitor=monitor)


@pytest.mark.parametrize("quantity", LIGHT_PHASES)
def test_phases_of_light(quantity):
    """They come in this order, and the work done comes close to what each announced."""
    monitor = Recorder()
    bake_light_of(quantity, monitor)
    assert [name for name, _ in monitor.phases] == LIGHT_PHASES[quantity]
    for name, total in monitor.phases:
        assert 0.5 * total < monitor.done[name] <= 1.05 * total, name


@pytest.mark.parametrize(("quantity", "phase"), [(q, p) for q, phases in LIGHT_PHASES.items() for p in phases])
def test_every_phase_of_light_can_be_cancelled(quantity, phase):
    before = set(threading.enumerate())
    with pytest.raises(BakeCancelledError):
        bake_light_of(quantity, Recorder(phase))
    assert set(threading.enumerate()) == before
