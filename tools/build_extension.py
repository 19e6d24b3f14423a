"""Builds the installable zips, one for each platform, and has Blender's own tool validate them.

    python tools/build_extension.py [--platform NAME ...] [--output-dir DIR] [--wheels DIR]

`blender_manifest.toml` says which platforms and wheels there are, `wheels.sha256` what the wheels must be. A Blender
whose Python has none of them (a distribution's own build) is served by `--wheels`: those of that folder go in instead.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "obscurance_addon"
MANIFEST = ROOT / "blender_manifest.toml"
HASHES = ROOT / "tools" / "wheels.sha256"
CACHE = ROOT / "build" / "wheels"
OUTPUT = ROOT / "build" / "extension"

# How the platform tags of wheels begin and end, for each of Blender's platforms.
_TAGS = {
    "linux-x64": ("manylinux", "x86_64"),
    "windows-x64": ("win", "amd64"),
    "macos-arm64": ("macosx", "arm64"),
    "macos-x64": ("macosx", "x86_64"),
}


def build(platforms: list[str] | None = None, output_dir: Path = OUTPUT, wheels: Path | None = None) -> list[Path]:
    """Build and validate zips.

    Parameters
    ----------
    platforms : list of str, optional
        Names as in the manifest; all of them by default.
    output_dir : Path
        Zips of the same names there are replaced, once all new ones are valid.
    wheels : Path, optional
        Folder whose wheels go in instead of the listed ones.

    Returns
    -------
    list of Path
        The zips, in the order of `platforms`.

    Raises
    ------
    SystemExit
        When a wheel cannot be had or is not what the list of hashes says, or a zip is not valid.
    """
    manifest = tomllib.loads(MANIFEST.read_text(encoding="utf-8"))
    output_dir.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = []
        for platform in platforms or manifest["platforms"]:
            if platform not in manifest["platforms"]:
                raise SystemExit(f"the manifest has no platform '{platform}': choose from {manifest['platforms']}")
            if wheels:
                contents = sorted(wheels.glob("*.whl"))
            else:
                names = [Path(wheel).name for wheel in manifest["wheels"]]
                contents = [_fetched(name) for name in wheels_for(platform, names)]
            stage = _staged(Path(folder) / platform, platform, contents)
            zipped = Path(folder) / f"{manifest['id']}-{manifest['version']}-{platform.replace('-', '_')}.zip"
            blender_tool("build", "--valid-tags=", "--source-dir", stage, "--output-filepath", zipped)
            blender_tool("validate", zipped)
            made.append(zipped)
        return [Path(shutil.copy(zipped, output_dir)) for zipped in made]


def blender_tool(*arguments: object) -> str:
    """Run Blender's own extension tool, which the bpy module carries; returns its output, or exits with it."""
    home = Path(importlib.util.find_spec("bpy").submodule_search_locations[0])
    script = next(home.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    run = subprocess.run([sys.executable, script, *map(str, arguments)], capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"Blender's extension tool refuses to {arguments[0]}:\n{run.stdout}{run.stderr}")
    return run.stdout


def wheels_for(platform: str, names: list[str]) -> list[str]:
    """Those of these wheels, given by file name, that are made for one of the manifest's platforms."""
    start, end = _TAGS[platform]
    tags = {name: name.removesuffix(".whl").split("-")[-1] for name in names}
    return [name for name in names if tags[name].startswith(start) and tags[name].endswith(end)]


def _staged(folder: Path, platform: str, wheels: list[Path]) -> Path:
    """A copy of all that goes into one zip, with the manifest at the package's side as Blender wants it."""
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "LICENSE", folder)
    shutil.copytree(ROOT / "LICENSES", folder / "LICENSES")
    (folder / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy(wheel, folder / "wheels")
    text = MANIFEST.read_text(encoding="utf-8")
    for key, values in (("platforms", [platform]), ("wheels", [f"./wheels/{wheel.name}" for wheel in wheels])):
        listed = "".join(f'  "{value}",\n' for value in values)
        text, replaced = re.subn(rf"^{key} = \[[^\]]*\]", f"{key} = [\n{listed}]", text, flags=re.MULTILINE)
        if replaced != 1:
            raise SystemExit(f"{MANIFEST.name} must have one list named '{key}'")
    (folder / MANIFEST.name).write_text(text, encoding="utf-8")
    return folder


def _fetched(name: str) -> Path:
    """The wheel of this file name from the package index, kept for the next time and checked every time."""
    path = CACHE / name
    if not path.is_file():
        package, version, python, abi, tags = name.removesuffix(".whl").split("-")
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
        command += ["--only-binary=:all:", f"--python-version={python.removeprefix('cp')}", f"--abi={abi}"]
        command += [f"--platform={tag}" for tag in tags.split(".")]
        CACHE.mkdir(parents=True, exist_ok=True)
        subprocess.run([*command, f"--dest={CACHE}", f"{package}=={version}"], check=False)
        if not path.is_file():
            raise SystemExit(f"{name} could not be downloaded: is the package index reachable?")
    expected = dict(line.split()[::-1] for line in HASHES.read_text(encoding="utf-8").splitlines())
    if name not in expected:
        raise SystemExit(f"{HASHES.name} has no hash of {name}: add it")
    if hashlib.sha256(path.read_bytes()).hexdigest() != expected[name]:
        raise SystemExit(f"{path} is not the file that {HASHES.name} names: delete it and try again")
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--platform", action="append", metavar="NAME", help="as in the manifest; default: all of them")
    parser.add_argument("--output-dir", type=Path, default=OUTPUT)
    parser.add_argument("--wheels", type=Path, metavar="DIR", help="folder of wheels to use instead of the listed ones")
    options = parser.parse_args()
    for built in build(options.platform, options.output_dir, options.wheels):
        print(f"{built} ({built.stat().st_size / 1e6:.1f} MB)")
