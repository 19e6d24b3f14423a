"""Copies a baked result into the kind of layer that an exporter turns into the format's own display colour.

What Blender's exporters take was measured in 4.2, 4.5 and 5.0 by exporting and importing again:
glTF writes the default colour as COLOR_0, in 16 bits of 0 .. 1 (4.2 lets larger values overflow); USD writes float
colours by their name, and its display colour has the name displayColor; Alembic writes byte colours only, and
programs that read it look for Cd.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.order import OutputSettings
from . import color_attribute
from .layers import check_free, undone_on_failure


class ExportFormat(enum.StrEnum):
    """File formats that need a copy of their own."""

    GLTF = "GLTF"
    USD = "USD"
    ALEMBIC = "ALEMBIC"


@dataclass(frozen=True)
class ExportLayer:
    """A face corner colour attribute as one exporter wants it; `limited` ones hold 0 .. 1 only."""

    name: str
    data_type: str
    limited: bool


LAYERS = {
    ExportFormat.GLTF: ExportLayer("COLOR_0", "FLOAT_COLOR", limited=True),
    ExportFormat.USD: ExportLayer("displayColor", "FLOAT_COLOR", limited=False),
    ExportFormat.ALEMBIC: ExportLayer("Cd", "BYTE_COLOR", limited=True),
}


def check_export_name(ob: bpy.types.Object, export_format: ExportFormat) -> None:
    """Make sure that a copy for a format replaces nothing of the user's; raises AttributeNameError."""
    check_free(ob, LAYERS[export_format].name, "a copy for export", cure="")


def copy_for_export(
    objects: Iterable[bpy.types.Object], output: OutputSettings, export_format: ExportFormat
) -> tuple[list[str], int, list[str]]:
    """Copy the baked result of objects into the layer for a format, on all of them or on none.

    Parameters
    ----------
    objects : iterable of bpy.types.Object
        In object mode. Those without a result are passed over.
    output : OutputSettings
        Where the result is.
    export_format : ExportFormat

    Returns
    -------
    names : list of str
        Objects whose mesh has the layer now.
    cut : int
        Number of face corners whose colour was above 1 and was cut off there.
    replaced : list of str
        Results of that name but another kind that had to go, in words.

    Raises
    ------
    ObscuranceError
        When no object has a result that can be copied, or a layer of the user's has the name; nothing is copied then.
    """
    layer = LAYERS[export_format]
    if output.attribute_name == layer.name:
        raise ObscuranceError(
            f"the copy would replace the result itself, '{layer.name}': bake to another attribute name"
        )
    target = output.target.value
    users: dict[int, list[bpy.types.Object]] = {}
    for ob in objects:
        if (
            ob.type == "MESH"
            and color_attribute.keeps_what_is_written(ob.data)
            and color_attribute.is_color(ob.data, output.attribute_name, target)
        ):
            check_export_name(ob, export_format)
            users.setdefault(ob.data.session_uid, []).append(ob)
    if not users:
        raise ObscuranceError(
            f"no selected object has a baked attribute '{output.attribute_name}' on its "
            f"{target.lower()}s that could be copied: bake first, with target and attribute as they are set now"
        )
    meshes = [obs[0].data for obs in users.values()]
    prepared: list[tuple[bpy.types.Mesh, str]] = []
    with undone_on_failure() as undo:
        for mesh in meshes:
            prepared.append((mesh, color_attribute.prepare(mesh, layer.name, "CORNER", layer.data_type)))
            undo.callback(color_attribute.discard, mesh, layer.name, prepared[-1][1])
    cut, replaced = 0, []
    for mesh, made in prepared:
        colours = _corner_colours(mesh, output.attribute_name)
        if layer.limited:
            cut += np.count_nonzero((colours > 1.0).any(1))
            colours = np.clip(colours, 0.0, 1.0)
        replaced.append(color_attribute.fill(mesh, made, layer.name, colours))
        if export_format is ExportFormat.GLTF:
            mesh.attributes.default_color_name = layer.name
    return [ob.name for obs in users.values() for ob in obs], int(cut), list(filter(None, replaced))


def _corner_colours(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """Colours of an attribute of any domain at the face corners, (c, 3) float32."""
    attribute = mesh.attributes[name]
    rgba = np.empty(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", rgba)
    colours = rgba.reshape(-1, 4)[:, :3]
    if attribute.domain == "FACE":
        corners = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", corners)
        return np.repeat(colours, corners, axis=0)
    if attribute.domain == "POINT":
        vertex = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", vertex)
        return colours[vertex]
    return colours
