"""Puts the values of a bake into the scene, whole or not at all."""

from __future__ import annotations

from collections import Counter
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
    notes = Notes()
    copies: list[tuple[bpy.types.Object, bpy.types.Mesh]] = []
    prepared: list[str] = []
    with undone_on_failure() as undo:
        undo.callback(rejoin, copies)
        if output.shared_meshes is SharedMeshes.SEPARATE:
            separate(objects, copies, notes)
        groups: dict[int, list[int]] = {}
        for i, ob in enumerate(objects):
            groups.setdefault(ob.data.session_uid, []).append(i)
        jobs = [
            (objects[members[0]].data, np.mean([values[i] for i in members], axis=0), baked[members[0]])
            for members in groups.values()
        ]
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
    shared: dict[Hashable, frozenset[Hashable]],
) -> set[Hashable]:
    """Replace the `values` of the chosen objects among all that are baked, as quickly as a frame of playback asks for.

    Where what `write_values` made is not there any more it is made again. Objects that are gone are left out. Objects
    that share a mesh get the mean of their values or meshes of their own, as the output says.

    Parameters
    ----------
    baked, chosen, values, output, stored
    shared : dict from hashable to frozenset of hashable
        Objects that show a mean, and all that share their mesh; is brought up to date.

    Returns
    -------
    set of hashable
        Objects whose values were written: the chosen ones, those whose results were gone, and those whose mesh any of
        them uses, or has ceased to use.

    Raises
    ------
    AttributeNameError
        When a layer of the user's has the name of the result; nothing is written then.
    """
    written: set[Hashable] = set()
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    users = _by_mesh(baked, by_uid)
    before, means = dict(shared), _means(users, output)
    shared.clear()
    shared.update(means)
    groups = []
    for members in users:
        whole = has_layers(by_uid[baked[members[0]].session_uid].data, output)
        regrouped = any(before.get(key) != shared.get(key) for key in members)
        if not whole or regrouped or not chosen.isdisjoint(members):
            groups.append((members, whole, len(members) == 1 or members[0] in shared))
    for key in (key for members, _whole, _fits in groups for key in members):
        for name in output.layer_names():
            color_attribute.check_name(by_uid[baked[key].session_uid], name)
    for members, whole, fits in groups:
        mesh = by_uid[baked[members[0]].session_uid].data
        written.update(members)
        if not whole or not fits:
            write_values([baked[key] for key in members], [values(key) for key in members], output, stored)
            continue
        colours = np.mean([values(key) for key in members], axis=0)
        for name, domain in output.layers():
            color_attribute.fill(mesh, name, name, spread(colours, _start_of(baked[members[0]], domain, output)))
            records.remember(mesh, name, stored, output.exposure)
    return written


def shared_meshes(baked: Mapping[Hashable, BakedObject], output: OutputSettings) -> dict[Hashable, frozenset[Hashable]]:
    """`shared` for `refresh_values`, where `write_values` wrote."""
    return _means(_by_mesh(baked, {ob.session_uid: ob for ob in bpy.data.objects}), output)


def _by_mesh(baked: Mapping[Hashable, BakedObject], by_uid: Mapping[int, bpy.types.Object]) -> list[list[Hashable]]:
    """The objects that use each mesh."""
    users: dict[int, list[Hashable]] = {}
    for key, one in baked.items():
        if one.session_uid in by_uid:
            users.setdefault(by_uid[one.session_uid].data.session_uid, []).append(key)
    return list(users.values())


def _means(users: list[list[Hashable]], output: OutputSettings) -> dict[Hashable, frozenset[Hashable]]:
    if output.shared_meshes is SharedMeshes.SEPARATE:
        return {}
    return {key: frozenset(members) for members in users if len(members) > 1 for key in members}


def has_layers(mesh: bpy.types.Mesh, output: OutputSettings) -> bool:
    """Whether a mesh has all attributes of a result."""
    return all(color_attribute.is_color(mesh, name, domain) for name, domain in output.layers())


def spread(colours: np.ndarray, face_start: np.ndarray | None) -> np.ndarray:
    """Colours (f, 3) of faces handed on to their corners, or as they are where `face_start` is None."""
    return colours if face_start is None else np.repeat(colours, np.diff(face_start), axis=0)


def _start_of(source: BakedObject, domain: str, output: OutputSettings) -> np.ndarray | None:
    return source.base.face_start if domain != output.target else None


def separate(
    objects: list[bpy.types.Object], copies: list[tuple[bpy.types.Object, bpy.types.Mesh]], notes: Notes
) -> None:
    """Give each object a mesh of its own; the first of several keeps it unless objects beside these use it too.

    Parameters
    ----------
    objects : list of bpy.types.Object
    copies : list of tuple
        Gets every object that has a copy now, and the mesh that it had.
    notes : Notes
    """
    groups: dict[bpy.types.Mesh, list[bpy.types.Object]] = {}
    for ob in objects:
        groups.setdefault(ob.data, []).append(ob)
    n_users = Counter(ob.data for ob in bpy.data.objects if ob.type == "MESH")
    for mesh, users in groups.items():
        copied = users if n_users[mesh] > len(users) else users[1:]
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
