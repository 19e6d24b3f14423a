"""What Live Preview says: of each update in the panel, and once of what a user may not expect."""

from __future__ import annotations

import logging

import bpy

from ...core.notes import named
from ...core.order import SharedMeshes
from . import status_line
from .frame_update import FrameReport, FrameUpdater
from .full_update import FullUpdater

_log = logging.getLogger(__name__)


class Said:
    """What was said while a preview runs, so that nothing is said twice."""

    def __init__(self) -> None:
        self._texts: set[str] = set()

    def once(self, text: str) -> None:
        """Say something in the status line, unless it was said."""
        if text not in self._texts:
            self._texts.add(text)
            _log.info("Live Preview: %s", text)
            status_line.say(f"Live Preview: {text}")


def update_notes(report: FrameReport, updater: FrameUpdater | FullUpdater) -> list[str]:
    """What to say once of an update, beside its status."""
    notes = []
    if report.shared and bpy.context.scene.obscurance.shared_meshes == SharedMeshes.SEPARATE:
        notes.append(
            f"these share a mesh, so they show the mean of their values: {named(report.shared)}; switch Live Preview "
            "off and on to give each a mesh of its own"
        )
    if report.full and isinstance(updater, FrameUpdater):
        notes.append(f"{report.full}: everything was baked anew")
    elif updater.cache_is_full:
        notes.append("the memory for cached hits is used up, so updates take longer; there is Memory in the panel")
    return notes


def update_status(report: FrameReport) -> str:
    """How much an update did."""
    if not report.patches:
        return "Up to date"
    return f"{report.patches:,} of {report.all_patches:,} patches in {1e3 * report.seconds:.1f} ms"
