"""Exports a saved animation in a Blender of its own: the Alembic exporter ends the whole process on a full disk.

What is baked is on disk by then, and the caller reads how the other process ended.
"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import sys
from pathlib import Path

import bpy

from ...core.errors import ObscuranceError
from ...core.process import run_command
from ..frame_caches import FrameCache
from ..reading import ObjectModeGuard
from ..stored_preferences import ADDON
from .animated_export import export_animation

_MARK = "obscurance export: "  # before a message to the caller
_REASONS = [os.strerror(number) for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)]
_LITTLE_ROOM = 1 << 20  # bytes left on a disk on which a file ends early


class ExportError(ObscuranceError):
    """An animation that could not be exported; the message says why, and the cure."""


_CODE = """
import importlib, os, sys, traceback
status = 1
if sys.platform == "linux":
    import ctypes
    ctypes.CDLL(None).prctl(1, 9)  # it is killed when its parent ends
    if os.getppid() != {parent}:
        os._exit(status)
try:
    import bpy
    addon = {addon!a}
    if not hasattr(bpy.types.Scene, "obscurance"):
        if addon.startswith("bl_ext."):
            import addon_utils
            addon_utils.enable(addon)
        else:
            importlib.import_module(addon).register()
    importlib.import_module(addon + ".blender.animation.export_process").export_saved(*{arguments!a})
    status = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)  # the bpy module crashes (4.2) or hangs (4.5) at a normal exit
"""


def export_in_process(file: Path, folder: Path, path: Path, told: str = "", scene: str = "") -> None:
    """Export the animation of a saved file to USD or Alembic in a process of its own.

    Parameters
    ----------
    file : Path
        A .blend whose objects have results.
    folder : Path
        The frame cache with its values.
    path : Path
        Its name ends in one of `FORMATS`. On a full disk the exporter may report success, so check what it wrote.
    told : str
        The name of the file for messages, where it is to have another one.
    scene : str
        The name of the scene to export, where it is not the one that is open in the file.

    Raises
    ------
    ExportError
        When the exporter says that it failed, or crashes.
    """
    status, printed = _run(
        _CODE.format(parent=os.getpid(), addon=ADDON, arguments=(str(file), str(folder), str(path), scene))
    )
    said, name = printed.decode(errors="replace"), told or path.name
    for line in said.splitlines():
        if line.startswith(_MARK):
            raise ExportError(line.removeprefix(_MARK).replace(path.name, name))
    reason = next((reason for reason in _REASONS if reason in said), None)
    if reason is None and status < 0:
        crashed = f"the exporter crashed with {_signal(-status)}, as it does when it cannot write"
        reason = os.strerror(errno.ENOSPC) if shutil.disk_usage(path.parent).free < _LITTLE_ROOM else crashed
    if reason:
        raise ExportError(f"'{name}' could not be exported ({reason}): make room there, or choose another folder")
    if status:
        last = (said.strip().splitlines() or ["it said nothing"])[-1]
        raise ExportError(
            f"'{name}' could not be exported, as Blender ended with exit code {status} ({last}): export the "
            "saved file in a window"
        )


def export_saved(file: str, folder: str, path: str, scene: str) -> None:
    """What the other process does; a message to the user goes to the caller on a line of its own."""
    try:
        bpy.ops.wm.open_mainfile(filepath=file, load_ui=False, use_scripts=False)
        if scene:
            bpy.context.window.scene = bpy.data.scenes[scene]
        ObjectModeGuard(bpy.context)
        bpy.context.scene.obscurance.live_preview = False
        export_animation(bpy.context, FrameCache.open(folder), Path(path))
    except ObscuranceError as error:
        print("\n" + _MARK + " ".join(str(error).split()), file=sys.stderr, flush=True)  # noqa: T201
        raise


def _run(code: str) -> tuple[int, bytes]:
    """Run code in another Blender, or in another Python with the bpy module, and keep what it says."""
    blender = bpy.app.binary_path  # empty in the bpy module
    try:
        return run_command(
            [blender, "--background", "--python-expr", code] if blender else [sys.executable, "-c", code],
            None if blender else os.environ | {"PYTHONPATH": _python_path()},
        )
    except OSError as error:
        raise ExportError(f"the system starts no process for the export ({error}): try again later") from None


def _python_path() -> str:
    """Where this process finds modules, without Blender's own folders, which the bpy module adds by itself."""
    own = bpy.utils.resource_path("LOCAL")
    return os.pathsep.join(path for path in sys.path if path and not path.startswith(own))


def _signal(number: int) -> str:
    return signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
