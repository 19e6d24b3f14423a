"""What else goes on in Blender while a scene is followed."""

from __future__ import annotations

import bpy

from ..stored_preferences import ADDON


def others_listen() -> bool:
    """Whether anything but this add-on may change the scene when a frame is set."""
    handlers = (*bpy.app.handlers.frame_change_pre, *bpy.app.handlers.frame_change_post)
    modules = [getattr(handler, "__module__", None) or "" for handler in handlers]
    return any(module != ADDON and not module.startswith(f"{ADDON}.") for module in modules)


def is_playing() -> bool:
    """Whether an animation plays in a window."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


def in_edit_mode() -> bool:
    return any(mesh.is_editmode for mesh in bpy.data.meshes)


def evaluate_in_handler(depsgraph: bpy.types.Depsgraph) -> None:
    """Evaluate within a frame handler what other handlers changed.

    Blender does that after all handlers, and tells no one. It crashes at it where visibility is keyed, unless it sorts
    all anew.
    """
    depsgraph.debug_tag_update()
    depsgraph.update()
