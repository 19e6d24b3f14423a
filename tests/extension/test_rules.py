"""What the extensions platform and Blender's manual ask of an add-on, as far as it can be read or run."""

import ast
import re
import tomllib

import pytest

from tests.extension.conftest import ROOT
from tools.build_extension import MANIFEST, PACKAGE

manifest = tomllib.loads(MANIFEST.read_text(encoding="utf-8"))
SOURCES = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}

# The command of the bpy module, which Blender never runs.
OUTSIDE_OF_BLENDER = {"__main__.py"}
INTERPRETER_STATE = {
    ("__init__.py", "modules"),  # forgets its own modules at Reload Scripts
    ("blender/animation/export_process.py", "path"),  # reads it, for another process outside of Blender
    ("core/process/child.py", "path"),  # reads it, for the child process
    ("core/process/start.py", "modules"),  # of the child process, which imports the add-on from its folder
}
# What needs the network; the manifest does not ask for that permission.
NETWORK = {"aiohttp", "ftplib", "http", "httpx", "pip", "requests", "smtplib", "socket", "ssl", "urllib", "urllib3"}
# https://docs.blender.org/manual/en/latest/advanced/extensions/licenses.html
ACCEPTED = {"GPL-2.0-or-later", "GPL-3.0-or-later", "LGPL-2.1-or-later", "LGPL-3.0-or-later", "BSD-1-Clause"}
ACCEPTED |= {"BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "MIT", "MIT-0", "MPL-2.0", "Pixar", "Zlib"}

# All files of the installed add-on but Python's own byte code.
SNAPSHOT = """
import hashlib
from pathlib import Path
def snapshot():
    folder = Path(sys.modules[MODULE].__file__).parent
    return {str(p): p.is_file() and hashlib.sha256(p.read_bytes()).hexdigest()
            for p in folder.rglob("*") if "__pycache__" not in p.parts}
"""


def nodes(kind):
    """File and node for each syntax node of a kind in the add-on."""
    for name, source in SOURCES.items():
        yield from ((name, node) for node in ast.walk(ast.parse(source)) if isinstance(node, kind))


@pytest.mark.parametrize("text", [manifest["tagline"], *manifest["permissions"].values()])
def test_short_texts(text):
    assert len(text) <= 64
    assert text[-1].isalnum()


def test_the_name_is_not_blenders():
    assert "blender" not in manifest["name"].lower()
    assert "blender" not in manifest["id"]


def test_licences():
    """The add-on's own is one that the platform takes, the texts of all others come along."""
    assert {licence.removeprefix("SPDX:") for licence in manifest["license"]} <= ACCEPTED
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").lstrip().startswith("GNU GENERAL PUBLIC LICENSE")
    table = (ROOT / "LICENSES" / "README.md").read_text(encoding="utf-8")
    own, *bundled = manifest["copyright"]
    assert own.endswith(manifest["maintainer"])
    named = {re.search(r"\(([\w-]+).*, ([\w.-]+)\)$", entry).groups() for entry in bundled}
    assert {"embreex", "Embree", "oneTBB", "xatlas-python", "xatlas", "uvunwrap"} <= {
        library for library, _licence in named
    }
    for library, licence in named:
        (row,) = (line for line in table.splitlines() if line.startswith(f"| [{library}]"))
        assert row.endswith(f"| {licence} |")
    texts = {path.stem for path in (ROOT / "LICENSES").glob("*.txt")}
    assert texts == {licence for _library, licence in named}


@pytest.mark.parametrize("entry", manifest["copyright"])
def test_copyright(entry):
    """A year or two, then a name, as Blender's own tool wants it."""
    assert re.fullmatch(r"\d{4}(-\d{4})? \S.*", entry)


def test_every_bundled_library_is_credited():
    libraries = {wheel.split("/")[-1].split("-")[0] for wheel in manifest["wheels"]}
    assert libraries == {"embreex", "uvunwrap", "xatlas"}, "credit what a new wheel holds in manifest and LICENSES/"


def test_no_text_tells_users_of_blender_to_run_pip():
    """Comments, docstrings and messages."""
    found = {name for name, source in SOURCES.items() if re.search(r"\bpip\b", source)}
    assert found <= OUTSIDE_OF_BLENDER


def test_the_interpreter_is_left_alone():
    """sys.modules and sys.path only where they are listed here, with the reason beside them."""
    used = {
        (name, node.attr)
        for name, node in nodes(ast.Attribute)
        if isinstance(node.value, ast.Name) and node.value.id == "sys" and node.attr in {"modules", "path"}
    }
    assert used <= INTERPRETER_STATE
    assert not [name for name, node in nodes(ast.ImportFrom) if node.module == "sys"]
    assert not re.search(r"sys\.path\.(append|insert|extend|remove)|sys\.path\s*\+?=[^=]", "\n".join(SOURCES.values()))


def test_no_network():
    assert "network" not in manifest["permissions"]
    imported = {(name, alias.name.split(".")[0]) for name, node in nodes(ast.Import) for alias in node.names}
    imported |= {(name, (node.module or "").split(".")[0]) for name, node in nodes(ast.ImportFrom) if not node.level}
    assert not [entry for entry in imported if entry[1] in NETWORK]


def test_the_manifest_takes_the_place_of_bl_info():
    assert not [name for name, source in SOURCES.items() if "bl_info" in source]


def test_imports_of_the_add_on_are_relative():
    """Blender gives it another name than this checkout does."""
    absolute = [
        name for name, node in nodes(ast.ImportFrom) if not node.level and node.module.startswith(manifest["id"])
    ]
    absolute += [name for name, node in nodes(ast.Import) if any(a.name.startswith(manifest["id"]) for a in node.names)]
    assert not absolute


def test_nothing_is_written_beside_the_add_on(installed):
    """Neither by a bake of an attribute nor by one of a lightmap, with the process that unwraps."""
    installed.run(
        SNAPSHOT
        + """
enable()
before = snapshot()
assert len(before) > 100
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
bpy.ops.object.select_all(action="SELECT")
settings = bpy.context.scene.obscurance
settings.rays = 16
assert bpy.ops.obscurance.bake() == {"FINISHED"}
settings.target, settings.lightmap_size = "LIGHTMAP", 256
assert bpy.ops.obscurance.bake() == {"FINISHED"}
assert snapshot() == before
""",
        ROOT / "sample_blends" / "cornell_box.blend",
    )
