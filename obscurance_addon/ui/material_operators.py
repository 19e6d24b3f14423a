"""The operator that makes materials show baked ambient light."""

from __future__ import annotations

import bpy

from ..blender.display import add_ambient, remove_ambient
from ..blender.reading import in_object_mode
from ..core.errors import ObscuranceError
from .operators import OnBakedMeshes


class OBSCURANCE_OT_apply_in_materials(OnBakedMeshes, bpy.types.Operator):
    """Show baked ambient light in the materials of the selected objects, or no longer"""

    bl_idname = "obscurance.apply_in_materials"
    bl_label = "Apply in Materials"
    bl_options = {"REGISTER", "UNDO"}

    action: bpy.props.EnumProperty(
        name="Action",
        description="Choose whether materials get ambient light or lose it again",
        items=[
            ("ADD", "Add", "Add the baked ambient light to what the materials show, by one node group in each"),
            ("REMOVE", "Remove", "Take the ambient light out again and leave the materials as they were"),
        ],
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return cls.bl_rna.properties["action"].enum_items[properties.action].description

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.obscurance
        try:
            with in_object_mode(context):
                if self.action == "REMOVE":
                    change = remove_ambient(context.selected_objects)
                else:
                    change = add_ambient(context.selected_objects, settings.to_output())
        except ObscuranceError as error:
            return self.fail(error)
        self.warn(change.notes)
        self._tell(context, change.objects, change.changed)
        return {"FINISHED"} if change.changed else {"CANCELLED"}

    def _tell(self, context: bpy.types.Context, objects: list[str], changed: bool) -> None:
        names = ", ".join(map(repr, objects))
        if not changed:
            self.report({"INFO"}, f"Nothing to do for {names}" if names else "Nothing to do: no material can show it")
        elif self.action == "REMOVE":
            self.report({"INFO"}, f"Ambient light is no longer shown by {names}")
        else:
            self.report({"INFO"}, f"Ambient light is shown by {names}")
            if context.scene.render.engine == "CYCLES" and context.scene.cycles.diffuse_bounces > 0:
                self.report(
                    {"WARNING"},
                    "Cycles adds indirect light of its own: set Diffuse to 0 in Render Properties > Light Paths > Max "
                    "Bounces, to see direct and baked ambient light",
                )


register, unregister = bpy.utils.register_classes_factory((OBSCURANCE_OT_apply_in_materials,))
