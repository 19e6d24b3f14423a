"""Child processes begin, answer and end, and leave nothing behind, whoever is killed."""

import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from obscurance_addon.core.errors import BackendError, GeometryError
from obscurance_addon.core.order import SERVER
from obscurance_addon.core.process import ChildEndedError, ChildProcess

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and folders of POSIX")
ROOT = Path(__file__).parents[3]
PARENT = """
import sys
from obscurance_addon.core.process import ChildProcess
child = ChildProcess({server!r})
child.receive()
print(child.pid, flush=True)
sys.stdin.read()
"""


CHILD_IN_CHILD = """
import sys, tempfile
from pathlib import Path
sys.path.insert(0, {root!r})
from obscurance_addon.core.process import ChildProcess
outer = ChildProcess({server!r})
outer.receive()
tempfile.tempdir = str(outer.folder)  # as a child has it
inner = ChildProcess({server!r})
inner.receive()
print(outer.folder, inner.folder, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Temporary files go where the test can see them."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def until(condition):
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"


def test_it_is_ready_and_ends(own_folder):
    child = ChildProcess(SERVER)
    assert child.receive() == ("ready", None)
    assert child.is_alive()
    child.end()
    child.end()
    assert not child.is_alive()
    assert list(own_folder.iterdir()) == []


def test_a_killed_child_is_told_with_its_signal(own_folder):
    child = ChildProcess(SERVER)
    child.receive()
    os.kill(child.pid, signal.SIGKILL)
    with pytest.raises(ChildEndedError, match=r"signal 9 \(SIGKILL, as systems do when memory runs out\)"):
        child.receive()
    child.end()
    assert list(own_folder.iterdir()) == []


def test_an_error_of_the_core_arrives_as_what_it_is():
    child = ChildProcess(SERVER)
    child.receive()
    child.send(("values", "nobody"))
    word, text = child.receive()
    assert word == "bug"
    assert "values" in text
    child.send(("_answer_with", GeometryError))
    with pytest.raises(ChildEndedError, match="_answer_with"):
        child.receive()
    child.end()


def test_a_folder_that_takes_no_file_is_told_and_the_child_lives():
    """As on a full disk; afterwards small and large messages arrive as before."""
    child = ChildProcess(SERVER)
    child.receive()
    child.send(("values", "nobody"))
    assert child.receive()[0] == "bug"  # it has begun, and made its own file in the folder
    away = child.folder.with_name("away")
    child.folder.rename(away)
    large = np.zeros(1 << 20)
    with pytest.raises(BackendError, match="no room in the folder for temporary files"):
        child.send(("values", large))
    away.rename(child.folder)
    for key in ("nobody", large):
        child.send(("values", key))
        assert child.receive()[0] == "bug"
    child.end()


def test_without_a_temporary_folder_none_starts(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(ChildEndedError, match="the system does not start it"):
        ChildProcess(SERVER)


def test_what_a_child_makes_lies_in_its_folder(own_folder):
    """So that it goes with that: here the process that unwraps, which is killed with the one that bakes."""
    code = CHILD_IN_CHILD.format(root=str(ROOT), server=SERVER)
    parent = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    outer, inner = map(Path, parent.stdout.readline().split())
    assert inner.parent == outer
    parent.kill()
    parent.wait()
    until(lambda: not list(own_folder.glob("obscurance-*")))
    parent.stdin.close()
    parent.stdout.close()


@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_parent_takes_its_child_and_folder_along(sign, own_folder):
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT.format(server=SERVER)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    child = int(parent.stdout.readline())
    assert len(list(own_folder.glob("obscurance-*"))) == 1
    parent.send_signal(sign)
    parent.wait()
    until(lambda: not is_running(child))
    until(lambda: not list(own_folder.glob("obscurance-*")))
    parent.stdin.close()
    parent.stdout.close()


def test_what_was_left_by_both_is_swept(own_folder):
    """The next child finds the folder that no living process owns, and leaves alone those that are owned."""
    left = own_folder / "obscurance-left"
    left.mkdir()
    (left / "owner").write_text(platform.node())
    (left / "1-1").write_bytes(bytes(100))
    first = ChildProcess(SERVER)
    assert not left.exists()
    second = ChildProcess(SERVER)
    assert first.folder.exists()
    for child in (first, second):
        child.receive()
        child.end()
