"""The report of a run: what was done, as JSON."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from pathlib import Path

from ..core.files import CHECKS, TargetError, is_stream, written_whole
from ..core.lightmap import LightmapSettings
from ..version import version


def write_report(path: Path, files: list[dict], seconds: float) -> None:
    """Write the report whole, or into a device or a pipe, which stays what it is.

    Raises
    ------
    TargetError
        When it could not be written.
    """
    import bpy

    report = {
        "version": version(),
        "blender": bpy.app.version_string,
        "seconds": seconds,
        "peak_memory_bytes": peak_memory(),
        "files": files,
    }
    text = json.dumps(report, indent=2) + "\n"
    if not is_stream(path):
        with written_whole(path, CHECKS[".json"]) as part:
            part.write_text(text, encoding="utf-8")
        return
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(text)
    except BrokenPipeError:
        return  # whoever read it has enough
    except OSError as error:
        raise TargetError(f"'{path}' could not be written ({error.strerror}): choose another place") from error


def lightmap_settings(lightmap: LightmapSettings) -> dict:
    """Lightmap settings under the names of the scene's properties."""
    settings = dataclasses.asdict(lightmap)
    return {"lightmap_size": settings.pop("size"), **settings}


def finite(distance: float) -> float | str:
    """The distance as JSON can hold it, which knows no infinity: then as the command line takes it."""
    return distance if math.isfinite(distance) else "inf"


def peak_memory() -> int | None:
    """Largest resident size of this process so far in bytes, None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
