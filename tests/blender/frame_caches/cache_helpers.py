"""Frame caches made without a bake, as they are written today and as version 1 wrote them."""

import json

import numpy as np

from obscurance_addon.blender.frame_caches.frame_cache import FrameCache, FrameCacheWriter
from obscurance_addon.core.order import OutputSettings

SIZES = {"Floor": 16, "Block": 6, "Far": 4}
FRAMES = (1, 4)


def values(seed, last=FRAMES[1]):
    """For each frame the values (n, 3) of the objects that change in it: one of them in the first frame only."""
    generator = np.random.default_rng(seed)
    return {
        frame: {
            name: generator.random((count, 3), np.float32)
            for name, count in SIZES.items()
            if frame == FRAMES[0] or name != "Far"
        }
        for frame in range(FRAMES[0], last + 1)
    }


def write(folder, frames, corner_copy=False):
    """Write a cache as a bake does."""
    writer = FrameCacheWriter(folder, OutputSettings(corner_copy=corner_copy), "OBSCURANCE", {"rays": 1})
    try:
        for frame, changed in frames.items():
            writer.add(frame, changed)
        writer.finish()
    finally:
        writer.discard()


def write_version_1(folder, frames):
    """Write a cache as version 1 of its format, with the files of frames beside the index."""
    folder.mkdir()
    objects = {}
    for frame, changed in frames.items():
        arrays = {str(i): colours for i, colours in enumerate(changed.values())}
        np.savez(folder / f"frame_{frame:06d}.npz", names=np.array(json.dumps(list(changed))), **arrays)
        for name in changed:
            objects.setdefault(name, []).append(frame)
    output = {"target": "FACE", "attribute_name": "Obscurance", "scale": "WHITE", "corner_copy": False, "exposure": 0.0}
    index = {"version": 1, "stored": "OBSCURANCE", "output": output, "settings": {}}
    index |= {"frames": [min(frames), max(frames)], "objects": objects}
    (folder / "index.json").write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")


def holds(folder, frames):
    """Whether the cache in a folder has exactly these values."""
    cache = FrameCache.open(folder)
    return cache.frames == (min(frames), max(frames)) and all(
        np.array_equal(found, changed[name])
        for frame, changed in frames.items()
        for name, found in cache._load(frame, {name: len(part) for name, part in changed.items()}).items()
    )
