"""Values of every frame of an animation on disk.

In go values of objects, frame by frame, and later the number of a frame. Out come the values that the meshes have then.
Nothing is believed of a cache that is read, and one that is written is there whole or not at all.
"""

from .cache_index import FrameCacheError
from .frame_cache import FrameCache, FrameCacheWriter

__all__ = ["FrameCache", "FrameCacheError", "FrameCacheWriter"]
