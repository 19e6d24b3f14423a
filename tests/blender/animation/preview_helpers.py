"""A room with something that moves in it, and full bakes to compare Live Preview with."""

from __future__ import annotations

from contextlib import contextmanager

import bpy
import numpy as np

from obscurance_addon.blender.animation import frame_update
from tests.blender.helpers import bake, colors, cube, floor, sheet

FULL = "Full"
SETTINGS = {"rays": 16, "distance": 1.5}


def at(frame):
    bpy.context.scene.frame_set(frame)


def key(ob, frame, path, value):
    """Keyframe a property of an object."""
    setattr(ob, path, value)
    ob.keyframe_insert(path, frame=frame)


def baked_anew(objects, name=FULL, **changes):
    """Values (n, 4) of a full bake of the scene as it is, by object."""
    bake(*objects, attribute_name=name, corner_copy=False, **SETTINGS | changes)
    return {ob.name: colors(ob, name).copy() for ob in objects}


def assert_as_baked_anew(objects, **changes):
    shown = [ob for ob in objects if not ob.hide_render]
    for name, full in baked_anew(shown, **changes).items():
        ours = colors(bpy.data.objects[name])
        assert np.array_equal(ours, full), (name, np.abs(ours - full).max())


@contextmanager
def counted(monkeypatch):
    """Reports of all updates, in order."""
    reports, update = [], frame_update.FrameUpdater.update

    def spy(self, *args, **kw):
        reports.append(update(self, *args, **kw))
        return reports[-1]

    with monkeypatch.context() as patch:
        patch.setattr(frame_update.FrameUpdater, "update", spy)
        yield reports


def build_room(scene):
    """A room open to one side, with a red wall and two blocks; its size does not change whatever moves within."""
    made = {
        "Floor": floor(size=4.0, n=8, color=(0.6, 0.6, 0.6)),
        "Wall": sheet("Wall", (-2, 2, 0), (4, 0, 0), (0, 0, 2), 8, 4, color=(0.8, 0.1, 0.1)),
        "Mover": cube("Mover", 0.3, color=(0.2, 0.7, 0.2)),
        "Block": cube("Block", 0.25, color=(0.3, 0.3, 0.9)),
    }
    made["Mover"].location = (0.0, 0.0, 0.4)
    made["Block"].location = (1.2, -1.2, 0.3)
    group = scene.obscurance
    group.rays, group.distance_mode, group.distance = SETTINGS["rays"], "METRES", SETTINGS["distance"]
    return made
