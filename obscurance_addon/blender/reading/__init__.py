"""Reads a scene from the evaluated depsgraph; the one step of a bake that needs Blender before its end.

In go a context and the objects to bake. Out comes a snapshot of plain arrays, with notes about what was left out.
"""

from .as_rendered import Modifiers, as_rendered
from .left_out import Reason, note_refused, nothing_to_bake, shape_reason
from .meshes import read_attribute, read_face_start, same_faces
from .object_mode import ObjectModeGuard, in_object_mode
from .objects import SOLID_TYPES, SceneReader, instance_key, materials_of, ray_visibility
from .scene import snapshot_scene
from .ties import tie
from .visibility import rendered_meshes

__all__ = [
    "SOLID_TYPES",
    "Modifiers",
    "ObjectModeGuard",
    "Reason",
    "SceneReader",
    "as_rendered",
    "in_object_mode",
    "instance_key",
    "materials_of",
    "note_refused",
    "nothing_to_bake",
    "ray_visibility",
    "read_attribute",
    "read_face_start",
    "rendered_meshes",
    "same_faces",
    "shape_reason",
    "snapshot_scene",
    "tie",
]
