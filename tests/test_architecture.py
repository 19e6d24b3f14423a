"""The order of the packages: imports go one way, and through the front door of each package."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import obscurance_addon

ROOT = Path(obscurance_addon.__file__).parent

# A package may import from those before it. Names that end in a dot and a star stand for the modules of that folder,
# each of which may be imported by itself.
ORDER = (
    "version",
    "core.*",
    "core.process",
    "core.sampling",
    "core.scene",
    "core.shading",
    "core.tracing",
    "core.obscurance",
    "core.light",
    "core.lightmap",
    "core.lightmap.unwrap_worker",
    "core.updates",
    "core.order",
    "blender.*",
    "blender.materials",
    "blender.reading",
    "blender.writing",
    "blender.display",
    "blender.jobs",
    "blender.animation",
    "blender.properties",
    "ui",
    "command_line",
    "",
)
NEIGHBOURS = {("ui", "command_line"), ("command_line", "ui")}  # neither may import the other


@functools.cache
def modules() -> dict[str, Path]:
    """The file of each module, by its name below the add-on; '' is the add-on itself."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[0] != "presets":
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def package_of(module: str) -> str:
    """Its entry in ORDER."""
    is_package = modules()[module].name == "__init__.py"
    package = module if is_package else module.rpartition(".")[0]
    if package in ORDER and (is_package or package):
        return package
    if not package:  # beside the first file of the add-on
        return module if module in ORDER else ""
    return f"{package}.*"


def imports(module: str) -> Iterator[tuple[str, str | None]]:
    """Modules that a module imports of the add-on, and which name of theirs; None for the modules themselves."""
    path = modules()[module]
    here = ["obscurance_addon", *module.split(".")] if module else ["obscurance_addon"]
    package = here if path.name == "__init__.py" else here[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.split(".")[0] == "obscurance_addon"]
            yield from ((name.partition(".")[2], None) for name in names)
        if not isinstance(node, ast.ImportFrom):
            continue
        base = package[: len(package) - node.level + 1] if node.level else []
        base = [*base, *(node.module.split(".") if node.module else [])]
        if base[:1] != ["obscurance_addon"]:
            continue
        target = ".".join(base[1:])
        for alias in node.names:
            below = f"{target}.{alias.name}".lstrip(".")
            yield (below, None) if below in modules() else (target, alias.name)


@functools.cache
def exported(package: str) -> set[str]:
    """What the front door of a package names."""
    for node in ast.parse(modules()[package].read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


def test_every_module_has_a_place():
    assert {package_of(module) for module in modules()} - {"core", "blender"} <= set(ORDER)
    assert len(modules()) > 100


@pytest.mark.parametrize("module", [name for name in modules() if name not in {"core", "blender"}])
def test_imports_go_one_way(module):
    """And take from other packages only what these show."""
    own = package_of(module)
    for target, name in imports(module):
        other = package_of(target)
        if other == own or own == "":
            continue
        assert ORDER.index(other) < ORDER.index(own), f"{module} imports {target}"
        assert (own, other) not in NEIGHBOURS, f"{module} imports {target}"
        if other.endswith(".*") or other == "version":
            continue
        if name is None:  # a module as a whole
            package, _, name = target.rpartition(".")
            assert package == other, f"{module} imports {target}"
        else:
            assert target == other, f"{module} imports {name} from {target}, not from {other}"
        assert name in exported(other), f"{module} imports {name}, which {other} does not show"


def test_no_circle_of_imports():
    """Not between modules either; front doors, which import what they show, are left out."""
    graph = {}
    for module, path in modules().items():
        if path.name != "__init__.py":
            graph[module] = {t for t, _ in imports(module) if modules()[t].name != "__init__.py"}
    done: set[str] = set()

    def walk(module: str, way: tuple[str, ...]) -> None:
        assert module not in way, " - ".join([*way[way.index(module) :], module])
        if module not in done:
            for target in graph[module]:
                walk(target, (*way, module))
            done.add(module)

    for module in graph:
        walk(module, ())


def test_each_package_says_what_it_is_for():
    """In three sentences: what for, what goes in, what comes out."""
    for package in ORDER:
        if package in modules() and modules()[package].name == "__init__.py" and package:
            text = ast.get_docstring(ast.parse(modules()[package].read_text(encoding="utf-8")))
            assert re.search(r"^In goe?s? ", text, re.MULTILINE), package
            assert "Out come" in text, package
