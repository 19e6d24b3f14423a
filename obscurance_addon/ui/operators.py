"""The Bake operator: modal with progress in a window, blocking everywhere else."""

from __future__ import annotations

import bpy

from ..blender.jobs import BakeJob
from ..blender.properties import property_again
from ..blender.reading import SOLID_TYPES, ObjectModeGuard, in_object_mode
from ..core.errors import ObscuranceError
from ..core.native_library import why_missing
from ..core.order import BakeReport
from .messages import Reports, sentence

_TICK_S = 0.05  # between looks at the job
_POLL_S = 0.001  # what a look may wait
_ADJUST_S = 3.0  # a bake that took longer is not repeated at every touch of Adjust Last Operation

# Settings that a call may replace and Adjust Last Operation shows; not remembered for the next call.
_ADJUSTABLE = ("quantity", "use_bleeding", "distance_mode", "distance", "falloff", "rays", "scale")


class OBSCURANCE_OT_bake(Reports, bpy.types.Operator):
    """The Bake button."""

    bl_idname = "obscurance.bake"
    bl_label = "Bake Obscurances"
    bl_description = (
        "Bake obscurances of the selected mesh objects into a color attribute or a lightmap. Everything else that "
        "renders shades and tints them. Esc cancels"
    )
    bl_options = {"REGISTER", "UNDO"}

    _running = False  # on the class: a second bake would find the scene in the middle of the first one

    _job: BakeJob | None = None
    _guard: ObjectModeGuard | None = None
    _timer: bpy.types.Timer | None = None

    seconds: bpy.props.FloatProperty(options={"HIDDEN", "SKIP_SAVE"})  # what the last run of this call took

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if missing := why_missing("embreex"):
            cls.poll_message_set(sentence(f"the ray tracer {missing}"))
            return False
        if OBSCURANCE_OT_bake._running:
            cls.poll_message_set("A bake is running; press Esc to cancel it")
            return False
        if not any(ob.type == "MESH" for ob in context.selected_objects):
            cls.poll_message_set("Select at least one mesh object to bake")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake to the end before returning, for scripts and background mode."""
        try:
            with in_object_mode(context):
                report = self._start(context).run()
        except ObscuranceError as error:
            return self.fail(error)
        self._tell(report)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Bake while the window stays usable; Esc cancels."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        self._guard = ObjectModeGuard(context)
        try:
            self._job = self._start(context, in_child=True)
        except BaseException as error:
            return self._fail(context, error)
        OBSCURANCE_OT_bake._running = True
        manager = context.window_manager
        manager.progress_begin(0.0, 100.0)
        self._timer = manager.event_timer_add(_TICK_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, "Bake cancelled, nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if not self._job.step(_POLL_S):
                self._show_progress(context)
                return {"PASS_THROUGH"}
            with in_object_mode(context):  # the user may have changed the mode meanwhile
                report = self._job.commit()
        except BaseException as error:
            return self._fail(context, error)
        self._finish(context)
        self._tell(report)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop the job and leave the scene as it was; Blender also calls this when a file is loaded or it quits."""
        try:
            if self._job is not None:
                self._job.cancel()
        finally:
            self._finish(context)

    def draw(self, _context: bpy.types.Context) -> None:
        """Adjust Last Operation: every change bakes again, so only a quick bake offers it."""
        layout = self.layout
        layout.use_property_split = True
        if self.seconds > _ADJUST_S:
            layout.label(text="Change the settings in the panel, and bake again", icon="INFO")
            return
        for name in _ADJUSTABLE:
            row = layout.row()
            row.active = {
                "distance": self.distance_mode == "METRES",
                "scale": self.quantity == "OBSCURANCE",
            }.get(name, True)
            row.prop(self, name)

    def _start(self, context: bpy.types.Context, in_child: bool = False) -> BakeJob:
        group = context.scene.obscurance
        if self.properties.is_property_set("distance") and not self.properties.is_property_set("distance_mode"):
            self.distance_mode = "METRES"  # a script that gives a distance means it
        for name in _ADJUSTABLE:
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(group, name))
        changes = {name: getattr(self, name) for name in ("use_bleeding", "falloff", "rays")}
        changes["distance"] = None if self.distance_mode == "AUTO" else self.distance
        if self.rays != group.rays:
            changes["ray_budget"] = None  # as on the command line, rays for each patch replace a budget
        surfaces = [ob for ob in context.selected_objects if ob.type in SOLID_TYPES]  # not lights, cameras and the like
        return BakeJob(
            context,
            surfaces,
            group.to_settings(**changes),
            group.to_output(scale=self.scale),
            group.to_light(quantity=self.quantity),
            group.to_lightmap(),
            in_child,
            modifiers=group.to_modifiers(),
        )

    def _fail(self, context: bpy.types.Context, error: BaseException) -> set[str]:
        """Take everything down after an error; one that is meant for the user is reported, any other raised."""
        self._finish(context)
        if not isinstance(error, ObscuranceError):
            raise error
        return self.fail(error)

    def _show_progress(self, context: bpy.types.Context) -> None:
        remaining = self._job.remaining
        left = "" if remaining is None else f", {remaining:.0f} s left"
        context.window_manager.progress_update(100.0 * self._job.progress)
        context.workspace.status_text_set(f"Baking obscurances: {self._job.progress:.0%}{left}    Esc: Cancel")

    def _finish(self, context: bpy.types.Context) -> None:
        """Take down timer and status text and go back to the mode that the user was in."""
        timer, guard = self._timer, self._guard
        self._timer = self._guard = self._job = None
        OBSCURANCE_OT_bake._running = False  # first of all, or no bake could follow one whose end fails
        if timer is not None:
            context.window_manager.event_timer_remove(timer)
            context.window_manager.progress_end()
            for workspace in bpy.data.workspaces:  # the user may have switched between them
                workspace.status_text_set(None)
        if guard is not None:
            guard.restore(context)

    def _tell(self, report: BakeReport) -> None:
        self.seconds = sum(report.seconds.values())
        self.warn(report.warnings)
        self.report({"INFO"}, report.summary())


class OnBakedMeshes(Reports):
    """Part of operators that need a selected mesh object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not any(ob.type == "MESH" for ob in context.selected_objects):
            cls.poll_message_set("Select at least one mesh object that is baked")
            return False
        return True


for _name in _ADJUSTABLE:
    OBSCURANCE_OT_bake.__annotations__[_name] = property_again(_name, options={"SKIP_SAVE"})


register, unregister = bpy.utils.register_classes_factory((OBSCURANCE_OT_bake,))
