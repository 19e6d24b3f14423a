"""How messages reach the user: as reports of operators, and as text in panels."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

import bpy

from ..core.errors import ObscuranceError

_CHARACTER_PX = 7.0  # of the interface font at scale 1, on average
_MARGIN_PX = 60.0  # icon and borders


class Reports:
    """Part of an operator that reports what the core and Blender's side tell it."""

    def fail(self, error: ObscuranceError) -> set[str]:
        """Report an error that is meant for the user; what the operator returns then."""
        self.report({"ERROR"}, sentence(str(error)))
        return {"CANCELLED"}

    def warn(self, notes: Iterable[str]) -> None:
        """Report notes one by one."""
        for note in notes:
            self.report({"WARNING"}, sentence(note))


def sentence(text: str) -> str:
    """A message of the core as Blender shows messages, with a capital letter."""
    return text[:1].upper() + text[1:]


def draw_message(layout: bpy.types.UILayout, text: str, icon: str, width: float) -> None:
    """A message broken into lines that fit a region of `width` pixels."""
    scale = bpy.context.preferences.system.ui_scale
    per_line = max(int((width / scale - _MARGIN_PX) / _CHARACTER_PX), 12)
    column = layout.column(align=True)
    for i, line in enumerate(textwrap.wrap(text, per_line)):
        column.label(text=line, icon=icon if i == 0 else "BLANK1")
