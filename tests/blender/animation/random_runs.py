"""Random edits of a scene while Live Preview follows it, each compared with a full bake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from obscurance_addon.blender.animation.frame_update import FrameUpdater
from obscurance_addon.blender.animation.live_preview import PREVIEW, LivePreview
from obscurance_addon.blender.reading import snapshot_scene
from obscurance_addon.core.errors import GeometryError
from obscurance_addon.core.order import Change, FollowOrder
from obscurance_addon.core.order.following import Following
from obscurance_addon.core.updates import UpdateMode
from tests.blender.animation.random_edits import RandomEdits
from tests.blender.helpers import FACE_LAYER, read

_HANDLERS = ("on_frame", "on_change", "distrust")


class DifferenceError(AssertionError):
    """What is shown is not what a full bake gives."""


def run(steps: int, seed: int, folder: Path, tell: Callable[[str], None] | None = None) -> int:
    """Edit a scene at random; the number of comparisons with a full bake.

    Parameters
    ----------
    steps, seed : int
    folder : Path
        For files that are saved and loaded.
    tell : callable, optional
        Hears of every edit.

    Raises
    ------
    DifferenceError
        What is shown is not what a full bake gives; says after which edit, and which object.
    Exception
        What a handler raised, which Blender would only print.
    """
    raised: list[BaseException] = []
    methods = {name: getattr(LivePreview, name) for name in _HANDLERS}

    def caught(method: Callable) -> Callable:
        def call(*arguments: object) -> None:
            try:
                method(*arguments)
            except BaseException as error:
                raised.append(error)

        return call

    for name, method in methods.items():
        setattr(LivePreview, name, caught(method))
    compared = 0
    try:
        edits = RandomEdits(seed, folder)
        for _ in range(steps):
            done = edits.edit()
            if tell is not None:
                tell(done)
            if edits.happens(0.7):
                edits.set_frame()
                compared += compare(done)
            edits.push(done)  # as the window does; what is made outside of a step can crash Blender at the next undo
            if raised:
                raise raised[0]
    finally:
        for name, method in methods.items():
            setattr(LivePreview, name, method)
        PREVIEW.stop()
    return compared


def compare(name: str) -> bool:
    """Raises Difference where a layer does not hold what a full bake gives now."""
    updater = PREVIEW._updater
    if not isinstance(updater, FrameUpdater):
        return False
    bpy.context.view_layer.update()
    output = updater._output
    objects = [ob for ob in bpy.context.view_layer.objects if ob.session_uid in updater.wanted]
    try:
        taken = snapshot_scene(bpy.context, objects, output.needs_rest, output.layer_names())
    except GeometryError:  # all that is baked is hidden
        return False
    changes = {b.snapshot.key: Change(b.snapshot, b) for b in taken.baked}
    changes.update({ob.key: Change(ob, None) for ob in taken.occluders})
    mode, held = UpdateMode.EXACT, updater._last.held
    full = Following(FollowOrder(changes, updater._settings, output, set(), 0, mode, held)).first()
    users: dict[str, list] = {}
    by_uid = {ob.session_uid: ob for ob in objects}
    for baked in taken.baked:
        users.setdefault(by_uid[baked.session_uid].data.name, []).append((baked.snapshot.name, baked.snapshot.key))
    for mesh, members in users.items():
        expected = np.mean([full.values[key] for _name, key in members], axis=0)
        ours = read(bpy.data.meshes[mesh], FACE_LAYER)[:, :3]
        if not np.array_equal(ours, expected.astype(np.float32)):
            worst = np.abs(ours - expected).max() if ours.shape == expected.shape else ours.shape
            raise DifferenceError(f"after '{name}' {members[0][0]} is off by {worst}, status '{PREVIEW.status}'")
    return True
