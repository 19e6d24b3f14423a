"""Runs inside of Blender: plays one case of `cases/`, step by step between redraws, and ends with its outcome.

    blender --enable-event-simulate --python player.py -- MODULE CASE

A case is a generator function that takes a `Window`. What it yields is how long to let Blender work, in seconds, before
it goes on; None is one redraw.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy

CHECKOUT = Path(__file__).resolve().parents[2]
RUN = Path("/mnt/run")
ADDON = "bl_ext.user_default.obscurance_addon"
_TICK_S = 0.05
_PATIENCE_S = 60.0  # for something to appear: a software renderer on a busy machine is slow
_FIRST_DRAW_S = 2.0
_SETTLE_S = 0.3
_FULL = {"full_path": True}
_ROW_PX = 6  # step of the search for a button, less than half of a button's height

Steps = Iterator[float | None]


class Window:
    """What a user's hands and eyes do in Blender's window."""

    def __init__(self) -> None:
        self._window = bpy.context.window_manager.windows[0]

    @property
    def context(self) -> bpy.types.Context:
        return bpy.context

    def open(self, sample: str) -> Steps:
        """Open a copy of a sample scene, with its user interface as it is now."""
        path = RUN / sample
        path.write_bytes((CHECKOUT / "sample_blends" / sample).read_bytes())
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
        yield _FIRST_DRAW_S

    def area(self, kind: str = "VIEW_3D") -> bpy.types.Area:
        """The largest area of a kind."""
        areas = [area for area in self._window.screen.areas if area.type == kind]
        return max(areas, key=lambda area: area.width * area.height)

    def region(self, kind: str = "UI", area: str = "VIEW_3D") -> bpy.types.Region:
        return next(region for region in self.area(area).regions if region.type == kind)

    def sidebar(self, tab: str = "Obscurances") -> Steps:
        """Open the sidebar of the 3D view at one of its tabs."""
        self.area().spaces.active.show_region_ui = True
        yield from self.until(lambda: self.region().width > 1, "the sidebar")
        yield 1.0
        self.region().active_panel_category = tab
        self.region().tag_redraw()
        yield 1.0

    def look_from_camera(self) -> Steps:
        self.area().spaces.active.region_3d.view_perspective = "CAMERA"
        yield 0.5

    def select_all(self) -> Steps:
        """Press A over the 3D view."""
        view = self.region("WINDOW")
        self.point(view.x + view.width // 3, view.y + view.height // 2)
        yield None
        yield from self.key("A")
        yield from self.until(lambda: bpy.context.selected_objects, "the selection")

    def point(self, x: int, y: int) -> None:
        """Move the mouse to a pixel of the window, counted from its lower left corner."""
        self._window.event_simulate("MOUSEMOVE", "NOTHING", x=x, y=y)
        self._mouse = x, y

    def click(self, x: int, y: int) -> Steps:
        self.point(x, y)
        yield None
        self._window.event_simulate("LEFTMOUSE", "PRESS", x=x, y=y)
        yield None
        self._window.event_simulate("LEFTMOUSE", "RELEASE", x=x, y=y)
        yield None

    def key(self, key: str, **modifiers: bool) -> Steps:
        """Press and release a key where the mouse is."""
        x, y = self._mouse
        for value in ("PRESS", "RELEASE"):
            self._window.event_simulate(key, value, x=x, y=y, **modifiers)
            yield None

    def find(self, code: str, region: bpy.types.Region | None = None, area: bpy.types.Area | None = None) -> Steps:
        """Find a button by what it does: the start of its Python command or of its data path.

        Moves the mouse over a region from top to bottom and asks Blender what is under it. Returns its pixel.
        """
        region, area = region or self.region(), area or self.area()
        seen = set()
        for share in (0.5, 0.8, 0.25, 0.16):  # the last is where the headers of subpanels have their checkbox
            x = region.x + int(share * region.width)
            for y in range(region.y + region.height - 4, region.y, -_ROW_PX):
                self.point(x, y)
                yield None
                found = self._under_mouse(area, region)
                if found.startswith(code):
                    yield _SETTLE_S  # a busy window may still have told of the button where the mouse was before
                    if self._under_mouse(area, region).startswith(code):
                        return x, y
                seen.add(found)
        raise AssertionError(f"no button does {code!r}, only {sorted(seen - {''})}")

    def _under_mouse(self, area: bpy.types.Area, region: bpy.types.Region) -> str:
        """Python command or data path of the button under the mouse, '' where there is none."""
        manager = bpy.context.window_manager
        with bpy.context.temp_override(window=self._window, area=area, region=region):
            for copy, how in ((bpy.ops.ui.copy_python_command_button, {}), (bpy.ops.ui.copy_data_path_button, _FULL)):
                manager.clipboard = ""
                if copy.poll():
                    copy(**how)
                if manager.clipboard:
                    return manager.clipboard
        return ""

    def press(self, code: str) -> Steps:
        """Click a button of the sidebar that does this; see `find`."""
        yield from self.click(*(yield from self.find(code)))

    def until(self, condition: Callable[[], object], what: str, patience_s: float = _PATIENCE_S) -> Steps:
        """Let Blender work until something is so."""
        end = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}"
            yield None

    def picture(self, name: str) -> Steps:
        """Save what the screen shows as NAME.png."""
        for area in self._window.screen.areas:
            area.tag_redraw()
        yield 0.5
        subprocess.run(["import", "-window", "root", str(RUN / f"{name}.png")], check=True)


def _play(steps: Steps) -> Callable[[], float | None]:
    """A timer that does one step at a time and ends Blender when there are no more."""

    def tick() -> float | None:
        try:
            return next(steps) or _TICK_S
        except StopIteration:
            print("CASE PASSED", flush=True)
            bpy.ops.wm.quit_blender()
            return None
        except BaseException:
            traceback.print_exc()
            subprocess.run(["import", "-window", "root", str(RUN / "failed.png")], check=False)
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(1)

    return tick


if __name__ == "__main__":
    sys.path.insert(0, str(CHECKOUT))
    module, case = sys.argv[sys.argv.index("--") + 1 :]
    bpy.context.preferences.view.show_splash = False
    started = getattr(importlib.import_module(f"tests.window.cases.{module}"), case)(Window())
    bpy.app.timers.register(_play(started), first_interval=_FIRST_DRAW_S, persistent=True)
