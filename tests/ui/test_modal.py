"""The operator as a window drives it: its own methods, called with stand-ins for window, timer and events."""

import os
import signal
import sys
import tempfile
import threading
import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs.job import CHILD, BakeJob
from obscurance_addon.blender.reading.object_mode import ObjectModeGuard
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.ui.operators import OBSCURANCE_OT_bake
from tests.blender.helpers import FACE_LAYER, colors, file_state, select, sheet

pytestmark = pytest.mark.usefixtures("empty_scene")
TIMER, ESC, MOUSE = (SimpleNamespace(type=t, value="PRESS") for t in ("TIMER", "ESC", "MOUSEMOVE"))


class Window:
    """What the operator touches of a window manager and a workspace, and what it left there."""

    def __init__(self) -> None:
        self.timers, self.progress, self.text = 0, False, None
        self.window_manager = SimpleNamespace(
            event_timer_remove=lambda _timer: setattr(self, "timers", self.timers - 1),
            progress_update=lambda _value: None,
            progress_end=lambda: setattr(self, "progress", False),
        )
        self.workspace = SimpleNamespace(status_text_set=lambda text: setattr(self, "text", text))

    def __getattr__(self, name: str) -> object:
        return getattr(bpy.context, name)


class Running:
    """An operator whose bake has begun in a window."""

    def __init__(self, rays: int) -> None:
        self.window = Window()
        self.reports: list[tuple[str, str]] = []
        settings = bpy.context.scene.obscurance
        self._guard = ObjectModeGuard(bpy.context)
        self._job = BakeJob(
            bpy.context, bpy.context.selected_objects, BakeSettings(rays=rays), settings.to_output(), in_child=True
        )
        self._timer = object()
        self.window.timers, self.window.progress = 1, True
        OBSCURANCE_OT_bake._running = True

    def report(self, kind: set[str], text: str) -> None:
        self.reports.append((*kind, text))

    def __getattr__(self, name: str) -> object:
        return getattr(OBSCURANCE_OT_bake, name).__get__(self)

    def handle(self, event: SimpleNamespace) -> str:
        (answer,) = OBSCURANCE_OT_bake.modal(self, self.window, event)
        return answer

    def taken_down(self) -> bool:
        return not (self.window.timers or self.window.progress or OBSCURANCE_OT_bake._running or self._job)


@pytest.fixture
def floor():
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=(0.8, 0.1, 0.1))
    select(ob)
    return ob


def test_it_finishes_after_the_last_ray(floor):
    """Other events pass through; then the values are there, everything is taken down, and one line tells of it."""
    running = Running(rays=16)
    answers = {running.handle(MOUSE)}
    while (answer := running.handle(TIMER)) == "PASS_THROUGH":
        answers.add(answer)
        time.sleep(0.01)
    assert (answers, answer) == ({"PASS_THROUGH"}, "FINISHED")
    assert FACE_LAYER in floor.data.attributes
    assert running.taken_down()
    assert [kind for kind, text in running.reports if "Baked 4 patches" in text] == ["INFO"]


def test_progress_and_time_left_are_shown(floor):
    """The status text names a share of the work and how to cancel."""
    running = Running(rays=1 << 22)
    while not (running._job.progress and running._job.remaining):
        assert running.handle(TIMER) == "PASS_THROUGH"
    running.handle(TIMER)
    assert "%" in running.window.text
    assert "s left" in running.window.text
    assert "Esc" in running.window.text
    running.handle(ESC)
    assert not own_threads()


def test_esc_leaves_everything_as_it_was(floor):
    """In Edit Mode before, in Edit Mode after, and not a bit of the file differs."""
    bpy.ops.object.mode_set(mode="EDIT")
    before = file_state()
    running = Running(rays=1 << 22)
    assert running.handle(TIMER) == "PASS_THROUGH"
    assert running.handle(ESC) == "CANCELLED"
    assert not own_threads()
    assert running.taken_down()
    assert floor.mode == "EDIT"
    assert file_state() == before


def test_an_error_is_reported_and_everything_taken_down(floor):
    """The object is deleted while its bake runs."""
    running = Running(rays=16)
    bpy.data.objects.remove(floor)
    while (answer := running.handle(TIMER)) == "PASS_THROUGH":
        time.sleep(0.01)
    assert answer == "CANCELLED"
    assert running.taken_down()
    assert [kind for kind, text in running.reports if "'Floor' was deleted" in text] == ["ERROR"]


def test_edit_mode_entered_meanwhile_does_not_lose_the_bake(floor):
    """The mode is left for the moment of writing only."""
    running = Running(rays=16)
    while not running._job.step(0.1):
        continue
    bpy.ops.object.mode_set(mode="EDIT")
    assert running.handle(TIMER) == "FINISHED"
    assert floor.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert FACE_LAYER in floor.data.attributes


def test_a_second_bake_cannot_begin(floor):
    """The button is greyed out until the first one ends."""
    running = Running(rays=1 << 22)
    assert not bpy.ops.obscurance.bake.poll()
    running.handle(ESC)
    assert not own_threads()
    assert bpy.ops.obscurance.bake.poll()


@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6])
def test_a_child_that_is_killed_is_an_error_message(floor, seconds):
    """At any moment of its life; nothing is written, and the next bake works."""
    before = file_state()
    running = Running(rays=1 << 22)
    assert running.handle(TIMER) == "PASS_THROUGH"
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        assert running.handle(TIMER) == "PASS_THROUGH"
    answered = CHILD._child.answered
    os.kill(CHILD._child.pid, signal.SIGKILL)
    if not answered:  # as where the system ends it at once: the bake goes on by turns
        running.handle(ESC)
        CHILD._cannot_start = False
    else:
        while (answer := running.handle(TIMER)) == "PASS_THROUGH":
            continue
        assert answer == "CANCELLED"
        (told,) = [text for kind, text in running.reports if kind == "ERROR"]
        assert "signal 9" in told
    assert running.taken_down()
    assert file_state() == before
    running = Running(rays=16)
    while (answer := running.handle(TIMER)) == "PASS_THROUGH":
        assert not own_threads()
    assert answer == "FINISHED"


@pytest.mark.parametrize("how", ["not found", "ends at once", "no folder"])
def test_without_a_child_the_bake_runs_by_turns(floor, how, monkeypatch, tmp_path):
    """With the values of any other bake, and a note that says so."""
    executable = tmp_path / "python"
    if how == "ends at once":
        executable.write_text("#!/bin/sh\nexit 1\n")
        executable.chmod(0o755)
    CHILD.end()
    bpy.context.view_layer.update()
    BakeJob(bpy.context, [floor], BakeSettings(rays=16), bpy.context.scene.obscurance.to_output()).run()
    expected = colors(floor)
    if how == "no folder":
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    else:
        monkeypatch.setattr(sys, "executable", str(executable))
    monkeypatch.setattr(CHILD, "_cannot_start", False)
    monkeypatch.setattr(CHILD, "_is_told", False)
    running = Running(rays=16)
    while (answer := running.handle(TIMER)) == "PASS_THROUGH":
        continue
    assert answer == "FINISHED"
    assert not own_threads()
    assert len([text for kind, text in running.reports if kind == "WARNING" and "own process" in text]) == 1
    np.testing.assert_array_equal(colors(floor), expected)
    again = Running(rays=16)
    while again.handle(TIMER) == "PASS_THROUGH":
        continue
    assert not [text for kind, text in again.reports if kind == "WARNING"]  # it is said once


def own_threads():
    """Threads of a bake that there are now."""
    return [thread for thread in threading.enumerate() if thread.name.startswith(("obscurance", "ThreadPool"))]
