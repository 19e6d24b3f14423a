"""No thread of the add-on exists while Blender's main thread does anything else than wait for it."""

import os
import signal
import sys
import threading

import bpy

ADDON = "bl_ext.user_default.obscurance_addon"
CORNER_LAYER = "Obscurance Color"


def no_threads_behind_blender(window):
    """A bake, an unwrapping and Live Preview: at no look there is a thread, and each has a child process."""
    yield from window.open("room_1423.blend")
    yield from window.sidebar()
    yield from window.select_all()
    scene = bpy.context.scene
    scene.obscurance.rays = 1024
    seen = set()
    bpy.ops.obscurance.bake("INVOKE_DEFAULT")
    yield from window.until(lambda: _look(seen) and _is_baked(), "the bake", 120.0)
    scene.obscurance.rays = 64
    scene.obscurance.target = "LIGHTMAP"
    bpy.ops.obscurance.bake("INVOKE_DEFAULT")
    yield from window.until(lambda: _look(seen) and "Obscurance" in bpy.data.images, "the lightmap", 120.0)
    scene.obscurance.target = "FACE"
    scene.obscurance.live_preview = True
    preview = _module("blender.animation.live_preview").PREVIEW
    yield from window.until(lambda: _look(seen) and preview.status == "Up to date", "the first bake", 120.0)
    for frame in (20, 21, 22):
        scene.frame_set(frame)
        _look(seen)
        assert "patches in" in preview.status or preview.status == "Up to date", preview.status
    scene.obscurance.live_preview = False
    yield 0.5
    _look(seen)
    assert seen == {"MainThread"}, seen


def a_child_that_is_killed(window):
    """By the system while it bakes: Blender lives and says so, and the next bake works."""
    yield from window.open("cornell_box.blend")
    yield from window.sidebar()
    yield from window.select_all()
    bpy.context.scene.obscurance.rays = 1 << 16
    bpy.ops.obscurance.bake("INVOKE_DEFAULT")
    child = _module("blender.jobs.job").CHILD
    yield from window.until(lambda: child._child is not None and child._last.progress > 0.05, "the child to work")
    os.kill(child._child.pid, signal.SIGKILL)
    yield from window.until(bpy.ops.obscurance.bake.poll, "the bake to end")
    yield from window.picture("child_killed")
    assert not _is_baked()
    bpy.context.scene.obscurance.rays = 16
    bpy.ops.obscurance.bake("INVOKE_DEFAULT")
    yield from window.until(_is_baked, "the next bake")


def _look(seen):
    seen.update(thread.name for thread in threading.enumerate() if not thread.name.startswith("Dummy"))
    return True


def _is_baked():
    return any(CORNER_LAYER in ob.data.attributes for ob in bpy.data.objects if ob.type == "MESH")


def _module(name):
    return sys.modules[f"{ADDON}.{name}"]
