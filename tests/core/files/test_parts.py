"""Files that replace others: whole or not at all, and nothing is left, after a kill neither."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from obscurance_addon.core.files import (
    NotWholeError,
    Parts,
    PrivateFolder,
    TargetError,
    let_go_of_all,
    replaced,
    written_whole,
)

pytest.importorskip("fcntl")
ROOT = Path(__file__).parents[3]


def fine(_path):
    """A check that finds nothing."""


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_new_file_takes_the_place_of_the_old_one_at_the_end(tmp_path):
    """It keeps its permissions; a link stays a link."""
    file, link = tmp_path / "file.txt", tmp_path / "link.txt"
    file.write_text("old")
    file.chmod(0o640)
    link.symlink_to(file)
    with written_whole(link, fine) as part:
        part.write_text("new")
        assert file.read_text() == "old"
    assert (file.read_text(), link.is_symlink(), stat.S_IMODE(file.stat().st_mode)) == ("new", True, 0o640)
    assert names(tmp_path) == ["file.txt", "link.txt"]


def write(target, check, error=None):
    """Write a file as Blender does, with one of its own beside that; an error comes last."""
    with written_whole(target, check) as part:
        part.with_name(part.name + "@").touch()
        part.write_text("new")
        if error is not None:
            raise error


def cut(path):
    raise NotWholeError(path)


@pytest.mark.parametrize(
    ("check", "error", "words"),
    [
        (cut, None, "file.txt' could not be written .not all of it was written.: make room"),
        (
            fine,
            OSError(28, "No space left on device"),
            "file.txt' could not be written .No space left on device.: make",
        ),
    ],
)
def test_what_is_not_whole_replaces_nothing(tmp_path, check, error, words):
    file = tmp_path / "file.txt"
    file.write_text("old")
    with pytest.raises(TargetError, match=words):
        write(file, check, error)
    assert (file.read_text(), names(tmp_path)) == ("old", ["file.txt"])


def test_a_target_that_became_special_meanwhile_is_not_replaced(tmp_path):
    file = tmp_path / "file.txt"
    with pytest.raises(TargetError, match="is a pipe"):
        write(file, lambda _part: os.mkfifo(file))
    assert stat.S_ISFIFO(file.stat().st_mode)
    assert names(tmp_path) == ["file.txt"]


def test_parts_of_killed_runs_are_removed_by_the_next_one(tmp_path):
    """Those of live ones, of other machines, and what the user has named like them stay."""
    code = (
        "import os, sys; from obscurance_addon.core.files import Parts; parts = Parts(sys.argv[1]);"
        "parts.new('.blend').touch(); parts.new('').mkdir(); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, check=False)
    assert done.returncode == -signal.SIGKILL
    left = names(tmp_path)
    assert len(left) == 3
    others = [".obscurance-notes.txt", ".obscurance-0.part", ".obscurance-far.1.part", ".obscurance-far.lock"]
    for name in others:
        (tmp_path / name).write_text("another machine")
    with Parts(tmp_path) as live:
        live.new(".exr").touch()
        with Parts(tmp_path):
            assert not set(left) & set(names(tmp_path))
            assert len(names(tmp_path)) == len(others) + 3
    assert names(tmp_path) == sorted(others)


def test_an_old_file_that_cannot_be_put_back_stays_beside_the_new_one(tmp_path, monkeypatch):
    """Nobody else has it."""
    file, calls = tmp_path / "file.txt", []
    file.write_text("old")

    def only_once(*arguments, real=os.replace):
        calls.append(arguments)
        if len(calls) > 1:
            raise PermissionError(13, "Permission denied")
        real(*arguments)

    monkeypatch.setattr(os, "replace", only_once)
    with Parts(tmp_path) as parts:
        parts.new(".txt").write_text("new")
        part = next(tmp_path.glob("*.part.txt"))
        with pytest.raises(RuntimeError), replaced([(str(part), str(file))], parts):
            raise RuntimeError
    assert file.read_text() == "new"
    assert sorted(path.read_text() for path in tmp_path.iterdir()) == ["new", "old"]


def test_all_is_let_go_of_at_once(tmp_path):
    """As Ctrl-C does, in the midst of writing."""
    with Parts(tmp_path) as parts:
        parts.new("").mkdir()
        let_go_of_all()
        assert names(tmp_path) == []


def test_temporary_folders_of_killed_runs_are_removed_by_the_next_one(tmp_path, monkeypatch):
    """With the folder that Blender makes in them."""
    code = (
        "import os; from obscurance_addon.core.files import PrivateFolder; folder = PrivateFolder();"
        "(folder.path / 'blender_x').mkdir(); os.kill(os.getpid(), 9)"
    )
    env = os.environ | {"TMPDIR": str(tmp_path)}
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=env, check=False).returncode == -signal.SIGKILL
    assert len(names(tmp_path)) == 1
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = PrivateFolder()
    assert names(tmp_path) == [folder.path.name]
    folder.close()
    assert names(tmp_path) == []
