"""Plays every case of `cases/`, and uses the installed command without a window."""

import importlib
import inspect
import json
import pkgutil
import shutil

import pytest

from tests.window import cases
from tests.window.debian_blender import PICTURES, ROOT

CASES = [
    (module.name, name)
    for module in pkgutil.iter_modules(cases.__path__)
    for name, function in vars(importlib.import_module(f"{cases.__name__}.{module.name}")).items()
    if inspect.isgeneratorfunction(function) and not name.startswith("_")
]


@pytest.fixture(scope="session", autouse=True)
def only_new_pictures():
    """Whoever looks at the pictures sees those of this run."""
    shutil.rmtree(PICTURES, ignore_errors=True)


@pytest.mark.parametrize(("module", "case"), CASES)
def test_case(blender, module, case):
    """The case goes through, and Blender ends without a crash or a traceback."""
    played = blender.play(module, case)
    assert "CASE PASSED" in played.stdout
    assert played.returncode == 0
    assert "Traceback" not in played.stdout + played.stderr


def test_command_line(blender):
    """`blender --command obscurance` bakes, and its exit status is that of the bake."""
    shutil.copy(ROOT / "sample_blends" / "cornell_box.blend", blender.run_dir)
    command = ("--command", "obscurance", "bake", "/mnt/run/cornell_box.blend", "--rays", "16")
    done = blender.run(*command, "--output", "/mnt/run/out.blend", "--report", "/mnt/run/report.json")
    assert done.returncode == 0, done.stdout + done.stderr
    (entry,) = json.loads((blender.run_dir / "report.json").read_text())["files"]
    assert entry["patches"] == 1744
    assert (blender.run_dir / "out.blend").stat().st_size > 0

    missing = blender.run("--command", "obscurance", "bake", "/mnt/run/nowhere.blend")
    assert missing.returncode == 1
    assert "no such file" in missing.stderr


EXPORT = """
import importlib, os, pathlib, sys
addon = next(name for name in sys.modules if name.endswith(".obscurance_addon"))
animation = importlib.import_module(addon + ".blender.animation")
path = pathlib.Path("/mnt/run/moving.abc")
try:
    animation.export_in_process(pathlib.Path("/mnt/run/moving.blend"), pathlib.Path("/mnt/run/moving_frames"), path)
    said = "exported"
except Exception as error:
    said = str(error)
print("EXPORT: " + said)
"""


def test_an_export_in_a_process_of_its_own(blender):
    """The other Blender has the extension, opens the file, and writes it, or says that it was built without Alembic."""
    shutil.copy(ROOT / "sample_blends" / "cornell_box.blend", blender.run_dir)
    command = ("--command", "obscurance", "bake", "/mnt/run/cornell_box.blend", "--rays", "1")
    done = blender.run(*command, "--frames", "1-2", "--output", "/mnt/run/moving.blend")
    assert done.returncode == 0, done.stdout + done.stderr
    done = blender.run("--background", "--python-expr", EXPORT)
    (said,) = (line for line in done.stdout.splitlines() if line.startswith("EXPORT: "))
    assert said in {
        "EXPORT: exported",
        "EXPORT: this Blender was built without Alembic, so it cannot write 'moving.abc': use another",
    }
