"""Imports inside of the add-on go one way, and between packages through their front doors."""

import ast
import graphlib
import re
from pathlib import Path

import pytest

import obscurance_addon

TOP = "obscurance_addon"
ROOT = Path(obscurance_addon.__file__).parent

# Lowest first: a package imports from rows above its own in this list, and never from its own row's others. "core" and
# "blender" are the modules that stand directly in these folders, "" those of the add-on itself.
ORDER = (
    ("version",),
    ("core",),
    ("core.files",),
    ("core.process",),
    ("core.sampling",),
    ("core.scene",),
    ("core.shading",),
    ("core.tracing",),
    ("core.obscurance",),
    ("core.light",),
    ("core.lightmap",),
    ("core.lightmap.unwrap_worker",),
    ("core.updates",),
    ("core.order",),
    ("blender",),
    ("blender.materials",),
    ("blender.reading",),
    ("blender.writing",),
    ("blender.frame_caches",),
    ("blender.display",),
    ("blender.jobs",),
    ("blender.animation",),
    ("blender.properties",),
    ("ui", "command_line"),
    ("",),
)
LAYER = {package: number for number, row in enumerate(ORDER) for package in row}
FREE = {"version", "core", "blender"}  # their modules may be imported one by one
WORKER = "core/lightmap/unwrap_worker/"
NATIVE = {"embreex": "core/tracing/embree.py", "xatlas": WORKER, "uvunwrap": WORKER}  # who alone imports them

PATHS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix("__init__").removesuffix("."): path
    for path in sorted(ROOT.rglob("*.py"))
}
FRONT = "core"  # the front door of the whole library: it shows what is in its packages, and none of them imports it


def package_of(module: str) -> str:
    """The entry of the table that a module belongs to."""
    while module not in LAYER:
        module = module.rpartition(".")[0]
    return module


def imports_of(module: str, source: str) -> set[tuple[str, str]]:
    """(target, name) of all imports from the add-on, wherever in the file; the name is "" for whole modules."""
    own = [part for part in module.split(".") if part]
    folder = own if PATHS[module].name == "__init__.py" else own[:-1]
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            whole = [alias.name.split(".") for alias in node.names]
            found |= {(".".join(parts[1:]), "") for parts in whole if parts[0] == TOP}
        elif isinstance(node, ast.ImportFrom):
            parts = node.module.split(".") if node.module else []
            if node.level:
                parts = folder[: len(folder) - node.level + 1] + parts
            elif parts[0] == TOP:
                parts = parts[1:]
            else:
                continue
            found |= {(".".join(parts), alias.name) for alias in node.names}
    return found


def as_module(target: str, name: str) -> tuple[str, str]:
    """`from package import module` is an import of that module."""
    inner = f"{target}.{name}".strip(".")
    return (inner, "") if name and inner in PATHS else (target, name)


def public_names(package: str) -> list[str]:
    """`__all__` of a package."""
    for node in ast.parse(PATHS[package].read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return ast.literal_eval(node.value)
    return []


def fault(module: str, target: str, name: str) -> str | None:
    """What is wrong with an import, in words."""
    imported, _ = as_module(target, name)
    own, other = package_of(module), package_of(imported)
    text = f"{module or TOP} imports {name or 'all'} from {target or TOP}"
    if own == other:
        return None
    if LAYER[other] >= LAYER[own]:
        return f"{text}: {own or TOP} is not above {other or TOP}"
    if imported == FRONT:
        return f"{text}: packages do not import the front door of all"
    if other in FREE:
        return None if imported in PATHS else f"{text}: there is no such module"
    if target != other or name not in public_names(other):
        return f"{text}: it is not in __all__ of {other}"
    return None


def test_every_package_is_in_the_table():
    packages = {name for name, path in PATHS.items() if path.name == "__init__.py"}
    assert packages | {"version"} == set(LAYER)
    assert len(PATHS) > 100


@pytest.mark.parametrize("module", sorted(PATHS.keys() - {FRONT}), ids=lambda module: module or TOP)
def test_imports_go_down_and_through_front_doors(module):
    imports = imports_of(module, PATHS[module].read_text("utf-8"))
    assert [text for target, name in sorted(imports) if (text := fault(module, target, name))] == []


def test_each_package_says_what_it_is_for():
    """In three sentences: what for, what goes in, what comes out."""
    for package, path in PATHS.items():
        if path.name == "__init__.py" and package:
            text = ast.get_docstring(ast.parse(path.read_text("utf-8")))
            assert re.search(r"^In goe?s? ", text, re.MULTILINE), package
            assert re.search(r"Out comes?\s", text), package


def test_no_modules_import_each_other_in_a_circle():
    graph = {
        module: {as_module(*found)[0] for found in imports_of(module, path.read_text("utf-8"))}
        for module, path in PATHS.items()
    }
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


@pytest.mark.parametrize(("package", "only"), NATIVE.items())
def test_native_libraries_are_imported_in_one_place(package, only):
    files = {
        str(path.relative_to(ROOT).as_posix())
        for path in ROOT.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if (isinstance(node, ast.Import) and any(alias.name.split(".")[0] == package for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and not node.level and node.module.split(".")[0] == package)
    }
    assert files
    assert all(name.startswith(only) for name in files)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("core.scene.patches", "from ..tracing import Hits"),  # upwards
        ("core.tracing.build", "from ...blender import marks"),
        ("core.settings", "from .sampling import hash32"),
        ("core.scene.patches", "def later():\n    from ..tracing import Hits"),
        ("core.scene.patches", "import obscurance_addon.core.tracing"),
        ("core.scene.patches", "from obscurance_addon.core.tracing import Hits"),
        ("ui.operators", "from ..command_line import main"),  # beside
        ("ui.operators", "from .. import register"),
        ("core.light.direct", "from ..tracing.intersector import MISS"),  # past the front door
        ("core.light.direct", "from ..tracing import embree"),
        ("core.light.direct", "from ..tracing import prepare_scene"),
        ("core.light.direct", "from ..tracing import *"),
        ("core.light.direct", "import obscurance_addon.core.tracing.embree"),
        ("core.light.direct", "if TYPE_CHECKING:\n    from ..tracing.embree import EmbreeIntersector"),
    ],
)
def test_a_bad_import_is_found(module, source):
    assert all(fault(module, *found) for found in imports_of(module, source))
    assert imports_of(module, source)
