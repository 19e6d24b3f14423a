"""Writes results: attributes, lightmaps, UV maps, copies for exporters, and the record of what each layer holds.

In go objects and arrays of values. Out come changed meshes, images and files, whole or not at all.
"""

from . import color_attribute, records, uv_layer
from .color_attribute import is_color, keeps_what_is_written
from .export_copy import LAYERS, ExportFormat, ExportLayer, check_export_name, copy_for_export
from .image_files import absolute_path, check_path, tiled_path
from .lightmap import write_lightmap
from .records import INDIRECT, indirect_exposure, is_own_color, lightmap_of, what_is_stored
from .values import has_layers, refresh_values, separate, shared_meshes, spread, write_values

__all__ = [
    "INDIRECT",
    "LAYERS",
    "ExportFormat",
    "ExportLayer",
    "absolute_path",
    "check_export_name",
    "check_path",
    "color_attribute",
    "copy_for_export",
    "has_layers",
    "indirect_exposure",
    "is_color",
    "is_own_color",
    "keeps_what_is_written",
    "lightmap_of",
    "records",
    "refresh_values",
    "separate",
    "shared_meshes",
    "spread",
    "tiled_path",
    "uv_layer",
    "what_is_stored",
    "write_lightmap",
    "write_values",
]
