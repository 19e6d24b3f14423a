"""How the settings are laid out, in the panel and in the preferences alike."""

from __future__ import annotations

import bpy


def align_labels(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """The same layout with labels in a column of their own, and no buttons to key values with."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def draw_settings(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Settings in the order in which an artist thinks: what, how far, how fine, where to."""
    layout.prop(settings, "quantity", text="What")
    if settings.quantity in {"AMBIENT", "COMBINED"}:
        column = layout.column()
        column.prop(settings, "ambient")
        column.prop(settings, "reflector_mode")
        if settings.reflector_mode == "NUMBER":
            column.prop(settings, "reflectors")
    elif settings.quantity == "RADIOSITY":
        layout.prop(settings, "indirect_only")
    row = layout.row()
    row.active = settings.quantity in {"OBSCURANCE", "AMBIENT", "COMBINED"}
    row.prop(settings, "use_bleeding")
    layout.prop(settings, "modifiers")

    column = layout.column()
    column.label(text="How Far")
    column.prop(settings, "distance_mode", text="Mode")
    row = column.row()
    row.active = settings.distance_mode == "METRES"
    row.prop(settings, "distance")
    column.prop(settings, "falloff")

    column = layout.column()
    column.label(text="How Fine")
    row = column.row()
    row.active = settings.ray_budget == 0
    row.prop(settings, "rays")

    if settings.target == "LIGHTMAP":
        _draw_lightmap_fineness(column, settings)

    column = layout.column()
    column.label(text="Where To")
    column.prop(settings, "target")
    if settings.target == "LIGHTMAP":
        _draw_lightmap(column, settings)
    else:
        column.prop(settings, "attribute_name")
        row = column.row()
        row.active = settings.target == "FACE"
        row.prop(settings, "corner_copy")
    column.prop(settings, "scale" if settings.quantity == "OBSCURANCE" else "exposure")
    if settings.target != "LIGHTMAP":
        column.prop(settings, "shared_meshes", text="Shared")


def _draw_lightmap_fineness(column: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    column.prop(settings, "resolution_mode")
    column.prop(settings, "lightmap_size")
    if settings.resolution_mode == "DENSITY":
        column.prop(settings, "texels_per_metre")
    column.prop(settings, "adaptive")
    row = column.row()
    row.active = settings.adaptive
    row.prop(settings, "error_bound")


def _draw_lightmap(column: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    column.prop(settings, "attribute_name", text="Name")
    column.prop(settings, "image_path")
    column.prop(settings, "image_format")
    column.prop(settings, "uv_mode")
    if settings.uv_mode == "KEEP":
        column.prop(settings, "uv_map")
    else:
        column.prop(settings, "unwrapper")
    column.prop(settings, "margin")
