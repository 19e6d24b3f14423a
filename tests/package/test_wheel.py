"""The wheel: what is in it, and that it works outside of the checkout."""

import configparser
import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "obscurance_addon"
VERSION = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
_PATIENCE_S = 120.0

# Runs the command without Blender's module, which the test's own Python may have.
WITHOUT_BPY = """
import sys
from importlib.metadata import entry_points
sys.modules["bpy"] = None
(command,) = entry_points(group="console_scripts", name="obscurance")
command.load()()
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    done = subprocess.run(
        [*PIP, "wheel", "--no-deps", "--wheel-dir", folder, ROOT], capture_output=True, text=True, timeout=_PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Runs a command of an environment in which the wheel is installed; the libraries are those of this Python."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, system_site_packages=False, with_pip=False)
    binaries = folder / ("Scripts" if os.name == "nt" else "bin")
    subprocess.run(
        [*PIP, "--python", binaries / "python", "install", "--no-deps", wheel], check=True, timeout=_PATIENCE_S
    )
    libraries = [path for path in sys.path if path.endswith("site-packages")]

    def run(command, *arguments):
        return subprocess.run(
            [binaries / command, *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(libraries)},
            capture_output=True,
            text=True,
            timeout=_PATIENCE_S,
        )

    return run


def test_contents(wheel):
    """The package as it stands, presets included, the manifest beside it, the licence, and no tests."""
    package = {p.relative_to(ROOT).as_posix() for p in PACKAGE.rglob("*") if p.is_file() and p.suffix != ".pyc"}
    assert any("presets" in name for name in package)
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
    about = f"obscurance_addon-{VERSION}.dist-info"
    metadata = {f"{about}/{name}" for name in ("METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE")}
    assert names == package | metadata | {"obscurance_addon/blender_manifest.toml"}
    assert wheel.name == f"obscurance_addon-{VERSION}-py3-none-any.whl"


def test_metadata(wheel):
    about = f"obscurance_addon-{VERSION}.dist-info"
    with zipfile.ZipFile(wheel) as archive:
        scripts = configparser.ConfigParser()
        scripts.read_string(archive.read(f"{about}/entry_points.txt").decode())
        metadata = archive.read(f"{about}/METADATA").decode().split("\n\n")[0].splitlines()
    assert dict(scripts["console_scripts"]) == {"obscurance": "obscurance_addon.__main__:main"}
    assert "License-Expression: GPL-3.0-or-later" in metadata
    needed = sorted(
        line.split(": ")[1] for line in metadata if line.startswith("Requires-Dist") and "extra" not in line
    )
    assert [text.split("==")[0] for text in needed] == ["embreex", "numpy", "uvunwrap", "xatlas"]


def test_the_command_answers_without_blender(installed):
    """Help, the version and wrong usage do not need the bpy module."""
    version = installed("obscurance", "--version")
    assert (version.returncode, version.stdout) == (0, f"{VERSION}\n")
    assert installed("obscurance", "bake", "--help").stdout.startswith("usage: obscurance bake ")
    assert installed("obscurance", "nonsense").returncode == 2


def test_a_missing_bpy_module_is_named_with_the_cure(installed):
    done = installed("python", "-c", WITHOUT_BPY, "bake", "x.blend")
    assert done.returncode == 1
    assert done.stderr == "obscurance: Blender's bpy module is not installed: pip install 'obscurance-addon[bpy]'\n"


def test_it_bakes_outside_of_the_checkout(installed, tmp_path):
    """By the console script, with the bpy module of this Python; and the library is the installed one."""
    pytest.importorskip("bpy")
    place = installed("python", "-c", "from obscurance_addon import core; print(core.__file__)").stdout
    assert not Path(place.strip()).is_relative_to(ROOT)
    scene, out = ROOT / "sample_blends" / "cornell_box.blend", tmp_path / "baked.blend"
    done = installed("obscurance", "bake", scene, "--output", out, "--rays", "16")
    assert done.returncode == 0, done.stdout + done.stderr
    assert out.stat().st_size > 0
