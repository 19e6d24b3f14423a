"""A .blend that is opened, baked and saved: what Blender reports is told apart from what stops it.

Nothing that the file carries is trusted: no Python of it runs, and it does not choose where anything is written.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.errors import ObscuranceError
from ..core.files import CHECKS, NotWholeError, TargetError, identities, written_whole
from .terminal import blender_silent

_check = CHECKS[".blend"]


class BlendFile:
    """The file that is open.

    Parameters
    ----------
    path : Path
    trusted : bool
        Let simulations write their caches where the file says.

    Attributes
    ----------
    notes : list of str
        What Blender reported although it opened, or saved, the file; and what was left out.

    Raises
    ------
    OSError
        When it cannot be read.
    RuntimeError
        When Blender cannot open it; the message is Blender's.
    """

    def __init__(self, path: Path, trusted: bool) -> None:
        self._path, self._trusted, self._opened = path, trusted, False
        self._left_out: list[bpy.types.Modifier] = []
        self.notes: list[str] = []
        with path.open("rb") as source:
            self._compressed = source.read(7) != b"BLENDER"
        self._open()

    def _open(self) -> None:
        def opened(*_arguments: object) -> None:  # before anything is evaluated
            self._opened = True
            if not self._trusted:
                self._leave_out_fluids()

        try:
            with blender_silent(), _handled(bpy.app.handlers.load_post, opened):
                bpy.ops.wm.open_mainfile(filepath=os.path.realpath(self._path), load_ui=False, use_scripts=False)
        except RuntimeError as error:
            if not self._opened:
                raise
            self.notes.append(f"Blender opened the file and reported: {plain(error)}")

    def _leave_out_fluids(self) -> None:
        """Switch off fluids that are computed, and written to the folder that the file names, while frames are set."""
        for ob in bpy.data.objects:
            for modifier in ob.modifiers:
                domain = modifier.domain_settings if modifier.type == "FLUID" else None
                if domain is not None and domain.cache_type == "REPLAY" and modifier.show_viewport:
                    modifier.show_viewport = False
                    self._left_out.append(modifier)
                    self.notes.append(
                        f"object '{ob.name}' has a fluid of cache type Replay, which writes files where the .blend "
                        "says: it was left out; bake it in Blender as Modular or All, or give --trust-paths"
                    )

    @contextmanager
    def _as_it_was(self) -> Iterator[None]:
        """Have what was left out saved; operators evaluate the scene before and after they save it."""

        def switch(to: bool) -> Callable:
            def handler(*_arguments: object) -> None:
                for modifier in self._left_out:
                    modifier.show_viewport = to

            return handler

        at = bpy.app.handlers
        with (
            _handled(at.save_pre, switch(True)),
            _handled(at.save_post, switch(False)),
            _handled(at.save_post_fail, switch(False)),
        ):
            yield

    def check_version(self, output: Path) -> None:
        """Note that a newer Blender has saved the file, whose data this one does not know.

        Raises
        ------
        ObscuranceError
            When it would be saved over.
        """
        if tuple(bpy.data.version) <= tuple(bpy.app.version_file):
            return
        newer, own = ("Blender {}.{}".format(*version) for version in (bpy.data.version, bpy.app.version))
        newer = f"a newer {own}" if newer == own else newer
        if identities(self._path) & identities(output):
            raise ObscuranceError(
                f"it was saved by {newer}, and this is {own}, which would lose what is new: bake it with the newer "
                "one, or give another file with --output"
            )
        self.notes.append(f"the scene was saved by {newer}, and the output by {own} has nothing of what is new since")

    def save(self, output: Path) -> None:
        """Save a copy, whole or not at all.

        Raises
        ------
        TargetError
            When the file could not be written; an older one is then still there.
        """
        with written_whole(output, _check) as part:
            try:
                with blender_silent(), self._as_it_was():
                    bpy.ops.wm.save_as_mainfile(
                        filepath=str(part), copy=True, compress=self._compressed, check_existing=False
                    )
            except RuntimeError as error:
                reason = plain(error).replace(str(part), str(output))
                if not _is_whole(part):
                    raise TargetError(
                        f"'{output}' could not be written ({reason}): make room on the disk, or choose another folder"
                    ) from error
                self.notes.append(f"Blender saved the file and reported: {reason}")


@contextmanager
def _handled(handlers: list[Callable], handler: Callable) -> Iterator[None]:
    """Have Blender call a function for some time, after files were loaded too."""
    handler = bpy.app.handlers.persistent(handler)
    handlers.append(handler)
    try:
        yield
    finally:
        handlers.remove(handler)


def _is_whole(part: Path) -> bool:
    try:
        _check(part)
    except (FileNotFoundError, NotWholeError):
        return False
    return True


def plain(error: Exception) -> str:
    """The message of an error on one line, without Blender's prefix; its type where it has no message."""
    return " ".join(str(error).replace("Error: ", "", 1).split()) or type(error).__name__
