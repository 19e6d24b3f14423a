"""What the extensions platform asks of an add-on, as far as a test can tell."""

import ast
import re
import tomllib

import pytest

from tests.extension.conftest import ROOT
from tests.extension.test_installed import BAKE, CORNELL
from tools.build_extension import MANIFEST, PACKAGE

SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if "presets" not in path.relative_to(PACKAGE).parts[:1])
# Where nothing else works; each has a comment that says why.
TOUCHES_SYS = {"__init__.py": "Reload Scripts", "core/process/start.py": "as the import system does"}
FOR_SCRIPTS = {"__main__.py"}  # runs without Blender's window


@pytest.fixture(scope="module")
def manifest():
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))


def names(path):
    """The path below the package, and its text."""
    return path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")


def test_short_texts_keep_their_form(manifest):
    """At most 64 characters, without a full stop."""
    for text in (manifest["tagline"], *manifest["permissions"].values()):
        assert len(text) <= 64
        assert text[-1].isalnum()


def test_all_that_is_bundled_has_its_owner(manifest):
    owners = " ".join(manifest["copyright"])
    bundled = {re.match(r"\./wheels/([a-z]+)-", wheel)[1] for wheel in manifest["wheels"]}
    assert bundled == {"embreex", "xatlas"}
    for library in ("Embree", "oneTBB", *bundled):
        assert library in owners
    assert all(re.match(r"\d{4}(-\d{4})? \S", owner) for owner in manifest["copyright"])
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").lstrip().startswith("GNU GENERAL PUBLIC LICENSE")


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_each_module_leaves_python_alone(path):
    """It tells nobody to run pip, and changes neither sys.modules nor sys.path but where that is explained."""
    name, text = names(path)
    if name not in FOR_SCRIPTS:
        assert "pip install" not in text
    changed = []
    for node in ast.walk(ast.parse(text)):
        targets = node.targets if isinstance(node, ast.Assign | ast.Delete) else []
        changed += [ast.unparse(target) for target in targets if "sys.modules" in ast.unparse(target)]
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith(("sys.path.", "sys.modules.")):
            changed.append(ast.unparse(node))
        if isinstance(node, ast.Assign | ast.AugAssign) and "sys.path" in ast.unparse(node).partition("=")[0]:
            changed.append(ast.unparse(node))
    assert bool(changed) == (name in TOUCHES_SYS), changed
    assert TOUCHES_SYS.get(name, "") in text


def test_a_bake_writes_nothing_beside_the_add_on(installed):
    """Neither into its folder nor elsewhere in the user's, but what Python and Blender keep there themselves."""

    def files():
        return {
            path: path.stat().st_mtime_ns
            for path in installed.user_folder.rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        }

    before = files()
    installed.run(
        "enable()\n" + BAKE + "bpy.context.scene.obscurance.target = 'LIGHTMAP'\nbpy.ops.obscurance.bake()", CORNELL
    )
    assert files() == before
