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

from ..core.errors import ObscuranceError
from ..core.light import LightSettings
from ..core.lightmap import LightmapSettings
from ..core.notes import named
from ..core.order import OutputSettings
from ..core.settings import BakeSettings
from ..version import version
from .arguments import estimator_changes, frame_cache, light_changes, lightmap_changes, output_changes, outputs, parse
from .terminal import Terminal, blender_silent, complain

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
        complain(f"{options.report}: {problem}")
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
            complain(f"{options.report}: the report could not be written ({error.strerror})")
            return FAILED
    return FAILED if failed else DONE


def _bake_file(scene: Path, output: Path, options: argparse.Namespace) -> dict:
    """Bake one file; never raises, so that the others are baked too. Returns its entry of the report."""
    say = Terminal(scene, options.quiet)
    try:
        entry = _open_bake_save(scene, output, options, say)
    except Exception as error:
        say.end()
        if not isinstance(error, (ObscuranceError, OSError, RuntimeError, MemoryError)):
            traceback.print_exc()  # a bug, which the message alone would not let anybody find
        complain(f"{scene}: {_plain(error)}")
        return {"scene": str(scene), "error": _plain(error)}
    for warning in entry["warnings"]:
        say.line(f"{scene}: note: {warning}")
    return entry


@dataclasses.dataclass(frozen=True)
class _Asked:
    """What an opened scene and the options together ask for."""

    settings: BakeSettings
    output: OutputSettings
    light: LightSettings
    lightmap: LightmapSettings

    @classmethod
    def of(cls, scene, options: argparse.Namespace) -> _Asked:
        group, changes = scene.obscurance, estimator_changes(options)
        if changes.get("distance") is not None:  # the options are in metres, the scene in its own units
            changes["distance"] /= scene.unit_settings.scale_length
        return cls(
            group.to_settings(**changes),
            group.to_output(**output_changes(options)),
            group.to_light(**light_changes(options)),
            group.to_lightmap(**lightmap_changes(options)),
        )

    def described(self) -> dict:
        """All settings by name."""
        parts = (self.settings, self.output, self.light)
        values = {name: value for part in parts for name, value in dataclasses.asdict(part).items()}
        return values | _lightmap_settings(self.lightmap)


def _open_bake_save(scene: Path, output: Path, options: argparse.Namespace, say: Terminal) -> dict:
    import bpy

    from ..blender.reading import ObjectModeGuard

    began = time.perf_counter()
    if not scene.is_file():
        raise ObscuranceError("this is a folder: name a .blend" if scene.is_dir() else "no such file: check the path")
    for path in filter(None, (output, options.export)):
        if problem := _cannot_write(path):
            raise ObscuranceError(problem)
    with blender_silent():
        bpy.ops.wm.open_mainfile(filepath=str(scene.resolve()), load_ui=False)
    loaded = time.perf_counter()
    context = bpy.context
    opened = context.scene.name
    _enter_scene(context, options.scene)
    asked = _Asked.of(context.scene, options)
    guard = ObjectModeGuard(context)
    objects = _objects(context, options)
    bake = _bake_once if options.frames is None else _bake_frames
    entry, summary = bake(context, objects, asked, output, options, say)
    guard.restore(context)
    _enter_scene(context, opened)  # the saved file opens as it did
    baked = time.perf_counter()
    with _written_whole(output) as part:
        with scene.open("rb") as source:
            compress = source.read(7) != b"BLENDER"
        with blender_silent():
            bpy.ops.wm.save_as_mainfile(filepath=str(part), copy=True, compress=compress, check_existing=False)
    saved = time.perf_counter()
    entry["seconds"] = {"load": loaded - began, **entry["seconds"], "save": saved - baked}
    if options.export is not None:
        _export(output, Path(entry["frame_cache"]), options.export)
        entry["seconds"]["export"] = time.perf_counter() - saved
    say.end()
    say.line(f"{scene} -> {output}: {summary}")
    return {"scene": str(scene), "output": str(output), **entry, "peak_memory_bytes": _peak_memory()}


def _bake_once(
    context, objects: list, asked: _Asked, _output: Path, _options: argparse.Namespace, say: Terminal
) -> tuple[dict, str]:
    """Bake the scene as it is; the entry of the report, and a line for the terminal."""
    from ..blender.jobs import BakeJob

    job = BakeJob(context, objects, asked.settings, asked.output, asked.light, asked.lightmap)
    report = job.run(on_step=say.progress)
    traced = report.seconds["trace"] + report.seconds.get("light", 0.0)
    return {
        "settings": asked.described() | {"distance": _finite(report.d_max)},
        "objects": report.objects,
        "patches": report.patches,
        "triangles": report.triangles,
        "rays": report.rays,
        "seconds": report.seconds,
        "mrays_per_second": report.rays / traced / 1e6 if traced else 0.0,
        "r_ave": report.r_ave,
        "rmse": report.rmse,
        "ambient_light": report.ambient_light,
        "openness": report.openness,
        "reflectors": report.reflectors,
        "reflected_share": report.reflected_share,
        "lightmap": report.lightmap and dataclasses.asdict(report.lightmap),
        "warnings": report.warnings,
    }, report.summary()


def _bake_frames(
    context, objects: list, asked: _Asked, output: Path, options: argparse.Namespace, say: Terminal
) -> tuple[dict, str]:
    """Bake a range of frames; results as for `_bake_once`."""
    from ..blender.animation import FrameCache, FrameRange, bake_frames, check_exportable, play_back

    folder = Path(os.path.abspath(frame_cache(options, output)))
    if options.export is not None:
        check_exportable(objects, options.frames[0], options.export)
    context.scene.obscurance.live_preview = False  # until the cache is there to be played
    frames, began, told = FrameRange(*options.frames, folder), time.perf_counter(), []

    def tell(frame: int, report) -> None:
        told.append(
            {
                "frame": frame,
                "patches": report.patches,
                "rays": report.rays,
                "cached_rays": report.cached_rays,
                "milliseconds": 1e3 * report.seconds,
                "full_bake": report.full,
            }
        )
        say.frame(frame, report)

    settings = asked.described() | {"distance": asked.settings.distance and _finite(asked.settings.distance)}
    ceiling = context.scene.obscurance.preview_memory << 20
    warnings = bake_frames(context, objects, asked.settings, asked.output, asked.light, frames, ceiling, settings, tell)
    cache = FrameCache.open(folder)
    baked = time.perf_counter()
    play_back(context.scene, cache, output.resolve().parent)
    rays = sum(one["rays"] for one in told)
    return {
        "settings": settings,
        "objects": cache.names,
        "frame_cache": str(folder),
        "export": options.export and str(options.export),
        "frames": told,
        "rays": rays,
        "seconds": {"frames": baked - began},
        "warnings": warnings,
    }, (
        f"Baked {len(frames)} frames of {len(cache.names)} objects with {rays:,} rays in {baked - began:.2f} s into "
        f"'{folder}'"
    )


def _export(output: Path, folder: Path, target: Path) -> None:
    """Export the animation that was saved; whatever happens to it, what was baked is on disk by now."""
    from ..blender.animation import export_whole

    try:
        with _written_whole(target) as part:
            export_whole(output, folder, part, target.name)
    except (ObscuranceError, OSError) as error:
        raise ObscuranceError(f"{_plain(error)}. What was baked is in '{output}' all the same") from error


def _lightmap_settings(lightmap: LightmapSettings) -> dict:
    """Lightmap settings under the names of the scene's properties."""
    settings = dataclasses.asdict(lightmap)
    return {"lightmap_size": settings.pop("size"), **settings}


def _finite(distance: float) -> float | str:
    """The distance as JSON can hold it, which knows no infinity: then as the command line takes it."""
    return distance if math.isfinite(distance) else "inf"


def _enter_scene(context, name: str | None) -> None:
    """Make the scene of this name the active one, if there is a name."""
    import bpy

    if name is None or name == context.scene.name:
        return
    if name not in bpy.data.scenes:
        raise ObscuranceError(f"there is no scene '{name}': choose one of {named(bpy.data.scenes.keys())} (--scene)")
    context.window.scene = bpy.data.scenes[name]


def _objects(context, options: argparse.Namespace) -> list:
    """The objects named, or all that render; over a range of frames, also those that may render later."""
    from ..blender.animation import objects_over_time
    from ..blender.reading import rendered_meshes

    names = options.objects
    if names is None:
        return rendered_meshes(context) if options.frames is None else objects_over_time(context)
    missing = [name for name in names if name not in context.view_layer.objects]
    if missing:
        present = named(ob.name for ob in context.view_layer.objects) or "none"
        raise ObscuranceError(
            f"scene '{context.scene.name}' has no object named {named(missing)} that is not excluded: check --objects "
            f"and --scene; there are {present}"
        )
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
