"""Reads materials: node trees and images become shadings that need no Blender.

In go materials, images and meshes of Blender. Out come `Shading`, `Texture` and `SurfaceArrays` of `core.shading`, and
notes about what could not be read.
"""

from .nodes import Input, Output, UnreadableNodeError, node_tree_of
from .pixel_watch import PixelWatch
from .snapshot import snapshot_material
from .surfaces import read_surface
from .textures import ImageCache
from .tree_reader import TreeReader

__all__ = [
    "ImageCache",
    "Input",
    "Output",
    "PixelWatch",
    "TreeReader",
    "UnreadableNodeError",
    "node_tree_of",
    "read_surface",
    "snapshot_material",
]
