"""Presets of the settings, and the user's defaults."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..blender.properties import setting_names
from ..blender.stored_preferences import stored_preferences

_FOLDER = "obscurance_addon/bake"  # below every folder of presets
_OWN = str(Path(__file__).parent.parent)  # has presets/obscurance_addon/bake, with those that come with the add-on
_NOT_IN_PRESETS = {"threads", "attribute_name"}  # they belong to a machine and a file


class OBSCURANCE_OT_add_preset(AddPresetBase, bpy.types.Operator):
    """Save the bake settings as a preset, or remove the chosen one"""

    bl_idname = "obscurance.add_preset"
    bl_label = "Add Obscurance Preset"
    preset_menu = "OBSCURANCE_PT_presets"
    preset_subdir = _FOLDER
    preset_defines = ["settings = bpy.context.scene.obscurance"]

    @property
    def preset_values(self) -> list[str]:
        return [f"settings.{name}" for name in setting_names() if name not in _NOT_IN_PRESETS]


class OBSCURANCE_OT_apply_defaults(bpy.types.Operator):
    """Set all bake settings of this scene to the defaults from the preferences of the add-on"""

    bl_idname = "obscurance.apply_defaults"
    bl_label = "Reset to Defaults"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        preferences = stored_preferences()
        context.scene.obscurance.assign(preferences.defaults.changed() if preferences else {})
        return {"FINISHED"}


class OBSCURANCE_OT_store_defaults(bpy.types.Operator):
    """Make the bake settings of this scene the defaults for new files"""

    bl_idname = "obscurance.store_defaults"
    bl_label = "Save as Defaults"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if stored_preferences() is None:
            cls.poll_message_set("The add-on has no preferences here: enable it in the preferences of Blender")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        stored_preferences().defaults.assign(context.scene.obscurance.changed())
        context.preferences.is_dirty = True  # so that Blender saves them as it saves all preferences
        self.report({"INFO"}, "New files begin with these settings")
        return {"FINISHED"}


class OBSCURANCE_PT_presets(PresetPanel, bpy.types.Panel):
    """Presets of the bake settings"""

    bl_label = "Obscurance Presets"
    preset_subdir = _FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = OBSCURANCE_OT_add_preset.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        super().draw(context)
        self.layout.separator()
        self.layout.operator(OBSCURANCE_OT_apply_defaults.bl_idname)
        self.layout.operator(OBSCURANCE_OT_store_defaults.bl_idname)


_CLASSES = (
    OBSCURANCE_OT_add_preset,
    OBSCURANCE_OT_apply_defaults,
    OBSCURANCE_OT_store_defaults,
    OBSCURANCE_PT_presets,
)


def register() -> None:
    """Register operators and panel, and the presets that come with the add-on."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.utils.register_preset_path(_OWN)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_preset_path(_OWN)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
