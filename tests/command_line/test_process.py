"""The process of the command line: Ctrl-C, streams that nobody reads, and what stays behind."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest

from obscurance_addon.command_line import batch
from obscurance_addon.command_line.terminal import shown
from tests.blender.helpers import FACE_LAYER, floor

pytestmark = [
    pytest.mark.usefixtures("empty_scene"),
    pytest.mark.skipif(sys.platform == "win32", reason="signals and streams are those of Unix"),
]
ROOT = Path(__file__).parents[2]
NAME = "Böden 床\n"

# Runs the command line, and has Ctrl-C pressed where Blender calls Python, prints what that raises, and goes on.
DRIVER = """
import os, signal, sys
moment, scene = sys.argv[1:]

def press(*_):
    os.kill(os.getpid(), signal.SIGINT)

from obscurance_addon import __main__ as program
from obscurance_addon.command_line import process
from obscurance_addon.core.process import ChildProcess
run_in_blender, receive = program._run_in_blender, ChildProcess.receive

def prepared(arguments):
    import bpy
    if moment == "loading":
        bpy.app.handlers.load_post.append(bpy.app.handlers.persistent(press))
    if moment == "saving":
        bpy.app.handlers.save_pre.append(bpy.app.handlers.persistent(press))
    return run_in_blender(arguments)

def received(child):
    print("child", child.pid, flush=True)
    press()

program._run_in_blender = prepared
if moment == "unwrapping":
    ChildProcess.receive = received
sys.argv = ["obscurance", "bake", scene, "--target", "LIGHTMAP", "--size", "256", "--image", "//map.exr", "--quiet"]
program.main()
"""


@pytest.fixture
def scene(tmp_path):
    floor(NAME)
    bpy.context.scene.obscurance.rays = 4
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path / "scene.blend"


def is_baked(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return FACE_LAYER in bpy.data.objects[NAME].data.attributes


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def has_ended(pid):
    """Whether a process ends, although nobody may take note of it: then the system still has its number."""
    for _ in range(500):
        found = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
        if found.stdout.strip()[:1] in ("", "Z"):
            return True
        time.sleep(0.01)
    return False


@pytest.mark.parametrize("moment", ["loading", "unwrapping", "saving"])
def test_ctrl_c_ends_the_run_also_where_blender_ignores_it(scene, tmp_path, moment):
    """Status 130, nothing half-written, no temporary file, no child process."""
    temporary, before = tmp_path / "temporary", scene.read_bytes()
    temporary.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, moment, str(scene)],
        cwd=ROOT, env=os.environ | {"TMPDIR": str(temporary)}, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr
    assert scene.read_bytes() == before
    expected = ["map.exr"] if moment == "saving" else []
    assert files(tmp_path) == [*expected, "scene.blend", "temporary"]
    if moment == "unwrapping":
        assert has_ended(int(re.search(r"^child (\d+)$", done.stdout, re.MULTILINE)[1]))


def test_closed_streams_lose_nothing_and_nothing_stays_behind(scene, tmp_path):
    """Neither of the three is there; a file that is opened must not take the place of one."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    command = f'exec "{sys.executable}" -m obscurance_addon bake "{scene}" <&- >&- 2>&-'
    done = subprocess.run(
        ["sh", "-c", command], cwd=ROOT, env=os.environ | {"TMPDIR": str(temporary)}, timeout=120, check=False
    )
    assert done.returncode == 0
    assert files(tmp_path) == ["scene.blend", "temporary"]
    assert is_baked(scene)


def nobody_reads():
    read, write = os.pipe()
    os.close(read)
    return os.fdopen(write, "w")


def closed():
    stream = io.StringIO()
    stream.close()
    return stream


def ascii_only():
    return io.TextIOWrapper(io.BytesIO(), encoding="ascii")


def full():
    return Path("/dev/full").open("w")


STREAMS = {
    "full": full,
    "no reader": nobody_reads,
    "closed": closed,
    "none": lambda: None,
    "ascii": ascii_only,
}


@pytest.mark.parametrize("kind", STREAMS)
def test_no_stream_changes_the_status(scene, monkeypatch, kind):
    """Of a bake that succeeds, and of one that fails."""
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, STREAMS[kind]())
    assert batch.main(["bake", str(scene)]) == 0
    assert batch.main(["bake", str(scene), "--objects", "ö"]) == 1
    if kind == "ascii":
        assert rb"'B\xf6den \u5e8a\n'" in sys.stdout.buffer.getvalue()
        assert rb"'\xf6'" in sys.stderr.buffer.getvalue()
    else:
        monkeypatch.undo()
    assert is_baked(scene)


def test_what_would_steer_a_terminal_is_escaped():
    """Letters of all scripts are not."""
    assert shown("Würfel 立方体 🌳") == "Würfel 立方体 🌳"
    assert shown("a\nb\x1b[2Jc\udce9") == r"a\nb\x1b[2Jc\udce9"


def test_ctrl_c_stays_off_where_it_was_off(monkeypatch):
    """As in jobs that a script runs in the background."""
    from obscurance_addon.command_line import end_on_interrupt

    old = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGPIPE)}
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        end_on_interrupt()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
