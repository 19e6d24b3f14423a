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
