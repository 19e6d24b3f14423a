"""The command line: bakes .blend files without a window.

python -m obscurance_addon bake SCENE.blend --output OUT.blend        (bpy module)
blender --command obscurance bake SCENE.blend --output OUT.blend      (installed extension)
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import shutil
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .arguments import estimator_changes, light_changes, lightmap_changes, output_changes, outputs, parse
from .core.errors import ObscuranceError
from .core.lightmap_settings import LightmapSettings
from .version import version

DONE, FAILED = 0, 1


def main(arguments: list[str]) -> int:
    """Run the command line inside of Blender.

    Parameters
    ----------
    arguments : list of str
        Without the program's name.

    Returns
    -------
    int
        Exit status: 0 all done, 1 a file failed (the others are baked all the same); wrong usage exits with 2.
    """
    options = parse(arguments)
    began = time.perf_counter()
    if options.report and (problem := _cannot_write(options.report)):
        _complain(f"{options.report}: {problem}")
        return FAILED
    files = [_bake_file(scene, output, options) for scene, output in zip(options.scenes, outputs(options), strict=True)]
    failed = sum("error" in entry for entry in files)
    if options.report:
        report = {
            "version": version(),
            "blender": _blender_version(),
            "seconds": time.perf_counter() - began,
            "peak_memory_bytes": _peak_memory(),
            "files": files,
        }
        try:
            with _written_whole(options.report) as part:
                part.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            _complain(f"{options.report}: the report could not be written ({error.strerror})")
            return FAILED
    return FAILED if failed else DONE


def _bake_file(scene: Path, output: Path, options: argparse.Namespace) -> dict:
    """Bake one file; never raises, so that the others are baked too. Returns its entry of the report."""
    say = _Terminal(scene, options.quiet)
    try:
        entry = _open_bake_save(scene, output, options, say)
    except Exception as error:
        say.end()
        if not isinstance(error, (ObscuranceError, OSError, RuntimeError, MemoryError)):
            traceback.print_exc()  # a bug, which the message alone would not let anybody find
        _complain(f"{scene}: {_plain(error)}")
        return {"scene": str(scene), "error": _plain(error)}
    for warning in entry["warnings"]:
        say.line(f"{scene}: note: {warning}")
    return entry


def _open_bake_save(scene: Path, output: Path, options: argparse.Namespace, say: _Terminal) -> dict:
    import bpy

    from .blender.bake_job import BakeJob
    from .blender.object_mode import ObjectModeGuard

    began = time.perf_counter()
    if not scene.is_file():
        raise ObscuranceError("this is a folder: name a .blend" if scene.is_dir() else "no such file: check the path")
    if problem := _cannot_write(output):
        raise ObscuranceError(problem)
    with _blender_silent():
        bpy.ops.wm.open_mainfile(filepath=str(scene.resolve()), load_ui=False)
    loaded = time.perf_counter()
    context = bpy.context
    group = context.scene.obscurance
    changes = estimator_changes(options)
    if changes.get("distance") is not None:  # the options are in metres, the scene in its own units
        changes["distance"] /= context.scene.unit_settings.scale_length
    settings, target = group.to_settings(**changes), group.to_output(**output_changes(options))
    light = group.to_light(**light_changes(options))
    lightmap = group.to_lightmap(**lightmap_changes(options))
    guard = ObjectModeGuard(context)
    objects = _objects(context, options.objects)
    report = BakeJob(context, objects, settings, target, light, lightmap).run(on_step=say.progress)
    guard.restore(context)
    baked = time.perf_counter()
    with _written_whole(output) as part:
        with scene.open("rb") as source:
            compress = source.read(7) != b"BLENDER"
        with _blender_silent():
            bpy.ops.wm.save_as_mainfile(filepath=str(part), copy=True, compress=compress, check_existing=False)
    say.end()
    say.line(f"{scene} -> {output}: {report.summary()}")
    traced = report.seconds["trace"] + report.seconds.get("light", 0.0)
    return {
        "scene": str(scene),
        "output": str(output),
        "settings": {
            **dataclasses.asdict(settings),
            **dataclasses.asdict(target),
            **dataclasses.asdict(light),
            **_lightmap_settings(lightmap),
            "distance": _finite(report.d_max),
        },
        "objects": report.objects,
        "patches": report.patches,
        "triangles": report.triangles,
        "rays": report.rays,
        "seconds": {"load": loaded - began, **report.seconds, "save": time.perf_counter() - baked},
        "mrays_per_second": report.rays / traced / 1e6 if traced else 0.0,
        "r_ave": report.r_ave,
        "rmse": report.rmse,
        "ambient_light": report.ambient_light,
        "openness": report.openness,
        "reflectors": report.reflectors,
        "reflected_share": report.reflected_share,
        "lightmap": report.lightmap and dataclasses.asdict(report.lightmap),
        "peak_memory_bytes": _peak_memory(),
        "warnings": report.warnings,
    }


def _lightmap_settings(lightmap: LightmapSettings) -> dict:
    """Lightmap settings under the names of the scene's properties."""
    settings = dataclasses.asdict(lightmap)
    return {"lightmap_size": settings.pop("size"), **settings}


def _finite(distance: float) -> float | str:
    """The distance as JSON can hold it, which knows no infinity: then as the command line takes it."""
    return distance if math.isfinite(distance) else "inf"


def _objects(context, names: list[str] | None) -> list:
    """The objects named, or all that render."""
    from .blender.render_visibility import rendered_meshes

    if names is None:
        return rendered_meshes(context)
    missing = [name for name in names if name not in context.view_layer.objects]
    if missing:
        raise ObscuranceError(f"the view layer has no object named {', '.join(map(repr, missing))}: check --objects")
    return [context.view_layer.objects[name] for name in names]


@contextmanager
def _written_whole(target: Path) -> Iterator[Path]:
    """A path beside `target` to write to, renamed at the end: a kill leaves the old file or the new one."""
    target = target.resolve()
    part = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        yield part
        with part.open("rb+") as written:
            os.fsync(written.fileno())
        if target.exists():
            shutil.copymode(target, part)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def _cannot_write(path: Path) -> str | None:
    """Why a file cannot be written, and the cure; None when it can, as far as one can tell before."""
    if path.is_dir():
        return f"'{path}' is a folder: name a file"
    if not path.resolve().parent.is_dir():
        return f"the folder '{path.parent}' does not exist: create it first"
    if not os.access(path.resolve().parent, os.W_OK):
        return f"the folder '{path.parent}' cannot be written to: change its permissions or choose another"
    return None


@contextmanager
def _blender_silent() -> Iterator[None]:
    """Keep Blender's own chatter about files off the terminal; errors come back as exceptions anyway."""
    sys.stdout.flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


class _Terminal:
    """Progress and messages of one file: one line that renews itself on a terminal, few lines in a log."""

    _LOG_EVERY_S = 5.0

    def __init__(self, scene: Path, quiet: bool) -> None:
        self._scene, self._quiet = scene, quiet
        self._renews = sys.stdout.isatty()
        self._last = time.perf_counter()

    def progress(self, job) -> None:
        if self._quiet or (not self._renews and time.perf_counter() - self._last < self._LOG_EVERY_S):
            return
        self._last = time.perf_counter()
        left = "" if job.remaining is None else f", {job.remaining:.0f} s left"
        text = f"{self._scene}: {job.progress:.0%}{left}"
        print(f"\r\x1b[K{text}" if self._renews else text, end="" if self._renews else "\n", flush=True)

    def end(self) -> None:
        if self._renews and not self._quiet:
            print("\r\x1b[K", end="", flush=True)

    def line(self, text: str) -> None:
        if not self._quiet:
            print(text, flush=True)


def _complain(text: str) -> None:
    print(f"obscurance: error: {text}", file=sys.stderr, flush=True)


def _plain(error: Exception) -> str:
    """The message of an error on one line, without Blender's prefix; its type where it has no message."""
    return " ".join(str(error).replace("Error: ", "", 1).split()) or type(error).__name__


def _blender_version() -> str:
    import bpy

    return bpy.app.version_string


def _peak_memory() -> int | None:
    """Largest resident size of this process so far in bytes, None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
