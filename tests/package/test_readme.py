"""The README's Python examples run as printed."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from obscurance_addon import core

ROOT = Path(core.__file__).parents[2]
EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
_PATIENCE_S = 120.0


def run(code, folder):
    """Run code in a process of its own; returns what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "BLENDER_USER_RESOURCES": str(folder), "PATH": ""},
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def example(word):
    """The one that holds this word."""
    (found,) = (code for code in EXAMPLES if word in code)
    return found


def test_every_example_is_tested():
    assert len(EXAMPLES) == 2


def test_with_the_bpy_module(tmp_path):
    """It saves a file with the attribute of the second bake, and the process ends by itself."""
    bpy = pytest.importorskip("bpy")
    shutil.copy(ROOT / "sample_blends" / "cornell_box.blend", tmp_path / "SCENE.blend")
    code = example("import bpy")
    if bpy.app.version < (4, 5):
        code += "import os; os._exit(0)"  # bpy 4.2 crashes at a normal exit, whatever is unregistered
    run(code, tmp_path)
    with bpy.data.libraries.load(str(tmp_path / "OUT.blend")) as (_source, loaded):
        loaded.meshes = list(_source.meshes)
    try:
        assert [mesh.name for mesh in loaded.meshes if "Obscurance" in mesh.attributes]
    finally:
        for mesh in loaded.meshes:
            bpy.data.meshes.remove(mesh)


def test_without_blender(tmp_path):
    """One row for each of the three triangles: those of the floor are darker than open ones and take the wall's red."""
    code = "import sys; sys.modules['bpy'] = None\n" + example("obscurance_addon.core")
    white = np.array(re.findall(r"[\d.]+", run(code, tmp_path)), float).reshape(3, 3)
    assert (white < 1.2).all()
    assert (white[:2, 1] < 1.0).all()
    assert (white[:2, 0] > white[:2, 1]).all()
