"""What of a scene changed since it was last looked at, told by comparing arrays, never by the depsgraph's word alone.

The depsgraph names what it evaluated again. Where it can be trusted, nothing else is read; what it names is read and
compared, since Cycles without persistent data reports all there is at every frame.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import fields, replace

import bpy
import numpy as np

from ...core.errors import ObscuranceError
from ...core.notes import Notes
from ...core.order import BakedObject, Change, MeshArrays, ObjectSnapshot, SceneSnapshot, shade
from ...core.scene import same_numbers
from ..reading import SceneReader, instance_key, keeps_links, materials_of, read_mesh, same_faces

# Kinds of data whose change may change how any object looks.
_LOOKS = (bpy.types.Material, bpy.types.NodeTree, bpy.types.Image, bpy.types.Texture)


class NotUpdatableError(ObscuranceError):
    """A change that only a full bake can follow; the message says which."""


class SceneChanges:
    """Remembers the objects of a scene, and finds those that changed.

    Parameters
    ----------
    snapshot : SceneSnapshot
        The scene as it was baked.
    wanted : set of int
        Session uids of all objects that are to receive values, visible or not.
    baked_layers : sequence of str
        As for `snapshot_scene`.
    untied : dict of hashable to MeshArrays
        What modifiers made of objects when that could not be tied to their unmodified mesh; filled in, and to be handed
        on to the `SceneChanges` of the next full bake, which has the unmodified mesh instead.
    """

    def __init__(
        self,
        snapshot: SceneSnapshot,
        wanted: set[int],
        baked_layers: Sequence[str],
        untied: dict[Hashable, MeshArrays],
    ) -> None:
        self._wanted, self._baked_layers, self._untied = wanted, baked_layers, untied
        self.known: dict[Hashable, Change] = {
            baked.snapshot.key: Change(baked.snapshot, baked) for baked in snapshot.baked
        }
        self.known.update({ob.key: Change(ob, None) for ob in snapshot.occluders})
        self._evaluated: set[int] = set()
        self._shaded: set[int] = set()
        self._all = True

    def distrust(self) -> None:
        """Read everything next time, as after an undo."""
        self._all = True

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Remember what the depsgraph evaluated again."""
        for update in depsgraph.updates:
            if isinstance(update.id, _LOOKS):
                self._all = True
            elif update.is_updated_geometry:
                self._evaluated.add(update.id.original.session_uid)
            elif update.is_updated_shading:  # so is all that an animation moves
                self._shaded.add(update.id.original.session_uid)

    def find(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> dict[Hashable, Change | None]:
        """What changed since the last time, by key; None for what is gone. `known` is what there is now.

        Raises
        ------
        NotUpdatableError
            When an object has other faces than before; what is known then stays as it was.
        """
        reader = SceneReader(context, Notes(), self._baked_layers, None, None)
        now: dict[Hashable, Change] = {}
        changed: dict[Hashable, Change | None] = {}
        for instance in depsgraph.object_instances:
            if not reader.shows(instance):
                continue
            key = instance_key(instance)
            old = self.known.get(key)
            new = self._read(reader, instance, old)
            now[key] = new
            if new is not old:
                changed[key] = new
        changed.update({key: None for key in self.known if key not in now})
        self.known = now
        self._evaluated.clear()
        self._shaded.clear()
        self._all = False
        return changed

    def _read(self, reader: SceneReader, instance: bpy.types.DepsgraphObjectInstance, old: Change | None) -> Change:
        """An instance as it is now; `old` itself if it did not change."""
        ob = instance.object
        matrix = np.array(instance.matrix_world, np.float64)
        data_uid = ob.original.data.session_uid
        uids = {ob.original.session_uid, data_uid}
        is_same = old is not None and (ob.name, data_uid) == (old.snapshot.name, old.snapshot.data_uid)
        if is_same and not self._all and not uids & self._evaluated:
            if uids & self._shaded and materials_of(ob) != old.snapshot.materials:
                return _moved(old, replace(reader.read(instance), mesh=old.snapshot.mesh))
            if same_numbers(matrix, old.snapshot.matrix):
                return old
            return _moved(old, replace(old.snapshot, matrix=matrix))
        new = reader.read(instance)
        if old is not None and new.key in self._untied and _same(new.mesh, self._untied[new.key]):
            new = replace(new, mesh=old.snapshot.mesh, surface=old.snapshot.surface)
        if old is not None and _same(new.mesh, old.snapshot.mesh):
            if is_same and _same_look(new, old.snapshot):
                new = replace(old.snapshot, matrix=matrix)
                return old if same_numbers(matrix, old.snapshot.matrix) else _moved(old, new)
            return _moved(old, replace(new, mesh=old.snapshot.mesh))
        if instance.is_instance or ob.original.session_uid not in self._wanted:
            return Change(new, None)
        baked = self._tied(ob.original, new, old)
        return Change(baked.snapshot, baked)

    def _tied(self, ob: bpy.types.Object, new: ObjectSnapshot, old: Change | None) -> BakedObject:
        """An object tied to its unmodified mesh, by the links that the last full bake found if modifiers make faces."""
        if ob.data.is_editmode:
            raise NotUpdatableError(f"object '{ob.name}' is in Edit Mode")
        mesh, before = new.mesh, old and old.baked
        if before is not None and not same_faces(ob.data, before.base):
            raise NotUpdatableError(f"the mesh of object '{ob.name}' has other faces than before")
        if before is None or before.snapshot.mesh.face_origin is None:
            if not same_faces(ob.data, mesh):
                self._untied[new.key] = mesh
                raise NotUpdatableError(f"the modifiers of object '{ob.name}' make other faces than before")
            return BakedObject(new, mesh, ob.session_uid)
        if not keeps_links(ob) or not _same_topology(mesh, before.snapshot.mesh):
            raise NotUpdatableError(f"the modifiers of object '{ob.name}' make other faces than before")
        base = read_mesh(ob.data)
        if before.snapshot.mesh.rest is not None and not same_numbers(base.positions, before.base.positions):
            raise NotUpdatableError(f"the vertices below the modifiers of object '{ob.name}' were moved")
        mesh = replace(mesh, face_origin=before.snapshot.mesh.face_origin, rest=before.snapshot.mesh.rest)
        return BakedObject(replace(new, mesh=mesh), base, before.session_uid)


def _moved(old: Change, snapshot: ObjectSnapshot) -> Change:
    """The same mesh, elsewhere or in other colours."""
    return Change(snapshot, None if old.baked is None else replace(old.baked, snapshot=snapshot))


def _same(one: MeshArrays, other: MeshArrays) -> bool:
    """Whether two meshes are equal, but for where their faces came from."""
    names = [field.name for field in fields(MeshArrays) if field.name not in {"face_origin", "rest", "uv", "uv_map"}]
    return all(same_numbers(getattr(one, name), getattr(other, name)) for name in names)


def _same_topology(one: MeshArrays, other: MeshArrays) -> bool:
    return same_numbers(one.face_start, other.face_start) and same_numbers(one.corner_vertex, other.corner_vertex)


def _same_look(one: ObjectSnapshot, other: ObjectSnapshot) -> bool:
    """Whether the faces of two snapshots of one mesh have the same colours."""
    return all(same_numbers(a, b) for a, b in zip(shade(one), shade(other), strict=True))
