"""Results that follow time: Live Preview, ranges of frames, and caches of these.

In go a scene and what Blender tells of its changes. Out come values that equal those of a full bake at every frame.
"""

from . import handlers
from .animated_export import check_export, export_animation
from .followed_objects import objects_over_time
from .frame_cache import FrameCache
from .frame_range import FrameRange, bake_frames, play_back
from .live_preview import PREVIEW

__all__ = [
    "PREVIEW",
    "FrameCache",
    "FrameRange",
    "bake_frames",
    "check_export",
    "export_animation",
    "handlers",
    "objects_over_time",
    "play_back",
]
