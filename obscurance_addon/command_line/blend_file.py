"""Opens and saves .blend files: what Blender reports is told apart from what stops it."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ..core.errors import ObscuranceError
from ..core.files import CHECKS, NotWholeError, TargetError, written_whole
from .terminal import blender_silent

_check = CHECKS[".blend"]


def open_blend(path: Path) -> list[str]:
    """Open a file without running any Python that it carries.

    Returns
    -------
    list of str
        What Blender reported while it opened the file all the same.

    Raises
    ------
    RuntimeError
        When Blender cannot open it; the message is Blender's.
    """
    opened = []

    @bpy.app.handlers.persistent
    def note(*_arguments: object) -> None:
        opened.append(True)

    bpy.app.handlers.load_post.append(note)
    try:
        with blender_silent():
            bpy.ops.wm.open_mainfile(filepath=os.path.realpath(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        if not opened:
            raise
        return [f"Blender opened the file and reported: {plain(error)}"]
    finally:
        bpy.app.handlers.load_post.remove(note)
    return []


def check_version(scene: Path, output: Path) -> list[str]:
    """Notes on the Blender that saved the open file.

    Raises
    ------
    ObscuranceError
        When it was a newer one, whose data this one does not know, and the file would be saved over.
    """
    if tuple(bpy.data.version) <= tuple(bpy.app.version_file):
        return []
    newer, own = ("{}.{}".format(*version) for version in (bpy.data.version, bpy.app.version))
    newer = f"a newer Blender {own}" if newer == own else f"Blender {newer}"
    if os.path.realpath(scene) == os.path.realpath(output) or (output.exists() and os.path.samefile(scene, output)):
        raise ObscuranceError(
            f"it was saved by {newer}, and this is {own}, which would lose what is new: bake it with the newer one, or "
            "give another file with --output"
        )
    return [f"the scene was saved by {newer}, and the output by {own} has nothing of what is new since"]


def save_blend(output: Path, compress: bool) -> list[str]:
    """Save the open file, whole or not at all, as a copy.

    Returns
    -------
    list of str
        What Blender reported although the file is whole.

    Raises
    ------
    TargetError
        When the file could not be written; an older one is then still there.
    """
    notes: list[str] = []
    with written_whole(output, _check) as part:
        try:
            with blender_silent():
                bpy.ops.wm.save_as_mainfile(filepath=str(part), copy=True, compress=compress, check_existing=False)
        except RuntimeError as error:
            reason = plain(error).replace(str(part), str(output))
            if not _is_whole(part):
                raise TargetError(
                    f"'{output}' could not be written ({reason}): make room on the disk, or choose another folder"
                ) from error
            notes.append(f"Blender saved the file and reported: {reason}")
    return notes


def _is_whole(part: Path) -> bool:
    try:
        _check(part)
    except (FileNotFoundError, NotWholeError):
        return False
    return True


def plain(error: Exception) -> str:
    """The message of an error on one line, without Blender's prefix; its type where it has no message."""
    return " ".join(str(error).replace("Error: ", "", 1).split()) or type(error).__name__
