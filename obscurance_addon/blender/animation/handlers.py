"""What happens when a file is opened, a frame set, or something edited; registering twice is harmless."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..display import forget_views
from ..jobs import CHILD, TRACERS
from ..stored_preferences import stored_preferences
from .live_preview import PREVIEW


@persistent
def on_load(_path: str, _unused: object = None) -> None:
    """Forget what belonged to the other file; a new file starts with the user's defaults."""
    TRACERS.clear()
    CHILD.forget()
    forget_views()
    PREVIEW.stop()
    PREVIEW.on_change(bpy.context.scene, None)
    preferences = stored_preferences()
    if preferences is None or bpy.data.filepath:
        return
    for scene in bpy.data.scenes:
        if not scene.obscurance.changed():  # the user's startup file may have settings of its own
            scene.obscurance.assign(preferences.defaults.changed())


@persistent
def on_frame(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """A frame was set: by playback, scrubbing, a script or a render."""
    PREVIEW.on_frame(scene, depsgraph)


@persistent
def on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Something was evaluated anew."""
    PREVIEW.on_change(scene, depsgraph)


@persistent
def on_undo(scene: bpy.types.Scene, _unused: object = None) -> None:
    """All data may be other than it was, values that were written included."""
    PREVIEW.distrust()
    PREVIEW.on_change(scene, None)


_LISTS = (
    ("load_post", on_load),
    ("frame_change_post", on_frame),
    ("depsgraph_update_post", on_change),
    ("undo_post", on_undo),
    ("redo_post", on_undo),
)


def register() -> None:
    """Listen to Blender."""
    for name, handler in _LISTS:
        handlers = getattr(bpy.app.handlers, name)
        if handler not in handlers:
            handlers.append(handler)


def unregister() -> None:
    """Undo `register`, and let go of memory."""
    for name, handler in _LISTS:
        handlers = getattr(bpy.app.handlers, name)
        if handler in handlers:
            handlers.remove(handler)
    TRACERS.clear()
    CHILD.end()
    forget_views()
    PREVIEW.stop()
