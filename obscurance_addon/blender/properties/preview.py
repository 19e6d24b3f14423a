"""Settings of the live preview, which belong to a scene and are in no preset."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..animation import PREVIEW
from . import choices
from .options import FIXED, RELATIVE_PATH

DEFAULT_MEMORY_MIB = 1024


def _switched(self: PreviewProperties, _context: bpy.types.Context) -> None:
    """Start following the scene, or stop."""
    scene = self.id_data
    if not isinstance(scene, bpy.types.Scene):  # the defaults in the preferences follow nothing
        return
    PREVIEW.stop()
    if self.live_preview:
        scene.render.use_lock_interface = True  # values are written while frames render
        PREVIEW.prepare(scene)
        PREVIEW.on_change(scene, None)


def _changed(self: PreviewProperties, context: bpy.types.Context) -> None:
    if self.live_preview:
        _switched(self, context)


class PreviewProperties:
    """Part of `Scene.obscurance`."""

    live_preview: BoolProperty(
        name="Live Preview",
        description="Keep what is baked up to date while the scene plays, renders or is edited: the objects that hold "
        "a result of this name, or all that render if there is none. Locks the interface while rendering",
        default=False,
        options=FIXED,
        update=_switched,
    )
    preview_mode: EnumProperty(
        name="Follow",
        description="Choose which faces are baked again when something moves",
        items=choices.UPDATE_MODES,
        options=FIXED,
        update=_changed,
    )
    preview_memory: IntProperty(
        name="Memory",
        description="Memory for hits that stay the same from frame to frame, in MiB, about 8 bytes a ray. Where it "
        "is used up, updates take longer",
        default=DEFAULT_MEMORY_MIB,
        min=0,
        max=1 << 20,
        options=FIXED,
        update=_changed,
    )
    frame_cache: StringProperty(
        name="Frame Cache",
        description="Folder with the values of every frame, as the command line bakes them; played back without a ray. "
        "// is the folder of the .blend. Empty computes every frame",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
        update=_changed,
    )
