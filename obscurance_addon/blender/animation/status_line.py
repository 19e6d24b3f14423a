"""What is told in windows while no operator runs; harmless where there is none."""

from __future__ import annotations

import threading

import bpy

_SHOWN_S = 6.0


def has_window() -> bool:
    """Whether there is a window, and this is the thread that may touch it."""
    return not bpy.app.background and threading.current_thread() is threading.main_thread()


def say(text: str) -> None:
    """Show a text in the status line for some seconds."""
    if not has_window():
        return
    for workspace in bpy.data.workspaces:
        workspace.status_text_set(text)
    if not bpy.app.timers.is_registered(_end):
        bpy.app.timers.register(_end, first_interval=_SHOWN_S)


def clear() -> None:
    """Take down what `say` shows."""
    if bpy.app.timers.is_registered(_end):
        bpy.app.timers.unregister(_end)
        _end()


def redraw_panels() -> None:
    """Have the panels of 3D views drawn anew."""
    if not has_window():
        return
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def _end() -> None:
    for workspace in bpy.data.workspaces:
        workspace.status_text_set(None)
