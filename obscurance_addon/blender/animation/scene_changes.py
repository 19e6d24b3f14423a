"""What of a scene changed since it was last looked at.

The rule, which holds for Live Preview, ranges of frames and renders alike. An object counts as changed when anything
that a bake reads of it differs from what was read last:
- where it is, its evaluated mesh, and the unmodified face that each evaluated one comes from,
- its unmodified mesh, whose faces receive the values,
- how its faces look: their reflectance and emission, however materials, images and attributes make them,
- its Ray Visibility: whether it occludes, and whether others see its colour,
- its name, which picks its rays, and its mesh data-block, on which values are written.

Arrays decide, never the depsgraph's word alone: Cycles without persistent data reports all there is at every frame. But
not all arrays are read at every look. An object is read again when the depsgraph evaluated it or its mesh since, or
when it has another name, mesh, materials or Ray Visibility. All objects are when a material, node tree, image or
texture was evaluated, when pixels were changed, of which Blender tells nobody (looked for after an animation that plays
has stopped), when another depsgraph is looked at, in renders, and after an undo.

What is written is no part of this: `refresh_values` makes results anew that were removed, renamed or retyped.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from dataclasses import fields, replace

import bpy
import numpy as np

from ...core.notes import Notes
from ...core.order import BakedObject, Change, MeshArrays, ObjectSnapshot, SceneSnapshot, shade
from ...core.scene import same_numbers
from ..materials import PixelWatch
from ..reading import SceneReader, instance_key, materials_of, ray_visibility, tie
from .surroundings import is_playing

# Kinds of data whose change may change how any object looks.
_LOOKS = (bpy.types.Material, bpy.types.NodeTree, bpy.types.Image, bpy.types.Texture)
_PLAIN = ("name", "data_uid", "materials", "occludes", "gives_color")
_SHAPE = [field.name for field in fields(MeshArrays) if field.name not in {"uv", "uv_map"}]


class SceneChanges:
    """Remembers the objects of a scene, and finds those that changed.

    Parameters
    ----------
    snapshot : SceneSnapshot
        The scene as it was baked.
    wanted : collection of int
        Session uids of all objects that are to receive values, visible or not.
    baked_layers, needs_rest
        As for `snapshot_scene`.

    Attributes
    ----------
    known : dict from hashable to Change
        The objects as they were when last looked at.
    notes : list of str
        What the user should know of the last look.
    """

    def __init__(
        self, snapshot: SceneSnapshot, wanted: Collection[int], baked_layers: Sequence[str], needs_rest: bool
    ) -> None:
        self._wanted, self._baked_layers, self._needs_rest = wanted, baked_layers, needs_rest
        self.known: dict[Hashable, Change] = {
            baked.snapshot.key: Change(baked.snapshot, baked) for baked in snapshot.baked
        }
        self.known.update({ob.key: Change(ob, None) for ob in snapshot.occluders})
        self.notes: list[str] = []
        self._hair: dict[Hashable, list[Hashable]] = {}  # keys of the strands on each instance
        self._pixels = PixelWatch()
        self._evaluated: set[int] = set()
        self._shaded: set[int] = set()
        self._mode = ""  # of the depsgraph that was looked at
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

        Parameters
        ----------
        context : bpy.types.Context
        depsgraph : bpy.types.Depsgraph
            Evaluated.
        """
        self._all |= depsgraph.mode != self._mode
        self._all |= not is_playing() and self._pixels.changed()  # which takes its time where images are large
        self._mode, notes = depsgraph.mode, Notes()
        reader = SceneReader(context, depsgraph, notes, self._wanted, self._baked_layers, self._needs_rest)
        now: dict[Hashable, Change] = {}
        changed: dict[Hashable, Change | None] = {}
        for instance in depsgraph.object_instances:
            for part in self._look_at_hair(reader, instance):
                key = part.snapshot.key
                now[key] = part
                if part is not self.known.get(key):
                    changed[key] = part
            if not reader.shows(instance):
                continue
            key = instance_key(instance)
            old = self.known.get(key)
            new = self._look(reader, instance, old)
            now[key] = new
            if new is not old:
                changed[key] = new
        changed.update({key: None for key in self.known if key not in now})
        self.known = now
        self.notes = notes.lines()
        self._pixels.add(reader.images)
        self._evaluated.clear()
        self._shaded.clear()
        self._all = False
        return changed

    def _look(self, reader: SceneReader, instance: bpy.types.DepsgraphObjectInstance, old: Change | None) -> Change:
        """An instance as it is now; `old` itself if it did not change."""
        if old is not None and not self._must_read(instance, old.snapshot):
            matrix = np.array(instance.matrix_world, np.float64)
            return old if same_numbers(matrix, old.snapshot.matrix) else _at(old, matrix)
        snapshot, original = reader.read(instance), instance.object.original
        is_baked = not instance.is_instance and original.session_uid in self._wanted
        new = Change(snapshot, tie(original, snapshot, reader) if is_baked else None)
        if new.baked is not None:
            new = Change(new.baked.snapshot, new.baked)
        return new if old is None else _with_what_stayed(new, old)

    def _look_at_hair(self, reader: SceneReader, instance: bpy.types.DepsgraphObjectInstance) -> list[Change]:
        """The strands on an instance as they are now: those of before if nothing was evaluated and nothing moved."""
        if not instance.show_particles:
            return []
        owner, matrix = instance_key(instance), np.array(instance.matrix_world, np.float64)
        before = [self.known[key] for key in self._hair.get(owner, ()) if key in self.known]
        if before and all(
            not self._must_read(instance, old.snapshot) and same_numbers(matrix, old.snapshot.matrix) for old in before
        ):
            return before
        found = [Change(part, None) for part in reader.read_hair(instance)]
        self._hair[owner] = [part.snapshot.key for part in found]
        known = [self.known.get(part.snapshot.key) for part in found]
        return [new if old is None else _with_what_stayed(new, old) for new, old in zip(found, known, strict=True)]

    def _must_read(self, instance: bpy.types.DepsgraphObjectInstance, old: ObjectSnapshot) -> bool:
        ob = instance.object
        data_uid = ob.original.data.session_uid
        uids = {ob.original.session_uid, data_uid}
        return (
            self._all
            or (ob.name, data_uid) != (old.name, old.data_uid)
            or ray_visibility(instance) != (old.occludes, old.gives_color)
            or not uids.isdisjoint(self._evaluated)
            or (not uids.isdisjoint(self._shaded) and materials_of(ob) != old.materials)
        )


def _at(old: Change, matrix: np.ndarray) -> Change:
    """The same object elsewhere."""
    snapshot, baked = replace(old.snapshot, matrix=matrix), old.baked
    if baked is not None:
        beside = baked.beside and replace(baked.beside, matrix=matrix)
        baked = replace(baked, snapshot=snapshot, beside=beside)
    return Change(snapshot, baked)


def _with_what_stayed(new: Change, old: Change) -> Change:
    """What was read, with the very arrays of before where they are equal; `old` itself if all is."""
    before, after = old.snapshot, new.snapshot
    stayed = False
    if _same_shape(after.mesh, before.mesh):
        after = replace(after, mesh=before.mesh)
        stayed = _same_look(after, before)
    if stayed:
        after = replace(after, surface=before.surface, shadings=before.shadings)
    baked = new.baked and replace(new.baked, snapshot=after, base=_base_that_stayed(new.baked, old.baked, after))
    stayed &= (baked and baked.base) is (old.baked and old.baked.base)
    stayed &= _same_beside(new.baked and new.baked.beside, old.baked and old.baked.beside)
    if stayed and all(getattr(after, name) == getattr(before, name) for name in _PLAIN):
        return old if same_numbers(after.matrix, before.matrix) else _at(old, after.matrix)
    return Change(after, baked)


def _base_that_stayed(new: BakedObject, old: BakedObject | None, snapshot: ObjectSnapshot) -> MeshArrays:
    """The unmodified mesh of an object, as the very arrays of before if they are equal."""
    if new.base is new.snapshot.mesh:
        return snapshot.mesh
    return old.base if old is not None and _same_shape(new.base, old.base) else new.base


def _same_beside(one: ObjectSnapshot | None, other: ObjectSnapshot | None) -> bool:
    """Whether modifiers make the same beside the unmodified mesh, wherever that is."""
    if one is None or other is None:
        return one is other
    return _same_shape(one.mesh, other.mesh) and _same_look(one, other)


def _same_shape(one: MeshArrays, other: MeshArrays) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in _SHAPE]
    return all(a is b or (a is not None and b is not None and same_numbers(a, b)) for a, b in pairs)


def _same_look(one: ObjectSnapshot, other: ObjectSnapshot) -> bool:
    """Whether the faces of two snapshots of one mesh have the same colours.

    Where rays pass through the holes of a texture, values of faces do not tell.
    """
    if any(shading.transmission_varies() for shading in (*one.shadings, *other.shadings)):
        return False
    pairs = zip(shade(one), shade(other), strict=True)
    return all(a is b or (a is not None and b is not None and same_numbers(a, b)) for a, b in pairs)
