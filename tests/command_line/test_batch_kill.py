"""A command line killed at any moment leaves the old file or the new one, whole."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest

from obscurance_addon.command_line import batch
from tests.blender.helpers import FACE_LAYER, floor

pytestmark = [
    pytest.mark.usefixtures("empty_scene"),
    pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL"),
]
ROOT = Path(__file__).parents[2]
LEAVES = {"saving", "saved", "before renaming", "after renaming"}  # moments that leave a lock, or more

# Runs the command line with one of its steps replaced by death, before or after doing what the step does.
DRIVER = """
import os, signal, sys
import bpy
import obscurance_addon
from obscurance_addon.command_line import batch
from obscurance_addon.blender.jobs.job import BakeJob

def die(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)

def dies_before(owner, name):
    setattr(owner, name, die)

def dies_after(owner, name):
    step = getattr(owner, name)
    def last(*arguments, **keywords):
        step(*arguments, **keywords)
        die()
    setattr(owner, name, last)

obscurance_addon.register()
moment, scene = sys.argv[1:]
if moment == "loaded":
    dies_before(BakeJob, "__init__")
elif moment == "computing":
    dies_after(BakeJob, "__init__")
elif moment == "baked":
    dies_after(BakeJob, "commit")
elif moment == "saving":
    bpy.app.handlers.load_post.append(bpy.app.handlers.persistent(lambda *_: bpy.app.handlers.save_pre.append(die)))
elif moment == "saved":
    dies_before(os, "fsync")
elif moment == "before renaming":
    dies_before(os, "replace")
elif moment == "after renaming":
    dies_after(os, "replace")
os._exit(batch.main(["bake", scene, "--quiet"]))
"""


@pytest.fixture
def scene(tmp_path):
    """A floor of 400 faces below a ceiling, 8 rays each."""
    floor("Ceiling", z=0.2)
    floor(n=20)
    bpy.context.scene.obscurance.rays = 8
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def is_new(path):
    """Whether the file, which opens, has the result."""
    assert bpy.ops.wm.open_mainfile(filepath=str(path)) == {"FINISHED"}
    mesh = bpy.data.objects["Floor"].data
    assert len(mesh.polygons) == 400
    return FACE_LAYER in mesh.attributes


@pytest.mark.parametrize(
    ("moment", "new"),
    [
        ("loaded", False),
        ("computing", False),
        ("baked", False),
        ("saving", False),
        ("saved", False),
        ("before renaming", False),
        ("after renaming", True),
    ],
)
def test_a_kill_at_this_moment_leaves_the_old_or_the_new_file(scene, moment, new):
    """The old one is the same to the byte; a later run succeeds, and removes what this one left."""
    before = scene.read_bytes()
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, moment, str(scene)], cwd=ROOT, capture_output=True, timeout=120, check=False
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert (scene.read_bytes() == before) == (not new)
    assert is_new(scene) == new
    assert (len(list(scene.parent.iterdir())) > 1) == (moment in LEAVES)
    assert batch.main(["bake", str(scene), "--quiet"]) == 0
    assert [path.name for path in scene.parent.iterdir()] == ["scene.blend"]


def test_a_kill_at_the_first_sign_of_writing_leaves_the_old_or_the_new_file(scene, tmp_path):
    """From outside, as soon as any other file appears beside the scene, or the scene changes."""
    before = scene.read_bytes()
    names = set(tmp_path.iterdir())
    process = subprocess.Popen([sys.executable, "-c", DRIVER, "never", str(scene)], cwd=ROOT, stdout=subprocess.DEVNULL)
    try:
        changed = scene.stat().st_mtime_ns
        while process.poll() is None and set(tmp_path.iterdir()) == names and scene.stat().st_mtime_ns == changed:
            time.sleep(0.0002)
    finally:
        process.kill()
        process.wait()
    assert scene.read_bytes() == before or is_new(scene)
    is_new(scene)


def test_without_a_kill_the_file_is_new(scene):
    """The driver of these tests does bake."""
    done = subprocess.run([sys.executable, "-c", DRIVER, "never", str(scene)], cwd=ROOT, timeout=120, check=False)
    assert done.returncode == 0
    assert is_new(scene)
    assert [path.name for path in scene.parent.iterdir()] == ["scene.blend"]
