"""Random edits of a scene while Live Preview follows it, each compared with a full bake."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
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
    """Whether there was anything to compare; raises DifferenceError where a layer holds other than a full bake gives.

    Where a ray meets two faces of different colour at the very same distance, as on the edge between them, either bake
    may take either. Such patches are known by this: they change with the order in which a full bake holds the objects.
    """
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

    def full_bake(movers: Iterable[Hashable] = ()) -> dict[Hashable, np.ndarray]:
        mode, held = UpdateMode.EXACT, updater._last.held
        order = FollowOrder(changes, updater._settings, output, set(movers), 0, mode, held)
        return Following(order).first().values

    full = full_bake()
    users: dict[str, list] = {}
    by_uid = {ob.session_uid: ob for ob in objects}
    for baked in taken.baked:
        users.setdefault(by_uid[baked.session_uid].data.name, []).append((baked.snapshot.name, baked.snapshot.key))
    for mesh, members in users.items():
        expected = np.mean([full[key] for _name, key in members], axis=0)
        ours = read(bpy.data.meshes[mesh], FACE_LAYER)[:, :3]
        if ours.shape == expected.shape:
            differs = (ours != expected.astype(np.float32)).any(1)
            if differs.any():
                others = [full_bake(movers) for movers in ([key] for key in changes)] + [full_bake(changes)]
                for key in (key for _name, key in members):
                    differs &= ~np.any([(other[key] != full[key]).any(1) for other in others], axis=0)
            if not differs.any():
                continue
        worst = np.abs(ours - expected).max() if ours.shape == expected.shape else f"{ours.shape}, {expected.shape}"
        raise DifferenceError(f"after '{name}' {members[0][0]} is off by {worst}, status '{PREVIEW.status}'")
    return True
