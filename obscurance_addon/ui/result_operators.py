"""Operators on a baked result: show it in the viewport, copy it for an exporter."""

from __future__ import annotations

from contextlib import nullcontext

import bpy

from ..blender.display import activate_result, hide_result, lightmaps_are_shown, show_result, shows_result
from ..blender.properties import EXPORT_FORMATS
from ..blender.reading import in_object_mode
from ..blender.writing import LAYERS, ExportFormat, copy_for_export
from ..core.errors import ObscuranceError
from ..core.order import OutputSettings, Target
from .messages import Reports
from .operators import OnBakedMeshes


class OBSCURANCE_OT_show_result(Reports, bpy.types.Operator):
    """Show the baked result alone in this 3D view, without lights. Press again to get the former shading back"""

    bl_idname = "obscurance.show_result"
    bl_label = "Show Obscurances"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.space_data is None or context.space_data.type != "VIEW_3D":
            cls.poll_message_set("Use it in a 3D view")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        output = context.scene.obscurance.to_output()
        hides = shows_result(context.space_data)
        touches_slots = lightmaps_are_shown() if hides else output.target is Target.LIGHTMAP
        with in_object_mode(context) if touches_slots else nullcontext():
            changed = hide_result(context.space_data) if hides else self._show(context, output)
        if changed is None:
            return {"CANCELLED"}
        if changed:  # shading is not part of undo, what is active in meshes and materials is
            bpy.ops.ed.undo_push(message=self.bl_label)
        return {"FINISHED"}

    def _show(self, context: bpy.types.Context, output: OutputSettings) -> bool | None:
        """Whether the file was changed for it; None when there is nothing to show."""
        shown = activate_result(context.view_layer.objects, output)
        self.warn(shown.notes)
        if shown.count:
            show_result(context.space_data, output.target)
            return shown.changed
        if output.target is Target.LIGHTMAP:
            what = f"lightmap '{output.attribute_name}' to show: bake first"
        else:
            what = f"color '{output.layers()[0][0]}' to show: bake first, with target Faces switch Viewport Copy on"
        self.report({"ERROR"}, f"No object in this view layer has a {what}")
        return None


class OBSCURANCE_OT_copy_for_export(OnBakedMeshes, bpy.types.Operator):
    """Copy the baked result of the selected objects into the color layer that an exporter understands"""

    bl_idname = "obscurance.copy_for_export"
    bl_label = "Copy for Export"
    bl_options = {"REGISTER", "UNDO"}

    format: bpy.props.EnumProperty(
        name="Format", description="Choose the file format to export to", items=EXPORT_FORMATS
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        export_format = ExportFormat(self.format)
        try:
            with in_object_mode(context):
                output = context.scene.obscurance.to_output()
                names, cut, replaced = copy_for_export(context.selected_objects, output, export_format)
        except ObscuranceError as error:
            return self.fail(error)
        layer = LAYERS[export_format].name
        self.report({"INFO"}, f"Copied to '{layer}': {', '.join(map(repr, names))}")
        self.warn(replaced)
        if cut:
            self.report({"WARNING"}, f"{cut:,} face corners were brighter than 1, which '{layer}' cannot hold")
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((OBSCURANCE_OT_show_result, OBSCURANCE_OT_copy_for_export))
