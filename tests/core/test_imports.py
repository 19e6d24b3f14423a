"""The core stands on numpy and embreex alone."""

import subprocess
import sys
from pathlib import Path

import pytest

from obscurance_addon import core

ROOT = Path(core.__file__).parents[2]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in Path(core.__file__).parent.rglob("*.py")
    if "unwrap_worker" not in path.parts and path.stem != "__init__"
)
CHECK = """
import sys
for name in ("bpy", "mathutils", "bmesh", "bpy_extras", "scipy", "embreex", "xatlas", "uvunwrap"):
    sys.modules[name] = None
import importlib
importlib.import_module(sys.argv[1])
"""


def test_the_list_of_modules_is_not_empty():
    assert "obscurance_addon.core.tracing.embree" in MODULES
    assert len(MODULES) > 50


@pytest.mark.parametrize("module", MODULES)
def test_module_imports_without_blender_and_native_libraries(module):
    """embreex, xatlas and uvunwrap load only when they are first used, so that their absence can be reported."""
    done = subprocess.run([sys.executable, "-c", CHECK, module], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_missing_ray_tracer_is_named(monkeypatch):
    from obscurance_addon.core.errors import BackendError
    from obscurance_addon.core.native_library import why_missing
    from obscurance_addon.core.tracing.embree import EmbreeIntersector

    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    why_missing.cache_clear()
    with pytest.raises(BackendError, match=r"embreex .*; install obscurance-addon again"):
        EmbreeIntersector([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    why_missing.cache_clear()
