"""The zip of this checkout, and a bpy module that has it installed instead of the checkout."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tools import build_extension

ROOT = Path(__file__).resolve().parents[2]
MODULE = "bl_ext.user_default.obscurance_addon"
HERE = {
    ("Linux", "x86_64"): "linux-x64",
    ("Windows", "AMD64"): "windows-x64",
    ("Darwin", "arm64"): "macos-arm64",
    ("Darwin", "x86_64"): "macos-x64",
}[platform.system(), platform.machine()]

_BEFORE = f"""
import os, sys, warnings
warnings.simplefilter("error", DeprecationWarning)
import bpy, addon_utils
MODULE = {MODULE!r}
def enable():
    bpy.ops.preferences.addon_enable(module=MODULE)
    return sys.modules[MODULE]
"""
# The module crashes (4.2) or hangs (4.5) at a normal exit, also after an error.
_RUN = """
import traceback
status = 0
try:
    exec(compile(CODE, "test", "exec"))
except BaseException:
    traceback.print_exc()
    status = 1
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
"""
_PATIENCE_S = 120.0


class Installation:
    """A bpy module with an empty user folder, and without the libraries that the extension brings."""

    def __init__(self, folder: Path) -> None:
        self._user, self._site = folder / "user", folder / "site"
        self._user.mkdir()
        self._site.mkdir()
        for entry in Path(sysconfig.get_path("purelib")).iterdir():
            if not entry.name.startswith(("embreex", "uvunwrap", "xatlas")):
                (self._site / entry.name).symlink_to(entry)

    def run(self, code: str, *arguments: object) -> str:
        """Run code in a new process, in which deprecated calls are errors; returns what it printed.

        A traceback fails the test even where Blender catches it.
        """
        done = subprocess.run(
            [
                sys.executable,
                "-X",
                "faulthandler",
                "-S",
                "-c",
                f"{_BEFORE}CODE = {code!r}\n{_RUN}",
                *map(str, arguments),
            ],
            env={"PYTHONPATH": str(self._site), "BLENDER_USER_RESOURCES": str(self._user), "PATH": ""},
            capture_output=True,
            text=True,
            check=False,
            timeout=_PATIENCE_S,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
        return done.stdout

    def install(self, zipped: Path) -> str:
        """Install a zip from its file and enable it."""
        code = "bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo='user_default')\nenable()"
        return self.run(code, zipped)

    @property
    def user_folder(self) -> Path:
        return self._user


@pytest.fixture(scope="session")
def zipped(tmp_path_factory) -> Path:
    """The zip for this platform, of this checkout."""
    (made,) = build_extension.build([HERE], tmp_path_factory.mktemp("zip"))
    return made


@pytest.fixture(scope="session")
def user_folder(tmp_path_factory, zipped) -> Path:
    """The files of a user who has installed the extension; tests get copies."""
    first = Installation(tmp_path_factory.mktemp("installation"))
    first.install(zipped)
    return first.user_folder


@pytest.fixture
def blender(tmp_path) -> Installation:
    """Without the extension."""
    return Installation(tmp_path)


@pytest.fixture
def installed(blender, user_folder) -> Installation:
    """With the extension."""
    shutil.copytree(user_folder, blender.user_folder, symlinks=True, dirs_exist_ok=True)
    return blender
