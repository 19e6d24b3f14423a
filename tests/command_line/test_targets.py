"""Where the command line writes: not over special files, not twice into one file, not where a .blend says."""

import contextlib
import json
import os
import stat
import subprocess
import sys
import threading

import bpy
import pytest

from obscurance_addon.command_line import batch
from tests.blender.helpers import FACE_LAYER, floor

pytestmark = pytest.mark.usefixtures("empty_scene")
LIGHTMAP = ("--target", "LIGHTMAP", "--size", "256")


@pytest.fixture
def scene(tmp_path):
    """A floor with four rays a face, which asks for a lightmap beside the file."""
    floor("Floor")
    group = bpy.context.scene.obscurance
    group.rays, group.threads, group.image_path = 4, 1, "//map.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path / "scene.blend"


def run(*arguments):
    """Exit status, 2 for wrong usage."""
    try:
        return batch.main(["bake", *map(str, arguments)])
    except SystemExit as stop:
        return stop.code


def state(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# --------------------------------------------------------------------------------------------------- what is replaced


@pytest.mark.skipif(sys.platform == "win32", reason="pipes are those of Unix")
@pytest.mark.parametrize("option", ["--output", "--export", "--frame-cache", "--image"])
def test_a_pipe_is_never_replaced(scene, tmp_path, capsys, option):
    """Said before anything is baked."""
    pipe = tmp_path / {"--export": "x.usdc", "--image": "x.exr"}.get(option, "x")
    os.mkfifo(pipe)
    before = state(tmp_path)
    more = LIGHTMAP if option == "--image" else () if option == "--output" else ("--frames", "1-2")
    assert run(scene, option, pipe, *more) == 1
    assert f"'{pipe}' is a pipe" in capsys.readouterr().err
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert state(tmp_path) == before


@pytest.mark.skipif(sys.platform == "win32", reason="pipes are those of Unix")
def test_a_report_goes_into_a_pipe(scene, tmp_path):
    """Which stays one."""
    pipe, told = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: told.append(pipe.read_text()))
    reader.start()
    assert run(scene, "--report", pipe, "--output", tmp_path / "out.blend") == 0
    reader.join()
    assert json.loads(told[0])["files"][0]["written"] == [str(tmp_path / "out.blend")]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_write_protected_file_is_not_replaced(scene, tmp_path, capsys):
    scene.chmod(0o444)
    before = state(tmp_path)
    assert run(scene) == 1
    assert "is write-protected: change its permissions" in capsys.readouterr().err
    assert state(tmp_path) == before


# ------------------------------------------------------------------------------------------------------ one file twice


@pytest.mark.parametrize(
    "arguments",
    [
        ("--report", "scene.blend"),
        ("--output", "out.blend", "--report", "out.blend"),
        ("--output", "out.blend", "--report", "link.blend"),
        ("--report", "hard.blend"),
        ("--frames", "1-2", "--export", "x.usdc", "--report", "x.usdc"),
        ("--frames", "1-2", "--export", "x.usdc", "--output", "x.usdc"),
        ("--frames", "1-2", "--output", "out.blend", "--frame-cache", "out.blend"),
        ("--frames", "1-2", "--frame-cache", "cache", "--report", "cache/report.json"),
        (*LIGHTMAP, "--image", "x.exr", "--report", "x.exr"),
        ("other.blend", "--output-dir", "folder", "--report", "folder/other.blend"),
        ("folder/third.blend", "--output-dir", ".", "--report", "third.blend"),
        ("scene.other", "--frames", "1-2"),
    ],
)
def test_options_that_name_one_file_are_wrong_usage(scene, tmp_path, monkeypatch, capsys, arguments):
    """By another path, a link or a hard link, too; nothing is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link.blend").symlink_to("out.blend")
    os.link(scene, tmp_path / "hard.blend")
    for folder in ("folder", "cache"):
        (tmp_path / folder).mkdir()
    before = state(tmp_path)
    assert run(scene, *arguments) == 2
    told = capsys.readouterr().err
    assert any(words in told for words in ("names the same file as", "lies in", "is the folder of"))
    assert state(tmp_path) == before


def test_an_output_may_not_be_another_scene(scene, tmp_path, capsys):
    """The folder for the outputs holds a file that is baked as well."""
    (tmp_path / "folder").mkdir()
    other = tmp_path / "folder" / "scene.blend"
    other.write_bytes(scene.read_bytes())
    second = tmp_path / "folder" / "second.blend"
    second.write_bytes(scene.read_bytes())
    before = other.read_bytes()
    assert run(scene, second, "--output-dir", tmp_path / "folder", "--report", other) == 2
    assert "names the same file as" in capsys.readouterr().err
    assert other.read_bytes() == before


@pytest.mark.parametrize("report", ["map.exr", "map.1001.exr"])
def test_a_report_in_the_place_of_the_image_of_the_file_is_refused(scene, tmp_path, capsys, report):
    """Also of a tile that the lightmap may come to have; nothing is baked, and the report is kept."""
    assert run(scene, *LIGHTMAP, "--report", tmp_path / report) == 1
    assert "names the same file as --report" in capsys.readouterr().err
    assert FACE_LAYER.encode() not in scene.read_bytes()
    assert "error" in json.loads((tmp_path / report).read_text())["files"][0]


def test_images_of_two_scenes_in_one_file_are_refused(scene, tmp_path, capsys):
    """The first one is kept; numbered names are not taken for tiles of each other."""
    names = [tmp_path / f"shot.{number}.blend" for number in (1001, 1002, 1003)]
    for path, image in zip(names, ("//map.1001.exr", "//map.1002.exr", "//map.1001.exr"), strict=True):
        bpy.context.scene.obscurance.image_path = image
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert run(*names, *LIGHTMAP, "--report", tmp_path / "report.json") == 1
    first, second, third = json.loads((tmp_path / "report.json").read_text())["files"]
    assert first["written"] == [str(tmp_path / "map.1001.exr"), str(names[0])]
    assert second["written"] == [str(tmp_path / "map.1002.exr"), str(names[1])]
    assert third["written"] == []
    assert "names the same file as the image of" in third["error"]


# ------------------------------------------------------------------------------------------- what the .blend may choose


@pytest.mark.parametrize("link", [False, True])
def test_a_file_chooses_no_place_outside_of_the_outputs_folder(scene, tmp_path, capsys, link):
    """Not through a link either. With an option it does, and what is given by option goes anywhere."""
    out = tmp_path / "out"
    out.mkdir()
    group = bpy.context.scene.obscurance
    if link:
        (out / "maps").symlink_to(tmp_path)
        group.image_path = str(out / "maps" / "map.exr")
        bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    arguments = (scene, *LIGHTMAP, "--output", out / "out.blend")
    assert run(*arguments) == 1
    assert f"not below the output's folder '{out}': give --image PATH, or --trust-paths" in capsys.readouterr().err
    assert not (tmp_path / "map.exr").exists()
    assert run(*arguments, "--image", tmp_path / "given.exr") == 0
    assert (tmp_path / "given.exr").is_file()
    assert run(*arguments, "--trust-paths") == 0
    assert (tmp_path / "map.exr").is_file()


def test_what_was_written_is_listed(scene, tmp_path, capsys):
    """On the terminal and in the report."""
    report, image = tmp_path / "report.json", tmp_path / "map.exr"
    assert run(scene, *LIGHTMAP, "--report", report) == 0
    assert json.loads(report.read_text())["files"][0]["written"] == [str(image), str(scene)]
    assert f"{scene}: written: {image}, {scene}" in capsys.readouterr().out


# ----------------------------------------------------------------------------------------------------------- full disks


@contextlib.contextmanager
def small_disk(folder, size):
    """A disk of so many bytes, which only root can make."""
    folder.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("this needs the right to mount a disk")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can make a small disk")
@pytest.mark.parametrize(
    ("name", "size", "arguments"),
    [
        ("out.blend", "50k", ("--output",)),
        ("out.usdc", "8k", ("--frames", "1-2", "--export")),
        ("out.usda", "8k", ("--frames", "1-2", "--export")),
        ("out.exr", "8k", (*LIGHTMAP, "--image")),
        ("out.json", "8k", ("--report",)),
    ],
)
def test_a_full_disk_costs_no_good_file(scene, tmp_path, capsys, name, size, arguments):
    """Blender may report success. The disk is the message, and nothing else is left there."""
    if name.endswith(".exr"):
        arguments = ("--image-format", "EXR_FULL", *arguments)
    with small_disk(tmp_path / "disk", size):
        target = tmp_path / "disk" / name
        target.write_text("good")
        assert run(scene, *arguments, target) == 1
        told = capsys.readouterr().err
        assert "--export" in arguments or (str(target) in told and "make room on" in told)  # exporters have own words
        assert state(tmp_path / "disk") == {name: b"good"}


def test_too_little_memory_is_said(scene, monkeypatch, capsys):
    """Python's error has no words."""

    def fail(*_arguments, **_keywords):
        raise MemoryError

    monkeypatch.setattr("obscurance_addon.core.order.bake_order.bake_obscurances", fail)
    assert run(scene) == 1
    assert "there is too little memory (MemoryError): bake fewer" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="pipes are those of Unix")
def test_the_scene_must_be_a_plain_file(tmp_path, capsys):
    """A pipe would be waited for without end."""
    os.mkfifo(tmp_path / "pipe.blend")
    (tmp_path / "nowhere.blend").symlink_to(tmp_path / "missing")
    (tmp_path / "loop.blend").symlink_to(tmp_path / "loop.blend")
    assert run(tmp_path / "pipe.blend", tmp_path / "nowhere.blend", tmp_path / "loop.blend") == 1
    told = capsys.readouterr().err.splitlines()
    assert [line.rpartition("blend: ")[2] for line in told] == [
        "this is no file: name a .blend",
        "this link leads nowhere: name a .blend",
        "this link leads nowhere: name a .blend",
    ]
