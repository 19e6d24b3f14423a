"""The tool that bakes every .blend of a folder: outcomes, tables, and inputs that stay as they are."""

import argparse

import bpy
import pytest

from tests.blender.helpers import floor
from tools.bake_folder import OUTCOMES, bake, counts, tables

pytestmark = pytest.mark.usefixtures("empty_scene")


def options(folder, seconds=120.0):
    return argparse.Namespace(folder=folder, rays=4, size=256, seconds=seconds)


def entry(outcome, target="FACE", message=None, notes=(), said=""):
    status = {"refused": 1, "timed out": None, "crashed": -11}.get(outcome, 0)
    return {
        "file": "a.blend",
        "target": target,
        "outcome": outcome,
        "seconds": 1.0,
        "status": status,
        "message": message,
        "notes": list(notes),
        "said": said,
    }


def test_a_bake_and_a_refusal_leave_the_folder_as_it_was(tmp_path):
    """A lightmap of a file whose settings ask for an image beside it; then nothing to bake, with its sentence."""
    scene = tmp_path / "scene.blend"
    floor()
    bpy.context.scene.obscurance.image_path = "//lightmap.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    before = scene.read_bytes()
    told = bake(scene, "LIGHTMAP", options(tmp_path))
    assert (told["file"], told["outcome"], told["message"], told["said"]) == ("scene.blend", "baked", None, "")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.blend"]
    assert scene.read_bytes() == before
    bpy.data.objects["Floor"].hide_render = True
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    told = bake(scene, "FACE", options(tmp_path))
    assert told["outcome"] == "refused"
    assert "'Floor'" in told["message"]


def test_the_time_limit_ends_a_bake(tmp_path):
    scene = tmp_path / "scene.blend"
    floor()
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert bake(scene, "FACE", options(tmp_path, seconds=0.01))["outcome"] == "timed out"


def test_tables_count_outcomes_and_group_sentences():
    """Sentences that differ in names and numbers only are one line."""
    entries = [
        entry("baked"),
        entry("refused", message="there is nothing to bake: 'A'"),
        entry("refused", "POINT", message="there is nothing to bake: 'B'"),
        entry("baked with notes", "CORNER", notes=["left out: 'A' and 3 others", "left out: 'B' and 12 others"]),
        entry("crashed", "LIGHTMAP", said="Traceback\nKeyError: 3"),
    ]
    table = counts(entries)
    assert table[0] == "| target | " + " | ".join(OUTCOMES) + " |"
    assert table[2] == "| FACE | 1 | 0 | 1 | 0 | 0 |"
    text = tables(entries, "command")
    assert "| 2 | there is nothing to bake: 'A' | a.blend (FACE) |" in text
    assert "| 2 | left out: 'A' and 3 others | a.blend (CORNER) |" in text
    assert "| 1 | KeyError: 3 | a.blend (LIGHTMAP) |" in text
