"""Whether the native libraries load, and if not, why and what helps.

They come as wheels for certain systems and Pythons, so the add-on must be able to say what is missing on any other.
"""

from __future__ import annotations

import functools
import importlib
import platform
import sys

MACOS_NEEDED = 13  # embreex' wheels are built for it; Blender does not check that when it installs them

_IMPORTED = {
    "embreex": ("embreex.rtcore_scene", "embreex.mesh_construction"),
    "xatlas": ("xatlas",),
    "uvunwrap": ("uvunwrap",),
}
NAMES = tuple(_IMPORTED)


@functools.cache
def why_missing(name: str) -> str | None:
    """Why a library cannot be used and what helps, one sentence without a full stop; None when it loads.

    Parameters
    ----------
    name : str
        One of `NAMES`. Answers are kept, so that a panel may ask at every redraw.
    """
    try:
        for module in _IMPORTED[name]:
            importlib.import_module(module)
    except Exception as error:  # a native library may fail in ways of its own, a wrong numpy by ValueError for one
        return f"{name} {_cause(name, error)}; {_cure(name)}"
    return None


def _cause(name: str, error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name == name:
        return "is not installed"
    return f"does not load ({' '.join(str(error).split()) or type(error).__name__})"


def _cure(name: str) -> str:
    system, release = platform.system(), platform.mac_ver()[0]
    if system == "Darwin" and release and int(release.split(".")[0]) < MACOS_NEEDED:
        return f"it needs macOS {MACOS_NEEDED} or later, and this is macOS {release}"
    system = "macOS" if system == "Darwin" else system
    here = f"{system} {platform.machine()}, Python {sys.version_info[0]}.{sys.version_info[1]}"
    if __name__.startswith("bl_ext."):  # the name that Blender gives to extensions
        return f"install the zip that is made for this system ({here}) again"
    return f"install obscurance-addon again with what it depends on, for this system ({here})"
