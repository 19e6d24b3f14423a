"""Runs the real Blender of a Debian in a folder, with the extension installed into an empty user folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tools import build_extension

ROOT = Path(__file__).resolve().parents[2]
SUITE = os.environ.get("DEBIAN", "trixie")
FOLDER = Path(os.environ.get("DEBIAN_FOLDER", Path.home() / ".cache" / "obscurance_addon")) / SUITE
PICTURES = ROOT / "build" / "window" / SUITE
SCREEN = (1600, 900)

# A process space of its own, so that nothing survives the run; the shell stays as its first process.
_MOUNTED = """
mount -t proc proc "$0/proc"; mount --bind /dev "$0/dev"
mount --bind "$1" "$0/mnt/checkout"; mount --bind "$2" "$0/mnt/run"
shift 2
chroot "$0" "$@"
"""


class DebianBlender:
    """A Blender and a user folder of its own.

    Parameters
    ----------
    run_dir : Path
        Empty folder, which Blender sees as /mnt/run (and the checkout as /mnt/checkout).
    """

    def __init__(self, run_dir: Path) -> None:
        made = subprocess.run(["sh", ROOT / "tools" / "debian_blender.sh", SUITE, FOLDER], check=False)
        if made.returncode:
            raise RuntimeError(f"there is no Blender in {FOLDER}: see above")
        self.run_dir = run_dir
        wheels = FOLDER / "wheels"
        (self.zip,) = build_extension.build(["linux-x64"], run_dir, wheels if wheels.is_dir() else None)

    def run(self, *arguments: str, window: bool = False, timeout: float = 240.0) -> subprocess.CompletedProcess:
        """Run Blender with these arguments; in a window on a virtual screen or without any."""
        program = ["env", "BLENDER_USER_RESOURCES=/mnt/run/user", "LIBGL_ALWAYS_SOFTWARE=1", "HOME=/mnt/run/home"]
        if window:
            width, height = SCREEN
            program += ["xvfb-run", "-a", "-s", f"-screen 0 {width}x{height}x24", "blender", "--enable-event-simulate"]
            program += ["--window-geometry", "0", "0", str(width), str(height)]
        else:
            program += ["blender"]
        command = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-euc", _MOUNTED, FOLDER]
        command += [ROOT, self.run_dir, *program, *arguments]
        for name in ("user", "home"):
            (self.run_dir / name).mkdir(exist_ok=True)
        return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)

    def install(self) -> subprocess.CompletedProcess:
        """Install the zip from its file and enable it, as a user does."""
        return self.run(
            "--command", "extension", "install-file", "-r", "user_default", "-e", f"/mnt/run/{self.zip.name}"
        )

    def play(self, module: str, case: str) -> subprocess.CompletedProcess:
        """Play a case of `cases/` in a window; its pictures go to build/window/."""
        run = self.run("--python", "/mnt/checkout/tests/window/player.py", "--", module, case, window=True)
        PICTURES.mkdir(parents=True, exist_ok=True)
        for picture in self.run_dir.glob("*.png"):
            shutil.move(picture, PICTURES / picture.name)
        sys.stdout.write(run.stdout + run.stderr)  # pytest shows it when the test fails
        return run
