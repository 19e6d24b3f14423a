"""The wheel has all that the package needs, states the extension's version, and works outside of a checkout."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT], check=True
    )
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The folder that the wheel was installed to, beside the libraries of this Python."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder, wheel]
    subprocess.run(command, check=True)
    return folder


def run(installed, *arguments):
    """The command, as its entry point calls it, in a folder that is no checkout."""
    return subprocess.run(
        [installed / "bin" / "obscurance", *arguments],
        cwd=installed,
        env=os.environ | {"PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_it_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = {name for name in file.namelist() if ".dist-info/" not in name}
    files = subprocess.check_output(["git", "ls-files", "obscurance_addon"], cwd=ROOT, text=True).split()
    assert set(files) <= names
    assert all(name.startswith("obscurance_addon/") and "__pycache__" not in name for name in names)


def test_its_version_is_the_extension_s(wheel, installed):
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert wheel.name.split("-")[1] == manifest["version"]
    assert run(installed, "--version").stdout.strip() == manifest["version"]


def test_the_command_bakes(installed, tmp_path):
    done = run(
        installed,
        "bake",
        ROOT / "sample_blends" / "cornell_box.blend",
        "--rays",
        "8",
        "--output",
        tmp_path / "out.blend",
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.blend").stat().st_size > 0


def test_without_bpy_it_says_what_to_install(installed, tmp_path):
    (tmp_path / "bpy.py").write_text("raise ImportError('none here')")
    done = subprocess.run(
        [installed / "bin" / "obscurance", "bake", "scene.blend"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(installed)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "pip install 'obscurance-addon[bpy]'" in done.stderr
