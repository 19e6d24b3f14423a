"""Leaves Edit Mode (or a paint mode) for the time of a bake, and goes back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


class ObjectModeGuard:
    """Puts the objects of a context into object mode; `restore` brings mode, selection and active object back.

    Parameters
    ----------
    context : bpy.types.Context
    """

    def __init__(self, context: bpy.types.Context) -> None:
        view_layer = context.view_layer
        active = view_layer.objects.active
        self._mode = active.mode if active else "OBJECT"
        self._active = active.name if active else ""
        self._members: list[str] = []
        if self._mode != "OBJECT":
            self._members = [ob.name for ob in view_layer.objects if ob.mode == self._mode]
            bpy.ops.object.mode_set(mode="OBJECT")

    def restore(self, context: bpy.types.Context) -> None:
        """Enter the mode again that was left; does nothing when none was, or the active object is gone."""
        objects = context.view_layer.objects
        if self._mode == "OBJECT" or self._active not in objects:
            return
        selected = [ob.name for ob in objects if ob.select_get()]
        for ob in objects:
            ob.select_set(ob.name in self._members)
        objects.active = objects[self._active]
        bpy.ops.object.mode_set(mode=self._mode)
        for ob in objects:
            ob.select_set(ob.name in selected)
        self._mode = "OBJECT"


@contextmanager
def in_object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Object mode for the time of a block."""
    guard = ObjectModeGuard(context)
    try:
        yield
    finally:
        guard.restore(context)
