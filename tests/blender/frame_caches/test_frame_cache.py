"""Frame caches on disk: what is read is what was written, and nothing else in a folder is touched."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from obscurance_addon.blender.frame_caches.frame_cache import FrameCache, FrameCacheError
from tests.blender.frame_caches.cache_helpers import holds, values, write, write_version_1

ROOT = Path(__file__).parents[3]
OLD, NEW = values(1), values(2)
WRITERS = {"today": write, "version 1": write_version_1}


def names(folder):
    """What lies in a folder, without the part of names that chance chose."""
    return sorted(path.name.partition("-")[0] for path in folder.iterdir())


@pytest.mark.parametrize("kind", WRITERS)
def test_what_was_written_is_read(tmp_path, kind):
    WRITERS[kind](tmp_path / "c", OLD)
    assert holds(tmp_path / "c", OLD)
    assert not holds(tmp_path / "c", NEW)
    assert FrameCache.open(tmp_path / "c").names == ["Floor", "Block", "Far"]


@pytest.mark.parametrize("kind", WRITERS)
def test_a_cache_replaces_another_whole(tmp_path, kind):
    WRITERS[kind](tmp_path / "c", OLD)
    write(tmp_path / "c", NEW)
    assert holds(tmp_path / "c", NEW)
    assert names(tmp_path / "c") == ["frames", "index.json", "obscurance.lock"]


def test_the_same_frames_far_apart_and_before_0(tmp_path):
    frames = dict(zip((-1048574, -3, -2, 0, 1000000), [*OLD.values(), NEW[1]], strict=True))
    write(tmp_path / "c", frames)
    assert holds(tmp_path / "c", frames)


def test_two_bakes_do_not_write_one_cache_at_a_time(tmp_path):
    from obscurance_addon.blender.frame_caches.cache_folder import CacheFolder

    write(tmp_path / "c", OLD)
    first = CacheFolder(tmp_path / "c")
    with pytest.raises(FrameCacheError, match="another bake is writing"):
        write(tmp_path / "c", NEW)
    assert first.generation.is_dir()
    first.leave()
    write(tmp_path / "c", NEW)
    assert names(tmp_path / "c") == ["frames", "index.json", "obscurance.lock"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_what_is_no_cache_is_refused_and_kept(tmp_path):
    """Whatever stands in the place, with the reason."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe")
    for name, content in (("notes", "notes.txt"), ("index", "index.json"), ("frames", "frame_000001.npz")):
        (tmp_path / name).mkdir()
        (tmp_path / name / content).write_text("mine")
    write(tmp_path / "inside", OLD)
    next((tmp_path / "inside").glob("frames-*")).joinpath("notes.txt").write_text("mine")
    write(tmp_path / "linked", OLD)
    (tmp_path / "linked" / "frames-0123456789ab").symlink_to(tmp_path / "frames")
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    reasons = {
        "file": "is a file: name a folder",
        "pipe": "is a pipe: name a folder",
        "dangling": "is a link to nothing",
        "missing/c": "does not exist: create it first",
        "file/c": "does not exist: create it first",
        "x" * 300: "name is too long for the disk: choose a shorter one",
        "notes": "holds 'notes.txt'",
        "index": "holds 'index.json'",
        "frames": "holds 'frame_000001.npz'",
        "inside": "holds 'frames-[0-9a-f]*/notes.txt'",
        "linked": "holds 'frames-0123456789ab'",
    }
    for name, reason in reasons.items():
        with pytest.raises(FrameCacheError, match=f"(?i){reason}"):
            write(tmp_path / name, NEW)
    assert {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize("kind", [None, *WRITERS])
def test_without_room_the_former_cache_stays_and_the_reason_is_said(tmp_path, kind):
    resource = pytest.importorskip("resource")
    folder = tmp_path / "c"
    if kind:
        WRITERS[kind](folder, OLD)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, limits[1]))
    try:
        with pytest.raises(
            FrameCacheError, match=r"cannot be written \(File too large\): make room there, or choose another folder"
        ):
            write(folder, NEW)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert holds(folder, OLD) if kind else not folder.exists()
    write(folder, NEW)
    assert holds(folder, NEW)


# Every call to the file system of a second bake is once the last one of a process, which forks for each.
KILLED = """
import os, pathlib, shutil, signal, sys
import bpy
from tests.blender.frame_caches.cache_helpers import holds, values, write, write_version_1
from tests.blender.frame_caches.test_frame_cache import names

STEPS = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.listdir", "os.scandir"}
old, new, last = values(1, 2), values(2, 2), values(3, 2)
os.fsync = lambda file: None  # which only a power cut would miss
home = pathlib.Path(sys.argv[1])
write(home / "first", old)  # imports all that it takes

def dying(folder, step):
    calls = 0
    def count(event, _arguments):
        nonlocal calls
        calls += event in STEPS
        if calls == step and event in STEPS:
            os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(count)
    write(folder, new)
    os._exit(0)

for before, twice in ((None, False), (write, False), (write_version_1, False), (write, True)):
    outcomes, step, status = [], 0, -1
    while status != 0:
        step += 1
        folder = home / f"{before.__name__ if before else None}-{twice}-{step}"
        if before:
            before(folder, old)
        for one in (max(1, step - 3), step) if twice else (step,):
            child = os.fork()
            if child == 0:
                dying(folder, one)
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        is_new = (folder / "index.json").exists() and (before is None or not holds(folder, old))
        assert not is_new or holds(folder, new), folder
        assert before is None or is_new or holds(folder, old), folder
        outcomes.append(is_new)
        write(folder, last)
        assert holds(folder, last), folder
        assert names(folder) == ["frames", "index.json", "obscurance.lock"], os.listdir(folder)
        shutil.rmtree(folder)
    assert outcomes[-1] and not outcomes[0] and len(outcomes) > 10, outcomes
    assert outcomes == sorted(outcomes) or twice
print("all four", flush=True)
os._exit(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_kill_at_any_call_to_the_file_system_leaves_the_old_cache_or_the_new_one(tmp_path):
    """Also a second kill while the next bake tidies up; the bake after that succeeds and leaves nothing over."""
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("all four\n")
