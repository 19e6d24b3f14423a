"""The sidebar panels and the menu."""

from __future__ import annotations

import bpy

from ..blender.animation import PREVIEW
from ..blender.display import shows_ambient, shows_result
from ..blender.writing import INDIRECT, indirect_exposure, what_is_stored
from ..core.native_library import why_missing
from .material_operators import OBSCURANCE_OT_apply_in_materials
from .messages import draw_message, sentence
from .operators import OBSCURANCE_OT_bake
from .presets import OBSCURANCE_PT_presets
from .result_operators import OBSCURANCE_OT_copy_for_export, OBSCURANCE_OT_show_result
from .settings_layout import align_labels, draw_settings


class _Sidebar:
    """Where the panels stand."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Obscurances"


class _Inner(_Sidebar):
    """Panels inside of the first one."""

    bl_parent_id = "OBSCURANCE_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}


class OBSCURANCE_PT_bake(_Sidebar, bpy.types.Panel):
    """Bake obscurances"""

    bl_label = "Obscurances"
    bl_idname = "OBSCURANCE_PT_bake"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        OBSCURANCE_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = align_labels(self.layout)
        if missing := why_missing("embreex"):
            draw_message(layout.box(), sentence(f"the ray tracer {missing}"), "ERROR", context.region.width)
        settings = context.scene.obscurance
        unwraps = settings.target == "LIGHTMAP" and settings.uv_mode == "UNWRAP"
        if unwraps and (missing := why_missing(settings.unwrapper.lower())):
            draw_message(layout.box(), sentence(f"the unwrapper {missing}"), "ERROR", context.region.width)
        meshes = [ob.name for ob in context.selected_objects if ob.type == "MESH"]
        layout.label(text=_what(meshes), icon="OBJECT_DATA")
        draw_settings(layout, settings)
        column = layout.column()
        column.scale_y = 1.3
        column.operator(OBSCURANCE_OT_bake.bl_idname, icon="RENDER_STILL")
        shown = shows_result(context.space_data)
        layout.operator(
            OBSCURANCE_OT_show_result.bl_idname,
            text="Hide Result" if shown else "Show Result",
            icon="HIDE_OFF" if shown else "HIDE_ON",
            depress=shown,
        )
        first = next((ob for ob in context.selected_objects if ob.type == "MESH"), None)
        applied = first is not None and shows_ambient(first)
        ready = first is not None and indirect_exposure(first.data, settings.attribute_name) is not None
        if applied or ready or what_is_stored(settings.to_light()) == INDIRECT:
            layout.operator(
                OBSCURANCE_OT_apply_in_materials.bl_idname,
                text="Remove from Materials" if applied else "Apply in Materials",
                icon="MATERIAL",
                depress=applied,
            ).action = "REMOVE" if applied else "ADD"


class OBSCURANCE_PT_preview(_Inner, bpy.types.Panel):
    """Keeps the result up to date while the scene changes"""

    bl_label = "Live Preview"
    bl_idname = "OBSCURANCE_PT_preview"

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.obscurance, "live_preview", text="")

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = align_labels(self.layout), context.scene.obscurance
        if settings.live_preview and PREVIEW.status:
            draw_message(layout, sentence(PREVIEW.status), "INFO", context.region.width)
        if settings.live_preview and not context.scene.render.use_lock_interface:
            layout.prop(context.scene.render, "use_lock_interface", text="Lock Interface in Renders", icon="ERROR")
        column = layout.column()
        column.active = not settings.frame_cache
        column.prop(settings, "preview_mode")
        column.prop(settings, "preview_memory", text="Memory (MiB)")
        layout.prop(settings, "frame_cache")


class OBSCURANCE_PT_sampling(_Inner, bpy.types.Panel):
    """Settings that rarely need a change"""

    bl_label = "Sampling"
    bl_idname = "OBSCURANCE_PT_sampling"

    def draw(self, context: bpy.types.Context) -> None:
        layout = align_labels(self.layout)
        for name in ("ray_budget", "sampler", "seed", "threads"):
            layout.prop(context.scene.obscurance, name)


class OBSCURANCE_PT_export(_Inner, bpy.types.Panel):
    """Copies of the result for other programs"""

    bl_label = "Export"
    bl_idname = "OBSCURANCE_PT_export"

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.operator_enum(OBSCURANCE_OT_copy_for_export.bl_idname, "format")


class OBSCURANCE_MT_object(bpy.types.Menu):
    """Obscurances of the selected objects"""

    bl_label = "Obscurances"
    bl_idname = "OBSCURANCE_MT_object"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator(OBSCURANCE_OT_bake.bl_idname, icon="RENDER_STILL")
        layout.operator(OBSCURANCE_OT_show_result.bl_idname)
        layout.operator_menu_enum(OBSCURANCE_OT_apply_in_materials.bl_idname, "action")
        layout.operator_menu_enum(OBSCURANCE_OT_copy_for_export.bl_idname, "format")


def draw_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Entry of the Object menu."""
    self.layout.separator()
    self.layout.menu(OBSCURANCE_MT_object.bl_idname)


def _what(meshes: list[str]) -> str:
    if not meshes:
        return "Select mesh objects"
    return meshes[0] if len(meshes) == 1 else f"{len(meshes)} mesh objects"


_CLASSES = (
    OBSCURANCE_PT_bake,
    OBSCURANCE_PT_preview,
    OBSCURANCE_PT_sampling,
    OBSCURANCE_PT_export,
    OBSCURANCE_MT_object,
)


def register() -> None:
    """Register the panels and the menu."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.VIEW3D_MT_object.append(draw_menu)


def unregister() -> None:
    """Undo `register`."""
    bpy.types.VIEW3D_MT_object.remove(draw_menu)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
