"""Preferences of the add-on: what belongs to a user and a machine rather than to a file."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty, PointerProperty

from ..blender.properties import ObscuranceSettings, property_again
from ..blender.stored_preferences import ADDON
from ..core.native_library import NAMES, why_missing
from .messages import draw_message, sentence
from .settings_layout import align_labels, draw_settings


class ObscurancePreferences(bpy.types.AddonPreferences):
    """Threads, memory, and the settings that new files begin with."""

    bl_idname = ADDON

    threads: property_again(
        "threads", description="Number of processors to use for scenes that leave it open. 0 uses all of them"
    )
    cache_ceiling: IntProperty(
        name="Cache Ceiling (MiB)",
        description="Memory, in MiB, that may be kept after a bake so that the next bake of the same geometry starts "
        "sooner. 0 keeps nothing",
        default=512,
        min=0,
        max=1 << 20,
        soft_max=16384,
    )
    defaults: PointerProperty(type=ObscuranceSettings)

    def draw(self, context: bpy.types.Context) -> None:
        layout = align_labels(self.layout)
        for name in NAMES:
            missing = why_missing(name)
            text = f"{name} is ready" if missing is None else sentence(missing)
            draw_message(layout, text, "CHECKMARK" if missing is None else "ERROR", context.region.width)
        layout.prop(self, "threads")
        layout.prop(self, "cache_ceiling")
        layout.label(text="New files begin with these settings")
        draw_settings(layout.box().column(), self.defaults)


register, unregister = bpy.utils.register_classes_factory((ObscurancePreferences,))
