"""The sidebar panel: settings in the order in which an artist thinks: what, how far, how fine, where to."""

from __future__ import annotations

import bpy

from .operators import OBSCURANCE_OT_bake


class _Sidebar:
    """Where both panels stand."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Obscurances"


class OBSCURANCE_PT_bake(_Sidebar, bpy.types.Panel):
    """Bake obscurances"""

    bl_label = "Obscurances"
    bl_idname = "OBSCURANCE_PT_bake"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.obscurance
        meshes = [ob.name for ob in context.selected_objects if ob.type == "MESH"]

        column = layout.column()
        column.label(text=_what(meshes), icon="OBJECT_DATA")
        column.prop(settings, "use_bleeding")

        column = layout.column()
        column.label(text="How Far")
        column.prop(settings, "distance_mode")
        row = column.row()
        row.active = settings.distance_mode == "METRES"
        row.prop(settings, "distance")
        column.prop(settings, "falloff")

        column = layout.column()
        column.label(text="How Fine")
        row = column.row()
        row.active = settings.ray_budget == 0
        row.prop(settings, "rays")

        column = layout.column()
        column.label(text="Where To")
        column.prop(settings, "target")
        column.prop(settings, "attribute_name")
        if settings.target == "FACE":
            column.prop(settings, "corner_copy")
        column.prop(settings, "scale")
        column.prop(settings, "shared_meshes")

        layout.operator(OBSCURANCE_OT_bake.bl_idname, icon="RENDER_STILL")


class OBSCURANCE_PT_sampling(_Sidebar, bpy.types.Panel):
    """Settings that rarely need a change"""

    bl_label = "Sampling"
    bl_idname = "OBSCURANCE_PT_sampling"
    bl_parent_id = "OBSCURANCE_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("ray_budget", "sampler", "seed", "threads"):
            layout.prop(context.scene.obscurance, name)


def _what(meshes: list[str]) -> str:
    if not meshes:
        return "What: select mesh objects"
    return f"What: {meshes[0] if len(meshes) == 1 else f'{len(meshes)} mesh objects'}"


_CLASSES = (OBSCURANCE_PT_bake, OBSCURANCE_PT_sampling)


def register() -> None:
    """Register the panels."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
