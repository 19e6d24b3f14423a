"""Results that follow time: Live Preview, ranges of frames, and their exports.

In go a scene and what Blender tells of its changes. Out come values that equal those of a full bake at every frame.
"""

from . import handlers
from .animated_export import check_exportable
from .export_check import check_export
from .export_process import export_whole
from .followed_objects import objects_over_time
from .frame_range import FrameRange, bake_frames, play_back
from .live_preview import PREVIEW

__all__ = [
    "PREVIEW",
    "FrameRange",
    "bake_frames",
    "check_export",
    "check_exportable",
    "export_whole",
    "handlers",
    "objects_over_time",
    "play_back",
]
