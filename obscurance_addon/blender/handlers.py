"""What happens when a file is opened or a new one begun; registering twice is harmless."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .bake_job import TRACERS
from .stored_preferences import stored_preferences
from .viewport_shading import forget_views


@persistent
def on_load(_path: str, _unused: object = None) -> None:
    """Forget what belonged to the other file; a new file starts with the user's defaults."""
    TRACERS.clear()
    forget_views()
    preferences = stored_preferences()
    if preferences is None or bpy.data.filepath:
        return
    for scene in bpy.data.scenes:
        if not scene.obscurance.changed():  # the user's startup file may have settings of its own
            scene.obscurance.assign(preferences.defaults.changed())


def register() -> None:
    """Listen to files being opened."""
    if on_load not in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.append(on_load)


def unregister() -> None:
    """Undo `register`, and let go of memory."""
    if on_load in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(on_load)
    TRACERS.clear()
    forget_views()
