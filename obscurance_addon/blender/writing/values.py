"""Puts the values of a bake into the scene, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Set

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.notes import Notes
from ...core.order import BakedObject, OutputSettings, SharedMeshes
from ..reading import same_faces
from . import color_attribute, records
from .layers import undone_on_failure

_AVERAGE = "with Shared Meshes set to Average they would share one result"


class SceneChangedError(ObscuranceError):
    """The scene was edited while the bake ran, so that its result has no place any more."""


def write_values(baked: list[BakedObject], values: list[np.ndarray], output: OutputSettings, stored: str) -> list[str]:
    """Put the values of all objects into attributes, and note that they are `stored`; on failure all is as it was."""
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}  # references do not survive an undo
    objects = [unchanged(b, by_uid.get(b.session_uid)) for b in baked]
    for ob in objects:
        for layer, _domain in output.layers():
            color_attribute.check_name(ob, layer)
    groups: dict[int, list[int]] = {}
    for i, ob in enumerate(objects):
        groups.setdefault(ob.data.session_uid, []).append(i)
    notes = Notes()
    copies: list[tuple[bpy.types.Object, bpy.types.Mesh]] = []
    prepared: list[str] = []
    with undone_on_failure() as undo:
        undo.callback(rejoin, copies)
        jobs = []
        for members in groups.values():
            if output.shared_meshes is SharedMeshes.AVERAGE:
                mean = np.mean([values[i] for i in members], axis=0)
                jobs.append((objects[members[0]].data, mean, baked[members[0]]))
                continue
            separate([objects[i] for i in members], copies, notes)
            jobs += [(objects[i].data, values[i], baked[i]) for i in members]
        for mesh, _, _ in jobs:
            for name, domain in output.layers():
                prepared.append(color_attribute.prepare(mesh, name, domain))
                undo.callback(color_attribute.discard, mesh, name, prepared[-1])
    layers = iter(prepared)
    for mesh, colours, source in jobs:
        for name, domain in output.layers():
            replaced = color_attribute.fill(
                mesh, next(layers), name, spread(colours, _start_of(source, domain, output))
            )
            if replaced:
                notes.add(replaced)
            records.remember(mesh, name, stored, output.exposure)
        shown, shown_domain = output.layers()[0]
        if shown_domain != "FACE":  # only corner and point colours can be active in the viewport
            color_attribute.make_active(mesh, shown)
    return notes.lines()


def refresh_values(
    baked: Mapping[Hashable, BakedObject],
    chosen: Set[Hashable],
    values: Callable[[Hashable], np.ndarray],
    output: OutputSettings,
    stored: str,
) -> set[Hashable]:
    """Replace the `values` of the chosen objects among all that are baked, as quickly as a frame of playback asks for.

    What `write_values` made must still be there; where it is not, it is made again. Objects that are gone are left out.
    Returns the objects whose values were written: the chosen ones, and those that share a mesh with them.
    """
    written: set[Hashable] = set()
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    users: dict[int, list[Hashable]] = {}
    for key, one in baked.items():
        if one.session_uid in by_uid:
            users.setdefault(by_uid[one.session_uid].data.session_uid, []).append(key)
    for members in users.values():
        if chosen.isdisjoint(members):
            continue
        written.update(members)
        mesh = by_uid[baked[members[0]].session_uid].data
        whole = all(color_attribute.is_color(mesh, name, domain) for name, domain in output.layers())
        averaged = output.shared_meshes is SharedMeshes.AVERAGE
        if not whole or (len(members) > 1 and not averaged):
            write_values([baked[key] for key in members], [values(key) for key in members], output, stored)
            continue
        colours = values(members[0]) if len(members) == 1 else np.mean([values(key) for key in members], axis=0)
        for name, domain in output.layers():
            color_attribute.fill(mesh, name, name, spread(colours, _start_of(baked[members[0]], domain, output)))
            records.remember(mesh, name, stored, output.exposure)
    return written


def spread(colours: np.ndarray, face_start: np.ndarray | None) -> np.ndarray:
    """Colours (f, 3) of faces handed on to their corners, or as they are where `face_start` is None."""
    return colours if face_start is None else np.repeat(colours, np.diff(face_start), axis=0)


def _start_of(source: BakedObject, domain: str, output: OutputSettings) -> np.ndarray | None:
    return source.base.face_start if domain != output.target else None


def separate(
    users: list[bpy.types.Object], copies: list[tuple[bpy.types.Object, bpy.types.Mesh]], notes: Notes
) -> None:
    """Give each object a mesh of its own; the first keeps the mesh unless objects that are not baked use it too."""
    mesh = users[0].data
    uids = {ob.session_uid for ob in users}
    outsiders = any(ob.data == mesh and ob.session_uid not in uids for ob in bpy.data.objects if ob.type == "MESH")
    copied = users if outsiders else users[1:]
    for ob in copied:
        copies.append((ob, mesh))
        ob.data = mesh.copy()
    if copied:
        names = [ob.name for ob in copied]
        notes.add("their mesh was shared, so these got a copy of their own", *names, cure=_AVERAGE)


def rejoin(copies: list[tuple[bpy.types.Object, bpy.types.Mesh]]) -> None:
    """Undo `separate`."""
    for ob, mesh in copies:
        copy, ob.data = ob.data, mesh
        bpy.data.meshes.remove(copy)


def unchanged(baked: BakedObject, ob: bpy.types.Object | None) -> bpy.types.Object:
    """The object, once sure that it still has the faces that were baked."""
    name = baked.snapshot.name
    if ob is None or ob.type != "MESH":
        raise SceneChangedError(f"object '{name}' was deleted during the bake: bake again")
    base, mesh = baked.base, ob.data
    if mesh.is_editmode or ob.mode == "EDIT":
        raise SceneChangedError(f"object '{name}' is in Edit Mode: leave it and bake again")
    if not same_faces(mesh, base):
        raise SceneChangedError(f"the mesh of object '{name}' was edited during the bake: bake again")
    return ob
