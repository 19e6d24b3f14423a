"""The command line: bakes .blend files without a window.

python -m obscurance_addon bake SCENE.blend --output OUT.blend        (bpy module)
blender --command obscurance bake SCENE.blend --output OUT.blend      (installed extension)
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import time
import traceback
from pathlib import Path

from ..core.errors import ObscuranceError
from ..core.files import TargetError, check_whole, written_whole
from ..core.light import LightSettings
from ..core.lightmap import LightmapSettings
from ..core.notes import named
from ..core.order import OutputSettings, Target
from ..core.settings import BakeSettings
from .arguments import (
    estimator_changes,
    light_changes,
    lightmap_changes,
    modifier_changes,
    output_changes,
    parse,
)
from .process import end_on_interrupt
from .report import finite, lightmap_settings, peak_memory, write_report
from .targets import frame_cache, outputs
from .terminal import Terminal, complain, explain

DONE, FAILED = 0, 1


def command(arguments: list[str]) -> int:
    """As `main`, for a process that runs nothing else: Ctrl-C ends it."""
    end_on_interrupt()
    return main(arguments)


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
    try:
        options.targets.check_report()
        files = [_bake_file(*paths, options) for paths in zip(options.scenes, outputs(options), strict=True)]
        if options.report:
            write_report(options.report, files, time.perf_counter() - began)
    except TargetError as error:
        complain(f"{options.report}: {error}")
        return FAILED
    return FAILED if any("error" in entry for entry in files) else DONE


@dataclasses.dataclass(frozen=True)
class _File:
    """One file of a run: from where, to where, as the options say, and what has been written for it so far."""

    scene: Path
    output: Path
    options: argparse.Namespace
    say: Terminal
    written: list[str] = dataclasses.field(default_factory=list)


def _bake_file(scene: Path, output: Path, options: argparse.Namespace) -> dict:
    """Bake one file; never raises, so that the others are baked too. Returns its entry of the report."""
    say = Terminal(scene, options.quiet)
    file = _File(scene, output, options, say)
    try:
        entry = _open_bake_save(file)
    except Exception as error:
        say.end()
        if not isinstance(error, (ObscuranceError, OSError, RuntimeError, MemoryError)):
            explain(traceback.format_exc())  # a bug, which the message alone would not let anybody find
        also = f" (written before: {', '.join(file.written)})" if file.written else ""
        complain(f"{scene}: {_reason(error)}{also}")
        return {"scene": str(scene), "error": _reason(error), "written": file.written}
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
    modifiers: str  # of `blender.reading.Modifiers`, which needs bpy

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
            group.to_modifiers(**modifier_changes(options)),
        )

    def described(self) -> dict:
        """All settings by name."""
        parts = (self.settings, self.output, self.light)
        values = {name: value for part in parts for name, value in dataclasses.asdict(part).items()}
        return values | lightmap_settings(self.lightmap) | {"modifiers": str(self.modifiers)}


def _open_bake_save(file: _File) -> dict:
    """Bake one file; its entry of the report."""
    import bpy

    from ..blender.animation import export_in_process
    from ..blender.reading import ObjectModeGuard
    from .blend_file import BlendFile

    began, scene, output, options = time.perf_counter(), file.scene, file.output, file.options
    _check_scene(scene)
    options.targets.check(output)
    blend = BlendFile(scene, options.trust_paths)
    blend.check_version(output)
    loaded = time.perf_counter()
    context = bpy.context
    opened = context.scene.name
    _enter_scene(context, options.scene)
    asked = _Asked.of(context.scene, options)
    _claim_image(asked.output, file)
    guard = ObjectModeGuard(context)
    objects = _objects(context, options)
    bake = _bake_once if options.frames is None else _bake_frames
    entry, summary = bake(context, objects, asked, file)
    guard.restore(context)
    baked_scene = context.scene.name
    _enter_scene(context, opened)  # the saved file opens as it did
    baked = time.perf_counter()
    blend.save(output)
    saved = time.perf_counter()
    file.written.append(str(output))
    entry["seconds"] = {"load": loaded - began, **entry["seconds"], "save": saved - baked}
    entry["warnings"] = blend.notes + entry["warnings"]
    if options.export is not None:
        with written_whole(options.export, check_whole) as part:
            export_in_process(output, Path(entry["frame_cache"]), part, options.export.name, baked_scene)
        entry["seconds"]["export"] = time.perf_counter() - saved
        file.written.append(str(options.export))
    file.say.end()
    file.say.line(f"{scene} -> {output}: {summary}")
    if len(file.written) > 1:
        file.say.line(f"{scene}: written: {', '.join(file.written)}")
    return {
        "scene": str(scene),
        "output": str(output),
        "written": file.written,
        **entry,
        "peak_memory_bytes": peak_memory(),
    }


def _check_scene(scene: Path) -> None:
    """Make sure that there is a file to open; raises ObscuranceError."""
    if scene.is_file():
        return
    if scene.is_symlink() and not scene.exists():
        raise ObscuranceError("this link leads nowhere: name a .blend")
    if scene.exists():
        raise ObscuranceError(f"this is {'a folder' if scene.is_dir() else 'no file'}: name a .blend")
    raise ObscuranceError("no such file: check the path")


def _claim_image(output: OutputSettings, file: _File) -> None:
    """Make sure that a lightmap, if one is asked for, may go to its file."""
    from ..blender.writing import absolute_path, check_path, tiled_path

    if output.target is Target.LIGHTMAP and output.image_path:
        path = absolute_path(check_path(output.image_path, output.image_format))
        file.options.targets.claim_image(path, tiled_path(path), file.scene, file.output)


def _bake_once(context, objects: list, asked: _Asked, file: _File) -> tuple[dict, str]:
    """Bake the scene as it is; the entry of the report, and a line for the terminal."""
    from ..blender.jobs import BakeJob

    job = BakeJob(
        context, objects, asked.settings, asked.output, asked.light, asked.lightmap, modifiers=asked.modifiers
    )
    report = job.run(on_step=file.say.progress)
    file.written.extend(report.lightmap.files if report.lightmap else [])
    traced = report.seconds["trace"] + report.seconds.get("light", 0.0)
    return {
        "settings": asked.described() | {"distance": finite(report.d_max)},
        "distance_from": report.reach_from,
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


def _bake_frames(context, objects: list, asked: _Asked, file: _File) -> tuple[dict, str]:
    """Bake a range of frames; results as for `_bake_once`."""
    from ..blender.animation import FrameRange, bake_frames, check_exportable, play_back
    from ..blender.frame_caches import FrameCache

    options, output = file.options, file.output
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
        file.say.frame(frame, report)

    settings = asked.described() | {"distance": asked.settings.distance and finite(asked.settings.distance)}
    ceiling = context.scene.obscurance.preview_memory << 20
    warnings = bake_frames(context, objects, asked.settings, asked.output, asked.light, frames, ceiling, settings, tell)
    file.written.append(str(folder))
    cache = FrameCache.open(folder)
    baked = time.perf_counter()
    play_back(context.scene, cache, Path(os.path.realpath(output)).parent)
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


def _reason(error: Exception) -> str:
    """The message of an error on one line."""
    from .blend_file import plain

    if isinstance(error, MemoryError):
        return (
            f"there is too little memory ({plain(error)}): bake fewer objects, rays or texels, or close other programs"
        )
    return plain(error)
