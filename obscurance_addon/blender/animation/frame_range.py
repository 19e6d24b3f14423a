"""Bakes every frame of a range into a frame cache."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import GeometryError, SettingsError
from ...core.light import LightSettings
from ...core.order import OutputSettings, Target
from ...core.settings import BakeSettings
from ...core.updates import UpdateMode
from ..frame_caches import FrameCache, FrameCacheWriter
from ..writing import what_is_stored
from .frame_update import NOTHING_DONE, FrameReport, FrameUpdater
from .full_update import FullUpdater


@dataclass(frozen=True)
class FrameRange:
    """Frames to bake, both ends included, and where to: a folder for the cache."""

    first: int
    last: int
    folder: Path

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.first, self.last + 1))

    def __len__(self) -> int:
        return self.last - self.first + 1


def bake_frames(
    context: bpy.types.Context,
    objects: Iterable[bpy.types.Object],
    settings: BakeSettings,
    output: OutputSettings,
    light: LightSettings,
    frames: FrameRange,
    ceiling_bytes: int,
    notes: dict[str, object],
    tell: Callable[[int, FrameReport], None],
) -> list[str]:
    """Bake objects at every frame; the scene ends up at the frame where it was, with the values of the last one baked.

    Parameters
    ----------
    context, objects, settings, output, light
        As for `BakeJob`; a target of the mesh.
    frames : FrameRange
    ceiling_bytes : int
        Memory for cached hits at most.
    notes : dict
        Kept in the cache for people to read.
    tell : callable
        Called with every frame and what was done for it.

    Returns
    -------
    list of str
        Warnings.

    Raises
    ------
    ObscuranceError
        When nothing can be baked, or the cache cannot be written; an older cache is then still there.
    """
    if output.target is Target.LIGHTMAP:
        raise SettingsError("frames are baked into attributes: choose another target than LIGHTMAP")
    scene = context.scene
    current, objects = scene.frame_current, list(objects)
    writer = FrameCacheWriter(frames.folder, output, what_is_stored(light), notes)
    try:
        updater: FrameUpdater | FullUpdater | None = None
        for frame in frames:
            with _noted_by(updater):
                scene.frame_set(frame)
            try:
                if updater is None:
                    updater, report = _first_update(context, objects, settings, output, light, ceiling_bytes)
                else:
                    report = updater.update(context, context.evaluated_depsgraph_get())
            except GeometryError:  # nothing shows in this frame
                if frame == frames.last and updater is None:
                    raise
                report = NOTHING_DONE
            if updater is not None:
                updater.evaluate_written(context)
            writer.add(
                frame, {name: stored_colours(context.view_layer.objects[name], output) for name in report.objects}
            )
            tell(frame, report)
        writer.finish()
    finally:
        writer.discard()
        scene.frame_set(current)
    return updater.notes


def _first_update(
    context: bpy.types.Context,
    objects: list[bpy.types.Object],
    settings: BakeSettings,
    output: OutputSettings,
    light: LightSettings,
    ceiling_bytes: int,
) -> tuple[FrameUpdater | FullUpdater, FrameReport]:
    """Bake the scene as it is, with what follows it from then on."""
    if light.needs_light:
        full = FullUpdater(objects, settings, output, light)
        return full, full.update(context, context.evaluated_depsgraph_get())
    updater = FrameUpdater(context, objects, settings, output, ceiling_bytes, UpdateMode.EXACT)
    return updater, updater.start()


def play_back(scene: bpy.types.Scene, cache: FrameCache, home: Path) -> None:
    """Make a scene that will be saved in the folder `home` play a cache, beginning with the frame that it shows."""
    if cache.has(scene.frame_current):
        cache.show(scene.frame_current)
    group, folder = scene.obscurance, cache.folder.resolve()
    group.live_preview = False
    group.frame_cache = f"//{folder.relative_to(home)}" if folder.is_relative_to(home) else str(folder)
    group.live_preview = True


def stored_colours(ob: bpy.types.Object, output: OutputSettings) -> np.ndarray:
    """The values (n, 3) float32 that a bake wrote on an object."""
    data = ob.data.attributes[output.attribute_name].data
    rgba = np.empty(len(data) * 4, np.float32)
    data.foreach_get("color", rgba)
    return rgba.reshape(-1, 4)[:, :3]


def _noted_by(updater: FrameUpdater | FullUpdater | None) -> AbstractContextManager:
    """Tell an updater what the depsgraph evaluates while a frame is set, which it forgets afterwards."""
    if updater is None:
        return nullcontext()
    return at_every_frame(lambda _scene, depsgraph: updater.note(depsgraph))


@contextmanager
def at_every_frame(handler: Callable[[bpy.types.Scene, bpy.types.Depsgraph], None]) -> Iterator[None]:
    """Run a handler after every change of frame."""
    handlers = bpy.app.handlers.frame_change_post
    handlers.append(handler)
    try:
        yield
    finally:
        handlers.remove(handler)
