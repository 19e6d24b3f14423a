"""What is in a zip, and what is refused."""

import re
import shutil
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.extension.conftest import HERE, ROOT
from tools import build_extension
from tools.build_extension import HASHES, MANIFEST, PACKAGE, build, wheels_for

manifest = tomllib.loads(MANIFEST.read_text(encoding="utf-8"))
LISTED = [Path(wheel).name for wheel in manifest["wheels"]]


def test_every_wheel_of_the_manifest_goes_into_one_zip():
    """For each platform embreex and xatlas, each for the Pythons of Blender 4.2 to 5.0 and of 5.1 and later.

    One wheel of uvunwrap serves both.
    """
    parts = {platform: wheels_for(platform, LISTED) for platform in manifest["platforms"]}
    assert sorted(name for names in parts.values() for name in names) == sorted(LISTED)
    for names in parts.values():
        kinds = sorted(tuple(name.split("-")[i] for i in (0, 2, 3)) for name in names)
        both = [(library, python, python) for library in ("embreex", "xatlas") for python in ("cp311", "cp313")]
        assert kinds == sorted([*both, ("uvunwrap", "cp311", "abi3")])


def test_every_wheel_has_a_hash():
    """One for each, and none besides."""
    lines = [line.split() for line in HASHES.read_text().splitlines()]
    assert [name for _hash, name in lines] == LISTED
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest, _name in lines)


def test_development_uses_the_same_libraries():
    """So that what is tested is what ships."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pinned = dict(text.split("==") for text in project["dependencies"] if "==" in text)
    shipped = {name.split("-")[0]: name.split("-")[1] for name in LISTED}
    assert pinned == shipped


def test_contents(zipped):
    """The package as it stands, manifest and licences, the wheels that the manifest lists, and nothing else."""
    with zipfile.ZipFile(zipped) as archive:
        names = set(archive.namelist())
        inside = tomllib.loads(archive.read("blender_manifest.toml").decode())
        assert archive.testzip() is None
    package = {p.relative_to(PACKAGE).as_posix() for p in PACKAGE.rglob("*") if p.is_file() and p.suffix != ".pyc"}
    wheels = {wheel.removeprefix("./") for wheel in inside["wheels"]}
    licences = {f"LICENSES/{p.name}" for p in (ROOT / "LICENSES").iterdir()}
    assert names == package | wheels | licences | {"LICENSE", "blender_manifest.toml"}
    assert {Path(wheel).name for wheel in wheels} == set(wheels_for(HERE, LISTED))
    assert inside["platforms"] == [HERE]
    assert {**manifest, "platforms": 0, "wheels": 0} == {**inside, "platforms": 0, "wheels": 0}
    assert zipped.name == f"obscurance_addon-{manifest['version']}-{HERE.replace('-', '_')}.zip"


def test_a_wheel_that_was_changed_is_refused(tmp_path, monkeypatch):
    """One byte more, and nothing is built."""
    name = wheels_for(HERE, LISTED)[-1]
    for wheel in wheels_for(HERE, LISTED):
        shutil.copy(build_extension.CACHE / wheel, tmp_path)
    with (tmp_path / name).open("ab") as changed:
        changed.write(b"x")
    monkeypatch.setattr(build_extension, "CACHE", tmp_path)
    with pytest.raises(SystemExit, match=f"{re.escape(name)} is not the file.*delete it and try again"):
        build([HERE], tmp_path / "out")
    assert not list(tmp_path.glob("out/*"))


def test_a_wheel_without_a_hash_is_refused(tmp_path, monkeypatch):
    """As when somebody adds one to the manifest only."""
    empty = tmp_path / "wheels.sha256"
    empty.write_text("")
    monkeypatch.setattr(build_extension, "HASHES", empty)
    with pytest.raises(SystemExit, match="has no hash of embreex"):
        build([HERE], tmp_path / "out")


def test_what_blender_would_refuse_is_not_built(tmp_path, monkeypatch):
    """A tagline that ends in a full stop."""
    wrong = tmp_path / "blender_manifest.toml"
    wrong.write_text(re.sub(r'tagline = "(.*)"', r'tagline = "\1."', MANIFEST.read_text()))
    monkeypatch.setattr(build_extension, "MANIFEST", wrong)
    with pytest.raises(SystemExit, match="refuses to build"):
        build([HERE], tmp_path / "out")
    assert not list(tmp_path.glob("out/*"))


def test_an_unknown_platform_is_named(tmp_path):
    with pytest.raises(SystemExit, match="no platform 'amiga': choose from"):
        build(["amiga"], tmp_path)
