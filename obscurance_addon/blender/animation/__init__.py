"""Results that follow time: Live Preview, ranges of frames, and their exports.

In go a scene and what Blender tells of its changes. Out come values that equal those of a full bake at every frame.
"""

from . import handlers
from .animated_export import check_exportable
from .export_process import ExportError, export_in_process
from .followed_objects import objects_over_time
from .frame_range import FrameRange, bake_frames, play_back
from .live_preview import PREVIEW

__all__ = [
    "PREVIEW",
    "ExportError",
    "FrameRange",
    "bake_frames",
    "check_exportable",
    "export_in_process",
    "handlers",
    "objects_over_time",
    "play_back",
]
