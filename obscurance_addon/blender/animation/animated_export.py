"""Writes a scene with the colours of every frame of a cache to USD or Alembic.

Blender's exporters take colours anew at every frame only from meshes that deform, and they run frame change handlers.
So a wave without height is put on each mesh for the time of the export, and a handler writes the values of each frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ...core.errors import ObscuranceError
from ..frame_caches import FrameCache
from ..writing import LAYERS, ExportFormat, check_export_name, color_attribute, copy_for_export, records
from .frame_range import at_every_frame

FORMATS = {
    ".usd": ExportFormat.USD,
    ".usda": ExportFormat.USD,
    ".usdc": ExportFormat.USD,
    ".abc": ExportFormat.ALEMBIC,
}


_OPERATORS = {ExportFormat.USD: ("usd_export", "USD"), ExportFormat.ALEMBIC: ("alembic_export", "Alembic")}


def export_animation(context: bpy.types.Context, cache: FrameCache, path: Path) -> None:
    """Write the visible scene over the frames of a cache, with its colours where programs look for them.

    Parameters
    ----------
    context : bpy.types.Context
    cache : FrameCache
    path : Path
        Its name ends in one of `FORMATS`; a file that is there is replaced.

    Raises
    ------
    ObscuranceError
        When the format is unknown or Blender cannot write it. Not on a full disk: see `check_export`.
    """
    kind = check_format(path)
    objects = [context.view_layer.objects[name] for name in cache.names if name in context.view_layer.objects]
    scene = context.scene
    current, start, end = scene.frame_current, scene.frame_start, scene.frame_end
    check_exportable(objects, cache.frames[0], path)

    errors: list[ObscuranceError] = []  # Blender prints what a handler raises, and goes on

    def write_frame(at: bpy.types.Scene, _depsgraph: bpy.types.Depsgraph) -> None:
        try:
            if cache.has(at.frame_current):
                cache.show(at.frame_current)
                copy_for_export(objects, cache.output, kind)
        except ObscuranceError as error:
            errors.append(error)

    with _only_for_now(objects, kind), _seeming_to_deform(objects), at_every_frame(write_frame):
        try:
            scene.frame_start, scene.frame_end = cache.frames
            scene.frame_set(cache.frames[0])  # the layers must be there before the exporter looks
            if kind is ExportFormat.USD:
                bpy.ops.wm.usd_export(filepath=str(path), export_animation=True, export_mesh_colors=True)
            else:
                first, last = cache.frames
                bpy.ops.wm.alembic_export(
                    filepath=str(path), start=first, end=last, vcolors=True, as_background_job=False
                )
        except (AttributeError, RuntimeError) as error:
            raise ObscuranceError(f"this Blender cannot write '{path.name}': {error}") from None
        finally:
            scene.frame_start, scene.frame_end = start, end
            scene.frame_set(current)
    if errors:
        raise errors[0]


def check_format(path: Path) -> ExportFormat:
    """The format that the name of a file asks for; raises ObscuranceError for others than `FORMATS`."""
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise ObscuranceError(f"'{path.name}' names no format with animated colors: use {', '.join(FORMATS)}")
    return kind


def check_exportable(objects: Iterable[bpy.types.Object], first_frame: int, path: Path) -> None:
    """Make sure, before anything is baked, that its export will not be refused.

    Raises
    ------
    ObscuranceError
        When the format is unknown to us or to this Blender, or begins later than the frames, or a layer of the user's
        has the format's name.
    """
    kind = check_format(path)
    if kind is ExportFormat.USD and first_frame < 0:
        raise ObscuranceError("Blender cannot export frames before 0 to USD: move the animation, or write Alembic")
    operator, name = _OPERATORS[kind]
    if operator not in dir(bpy.ops.wm):
        raise ObscuranceError(f"this Blender was built without {name}, so it cannot write '{path.name}': use another")
    for ob in objects:
        if ob.type == "MESH":
            check_export_name(ob, kind)


@contextmanager
def _only_for_now(objects: list[bpy.types.Object], kind: ExportFormat) -> Iterator[None]:
    """Take away afterwards the layers that the export makes; copies that were there stay."""
    name = LAYERS[kind].name
    for ob in objects:
        check_export_name(ob, kind)
    meshes = {ob.data.session_uid: ob.data for ob in objects if name not in ob.data.attributes}
    try:
        yield
    finally:
        for mesh in meshes.values():
            if name in mesh.attributes:
                with color_attribute.choices_kept(mesh):
                    mesh.attributes.remove(mesh.attributes[name])
                records.forget(mesh, name)


@contextmanager
def _seeming_to_deform(objects: list[bpy.types.Object]) -> Iterator[None]:
    """Give objects a modifier that moves nothing, but counts as animated."""
    added = []
    try:
        for ob in objects:
            wave = ob.modifiers.new("Obscurance Export", "WAVE")
            wave.height = 0.0
            added.append((ob, wave.name))
        yield
    finally:
        for ob, name in added:
            ob.modifiers.remove(ob.modifiers[name])
