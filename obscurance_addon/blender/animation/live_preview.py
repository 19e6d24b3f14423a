"""Live Preview: keeps what is baked equal to the scene while it plays, is scrubbed, edited or rendered.

In a window a child process computes; the first bake of obscurances is not waited for (light is, as it has no updates),
and edits are followed once they settle. In the background and in renders, where there are no timers, everything happens
within the frame change. Nothing of Blender's is kept but names and session uids, so that undo, deletion and loading
cannot leave a reference behind.

Within a frame change nothing is evaluated: Blender crashes when what was tagged there is, if visibility is keyed. (In
the background, where there is no later, `evaluate_in_handler` does it in the one way that Blender survives.) What is
written is evaluated after all handlers. No data-block is made either: made outside of an undo step, it makes the next
undo crash. So objects that share a mesh get meshes of their own when the preview is switched on, and those that come
to share one later show the mean.
"""

from __future__ import annotations

import time
from dataclasses import replace

import bpy

from ...core.errors import ObscuranceError
from ...core.light import LightSettings
from ...core.notes import Notes
from ...core.order import OutputSettings, Run, SharedMeshes, Target
from ...core.settings import BakeSettings
from ...core.updates import UpdateMode
from ..jobs import commit_count, is_baking
from ..writing import keeps_what_is_written, separate
from . import status_line
from .cache_playback import CachePlayback
from .followed_objects import preview_objects
from .frame_update import FrameUpdater
from .full_update import FullUpdater
from .preview_status import Said, update_notes, update_status
from .surroundings import evaluate_in_handler, in_edit_mode, is_playing, others_listen

_SETTLED_S = 0.15  # without a change before an edit is followed
_POLL_S = 0.05
_BUSY_S = 0.5  # until the next look while something else works on the scene


class LivePreview:
    """Follows one scene.

    Attributes
    ----------
    status : str
        What the last update did, or why there was none.
    """

    def __init__(self) -> None:
        self.status = ""
        self._updater: FrameUpdater | FullUpdater | None = None
        self._starting: tuple[FrameUpdater, Run] | None = None  # a first bake that is not done
        self._asked: tuple | None = None  # what the updater was made for
        self._forget()

    def _let_go(self) -> None:
        """End what follows the scene, or begins to."""
        for updater in (self._updater, self._starting and self._starting[0]):
            if updater is not None:
                updater.end()
        self._updater = self._starting = self._asked = None

    def _forget(self) -> None:
        self._let_go()
        self._said = Said()
        self._playback = CachePlayback(self._said.once)
        self._seen: tuple[int, int] | None = None
        self._followed: set[int] = set()
        self._rewrite = False
        self._commits = commit_count()
        self._busy = False
        self._changed_at = 0.0

    def stop(self) -> None:
        """Let go of everything; the values stay as they are."""
        self._forget()
        self.status = ""
        status_line.clear()
        for function in (_settle, _poll):
            if bpy.app.timers.is_registered(function):
                bpy.app.timers.unregister(function)

    def distrust(self) -> None:
        """After undo and redo: read everything again, and write all values."""
        self._rewrite = True
        self._playback.forget_shown()
        self._distrust_updater()

    def _distrust_updater(self) -> None:
        if self._updater is not None:
            self._updater.distrust()

    def prepare(self, scene: bpy.types.Scene) -> None:
        """Give each object that is followed a mesh of its own, within the undo step of who switches the preview on."""
        output = scene.obscurance.to_output()
        if scene == bpy.context.scene and output.shared_meshes is SharedMeshes.SEPARATE and not in_edit_mode():
            notes = Notes()
            followed = preview_objects(bpy.context, output.attribute_name)
            separate([ob for ob in followed if keeps_what_is_written(ob.data)], [], notes)
            for note in notes.lines():
                self._said.once(note)

    def on_frame(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """A frame was set; the only place from where values are written within a frame."""
        self._distrust_while_baking()
        if not self._follows(scene) or (depsgraph.mode == "RENDER" and scene.frame_subframe != 0.0):
            return
        view_layer = bpy.context.view_layer
        if depsgraph.view_layer.name != view_layer.name:
            if depsgraph.mode == "VIEWPORT" or view_layer.use or not bpy.app.background:  # its own may come too
                return
            view_layer.update()  # which a render in the background leaves out
            depsgraph = bpy.context.evaluated_depsgraph_get()
        if self._updater is not None and depsgraph.mode == "VIEWPORT":
            self._updater.note(depsgraph)
        elif self._updater is not None:  # of one that renders make anew for every frame
            self._updater.distrust()
        if in_edit_mode():  # where a mesh can neither be read nor written
            self.status = "Waiting for Edit Mode to end"
            if depsgraph.mode == "RENDER":
                self._said.once("frames that render while a mesh is in Edit Mode keep the values that they had")
            return
        if status_line.has_window() and self._updater is None and not self._playback.has(scene):
            self.on_change(scene, None)
            return
        if others_listen():
            self._distrust_updater()
            if bpy.app.background:
                evaluate_in_handler(depsgraph)
        self._bring_up_to_date(scene, depsgraph)
        if self._looks_later():
            self.on_change(scene, None)

    def _looks_later(self) -> bool:
        """Whether there is more to follow when frames have settled than was in the frame."""
        return status_line.has_window() and (others_listen() or is_playing())

    def on_change(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None) -> None:
        """Something changed outside of a frame change: follow it once it settles."""
        self._distrust_while_baking()
        if not scene.obscurance.live_preview or self._busy or scene != bpy.context.scene:
            return
        if depsgraph is not None and self._updater is not None:
            self._updater.note(depsgraph)
        self._changed_at = time.perf_counter()
        if not bpy.app.background and not bpy.app.timers.is_registered(_settle):
            bpy.app.timers.register(_settle, first_interval=_SETTLED_S)

    def _distrust_while_baking(self) -> None:
        """What happens during a bake, which may be cancelled, is looked for afterwards."""
        if is_baking() and not self._busy:
            self._distrust_updater()

    def _follows(self, scene: bpy.types.Scene) -> bool:
        return scene.obscurance.live_preview and not self._busy and not is_baking() and scene == bpy.context.scene

    def settle(self) -> float | None:
        """Timer: start the preview, or follow an edit, as soon as nothing else goes on."""
        scene = bpy.context.scene
        if not scene.obscurance.live_preview:
            self.stop()
            return None
        waited = time.perf_counter() - self._changed_at
        if waited < _SETTLED_S:
            return _SETTLED_S - waited
        if is_baking() or self._starting is not None or bpy.app.is_job_running("RENDER") or in_edit_mode():
            return _BUSY_S
        bpy.context.view_layer.update()  # objects that were deleted are gone from it only then
        if self._playback.has(scene) or self._is_current(scene):
            if others_listen():
                self._distrust_updater()
            self._bring_up_to_date(scene, bpy.context.evaluated_depsgraph_get())
        else:
            self._busy = True
            try:
                self._start(scene, None)
            except BaseException:
                self._forget()
                raise
            finally:
                self._busy = False
                self._commits = commit_count()
        self._evaluate_written()
        return None

    def _evaluate_written(self) -> None:
        self._busy = True
        try:
            if self._updater is not None:
                self._updater.evaluate_written(bpy.context)
        finally:
            self._busy = False

    def _bring_up_to_date(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Make the values those of the scene as it is now, within this call."""
        self._busy = True
        try:
            if self._commits != commit_count():  # by the button, with whatever settings
                self.distrust()
            if self._playback.has(scene):
                self._rewrite = True  # what the updater wrote last is there no more
                self.status = self._playback.show(scene)
                return
            self._playback.forget_shown()
            if not self._is_current(scene) or self._has_new_objects(scene):
                self._start(scene, depsgraph)
            else:
                report = self._updater.update(bpy.context, depsgraph, self._rewrite)
                for note in update_notes(report, self._updater):
                    self._said.once(note)
                self.status = update_status(report)
            self._rewrite = False
        except ObscuranceError as error:
            self._give_up(error)
        except BaseException:
            self._forget()  # whatever is known may be half of it
            raise
        finally:
            self._busy = False
            self._commits = commit_count()
            status_line.redraw_panels()

    def _start(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None) -> None:
        """The full bake from which everything is followed; waited for where it is given the depsgraph of a frame."""
        asked = settings, output, light, mode, memory, _where = _asked_of(scene)
        self._let_go()
        in_child, updater = not bpy.app.background, None
        try:
            if output.target is Target.LIGHTMAP:
                raise ObscuranceError("a lightmap cannot follow the scene: choose another target for Live Preview")
            output = replace(output, shared_meshes=SharedMeshes.AVERAGE)
            objects = preview_objects(bpy.context, output.attribute_name)
            if light.needs_light:
                updater = FullUpdater(objects, settings, output, light, in_child)
                report = updater.update(bpy.context, depsgraph or bpy.context.evaluated_depsgraph_get())
                self._said.once(f"{report.full}: everything is baked anew at every change")
            else:
                ceiling = memory * (1 << 20)
                updater = FrameUpdater(bpy.context, objects, settings, output, ceiling, mode, in_child, depsgraph)
                if depsgraph is None:
                    self.status = "Baking once..."
                    self._starting = updater, updater.begin()
                    self._asked = asked
                    bpy.app.timers.register(_poll, first_interval=_POLL_S)
                    return
                updater.start()
        except ObscuranceError as error:
            if updater is not None:
                updater.end()
            self._give_up(error)
            return
        self._asked = asked
        self._follow(scene, updater)

    def _follow(self, scene: bpy.types.Scene, updater: FrameUpdater | FullUpdater) -> None:
        """The first bake is written."""
        self._updater = updater
        self._seen = len(bpy.context.view_layer.objects), commit_count()
        self._followed = updater.wanted | {
            ob.session_uid for ob in preview_objects(bpy.context, scene.obscurance.attribute_name)
        }
        self.status = "Following the scene"

    def poll(self) -> float | None:
        """Timer: take over the first bake once it is done."""
        if self._starting is None:
            return None
        updater, run = self._starting
        try:
            if not run.step(0.0):
                self.status = f"Baking once: {run.progress:.0%}"
                status_line.redraw_panels()
                return _POLL_S
            if is_baking() or self._busy or bpy.app.is_job_running("RENDER") or in_edit_mode():
                return _BUSY_S
            updater.take(run)
        except ObscuranceError as error:
            self._give_up(error)
            return None
        except BaseException:
            self._forget()
            raise
        self._starting = None
        for note in run.notes:
            self._said.once(note)
        self._follow(bpy.context.scene, updater)
        self.on_change(bpy.context.scene, None)  # what happened meanwhile
        status_line.redraw_panels()
        return None

    def _is_current(self, scene: bpy.types.Scene) -> bool:
        return self._updater is not None and self._asked == _asked_of(scene)

    def _has_new_objects(self, scene: bpy.types.Scene) -> bool:
        """Whether there are objects to follow that were not there, or not baked, when it began."""
        seen = len(bpy.context.view_layer.objects), commit_count()
        if seen == self._seen:
            return False
        self._seen = seen
        followed = _uids_to_follow(scene)
        has_new = not followed <= self._followed
        self._followed |= followed
        return has_new

    def _give_up(self, error: ObscuranceError) -> None:
        """Say why there is no preview; it is tried again at the next change."""
        self._let_go()
        self.status = str(error)
        self._said.once(str(error))


PREVIEW = LivePreview()


def _settle() -> float | None:  # timers tell functions apart by identity, which bound methods do not have
    return PREVIEW.settle()


def _poll() -> float | None:
    return PREVIEW.poll()


def _asked_of(
    scene: bpy.types.Scene,
) -> tuple[BakeSettings, OutputSettings, LightSettings, UpdateMode, int, tuple[int, str]]:
    group = scene.obscurance
    mode = UpdateMode(group.preview_mode)
    where = scene.session_uid, bpy.context.view_layer.name
    return group.to_settings(), group.to_output(), group.to_light(), mode, group.preview_memory, where


def _uids_to_follow(scene: bpy.types.Scene) -> set[int]:
    return {ob.session_uid for ob in preview_objects(bpy.context, scene.obscurance.attribute_name)}
