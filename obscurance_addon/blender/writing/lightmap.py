"""Puts a baked lightmap into the scene: image, UV maps and what they hold, whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...core.notes import Notes
from ...core.order import BakedObject, OutputSettings
from . import records, uv_layer
from .image import StagedImage, stage
from .layers import undone_on_failure
from .values import rejoin, separate, unchanged


@dataclass(frozen=True)
class WrittenLightmap:
    """What was written: the name of the image, its files (none when packed), and notes for the user."""

    image: str
    files: list[str]
    notes: list[str]


def write_lightmap(
    baked: list[BakedObject],
    pages: list[np.ndarray],
    uv: list[np.ndarray] | None,
    output: OutputSettings,
    stored: str,
) -> WrittenLightmap:
    """Put a lightmap into the scene; on failure all is as it was.

    Parameters
    ----------
    baked : list of BakedObject
    pages : list of ndarray, (size, size, 4) float32
    uv : list of ndarray, (c, 2) float32, or None
        UV map of each object, to be written; None where the objects keep one.
    output : OutputSettings
    stored : str
        What the lightmap holds, for the record.

    Raises
    ------
    SceneChangedError
        When an object is gone, has other faces than when the bake began, or is in Edit Mode.
    AttributeNameError
        When a UV map cannot be made.
    ImageFileError
        When the image cannot be written.
    """
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    objects = [_as_it_was(b, by_uid.get(b.session_uid), uv is None) for b in baked]
    if uv is not None:
        for ob in objects:
            uv_layer.check_uv_name(ob, output.attribute_name)
    staged = stage(pages, output.attribute_name, output.image_path, output.image_format)
    files = list(staged.files)
    if uv is None:
        image, notes = staged.land(), []
    else:
        image, notes = _land_with_uv(staged, objects, uv, output.attribute_name)
    for ob, of in zip(objects, baked, strict=True):
        uv_map = of.base.uv_map if uv is None else output.attribute_name
        records.remember(ob.data, output.attribute_name, stored, output.exposure, image, uv_map)
    return WrittenLightmap(image.name, files, notes)


def _as_it_was(baked: BakedObject, ob: bpy.types.Object | None, keeps_uv: bool) -> bpy.types.Object:
    """The object, once sure that the lightmap still fits it; with a UV map of its own it fits whatever changed."""
    return ob if keeps_uv and ob is not None and ob.type == "MESH" else unchanged(baked, ob)


def _land_with_uv(
    staged: StagedImage, objects: list[bpy.types.Object], uv: list[np.ndarray], name: str
) -> tuple[bpy.types.Image, list[str]]:
    """Land the image and write a UV map for each object, all or nothing."""
    notes = Notes()
    copies: list[tuple[bpy.types.Object, bpy.types.Mesh]] = []
    prepared: list[tuple[bpy.types.Mesh, str]] = []
    with undone_on_failure() as undo:
        undo.callback(rejoin, copies)
        undo.callback(staged.discard)
        separate(objects, copies, notes)
        for ob in objects:
            prepared.append((ob.data, uv_layer.prepare(ob.data, name)))
            undo.callback(uv_layer.discard, ob.data, name, prepared[-1][1])
        image = staged.land()
    for (mesh, layer), values in zip(prepared, uv, strict=True):
        replaced = uv_layer.fill(mesh, layer, name, values)
        if replaced:
            notes.add(replaced)
    return image, notes.lines()
