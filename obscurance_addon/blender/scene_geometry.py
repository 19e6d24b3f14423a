"""Reads a scene from the evaluated depsgraph into plain arrays, the one step of a bake that needs the main thread.

The snapshot holds no bpy object. It is taken in one go, so that nothing the user does later can tear it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.errors import GeometryError
from ..core.light_records import LightSources
from ..core.lightmap_settings import LightmapSettings, UvMode
from .carried_indices import carried_indices, with_own_origins
from .lights import LightReader, read_world
from .materials import ImageCache, Shading, SurfaceArrays, node_tree_of, read_surface, snapshot_material
from .mesh_arrays import MeshArrays, read_mesh
from .render_visibility import rendered_members, rendered_objects

SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}


@dataclass(frozen=True)
class ObjectSnapshot:
    """One object or instance as it stands in the world."""

    name: str
    mesh: MeshArrays
    matrix: np.ndarray  # (4, 4) float64, local to world
    shadings: list[Shading]  # one for each material slot, the last one for faces without material
    surface: SurfaceArrays


@dataclass(frozen=True)
class BakedObject:
    """An object that receives values, and its mesh before modifiers."""

    snapshot: ObjectSnapshot
    base: MeshArrays  # the mesh whose faces, corners or vertices receive the values
    session_uid: int  # of the object, to find it again when the values are written


@dataclass(frozen=True)
class SceneSnapshot:
    """Everything that a bake needs to know of a scene."""

    baked: list[BakedObject]
    occluders: list[ObjectSnapshot]
    notes: list[str] = field(default_factory=list)
    sources: LightSources = field(default_factory=LightSources)


def snapshot_scene(
    context: bpy.types.Context,
    objects: Iterable[bpy.types.Object],
    needs_rest: bool = False,
    baked_layers: Sequence[str] = (),
    needs_light: bool = False,
    lightmap: LightmapSettings | None = None,
) -> SceneSnapshot:
    """Read the objects to bake and everything that occludes them.

    Parameters
    ----------
    context : bpy.types.Context
        Its view layer is evaluated, in viewport mode.
    objects : iterable of bpy.types.Object
        Mesh objects in object mode, in the view layer, with a writable mesh.
    needs_rest : bool
        Carry vertex positions through modifiers too: needed for values per corner or vertex.
    baked_layers : sequence of str
        Colour attributes that the bake will write; materials that read them see white.
    needs_light : bool
        Read lights and world too.
    lightmap : LightmapSettings, optional
        Where a lightmap is baked: read the UV map that it keeps; or leave out modifiers that change which faces there
        are, for whose faces no UV map could be written.

    Returns
    -------
    SceneSnapshot

    Raises
    ------
    GeometryError
        When none of the objects to bake is visible, or one lacks the UV map to keep.
    """
    objects = list(objects)
    notes: list[str] = []
    with carried_indices(objects, needs_rest) as first_index:
        depsgraph = context.evaluated_depsgraph_get()
        reader = _Reader(context, notes, baked_layers, LightReader(notes) if needs_light else None, lightmap)
        wanted = {ob.session_uid: ob for ob in objects}
        found: dict[int, ObjectSnapshot] = {}
        occluders = []
        for instance in depsgraph.object_instances:
            snapshot = reader.read(instance)
            if snapshot is None:
                continue
            uid = instance.object.original.session_uid
            if not instance.is_instance and uid in wanted:
                found[uid] = snapshot
            else:
                occluders.append(snapshot)
        reader.note_hidden()
        baked = [
            _baked_object(ob, found[ob.session_uid], first_index.get(ob.data.session_uid), reader)
            for ob in objects
            if ob.session_uid in found
        ]
    unseen = [ob.name for ob in objects if ob.session_uid not in found]
    if unseen:
        notes.append(f"hidden, or left without faces by modifiers, so nothing was baked onto: {_names(unseen)}")
    if not baked:
        raise GeometryError("; ".join(["there is nothing to bake", *notes]))
    return SceneSnapshot(baked, occluders, notes, reader.light_sources())


def _baked_object(
    ob: bpy.types.Object, snapshot: ObjectSnapshot, first_index: int | None, reader: _Reader
) -> BakedObject:
    """Tie what is seen of an object to its unmodified mesh, whose face indices were carried from `first_index` on."""
    if reader.lightmap is not None and reader.lightmap.uv_mode is UvMode.KEEP:
        return _with_kept_uv(ob, snapshot, reader.lightmap)
    base = read_mesh(ob.data)
    mesh = with_own_origins(snapshot.mesh, base, first_index)
    if mesh.face_origin is None:
        base = mesh
    elif reader.lightmap is not None or not mesh.face_origin.any():
        why, cure = "keep no link to the faces they started from", ""
        if reader.lightmap is not None:
            why, cure = "change which faces there are", ", or keep the UV map of this bake in the next one,"
        reader.notes.append(
            f"object '{ob.name}': its modifiers {why}, so its unmodified mesh was baked; apply the modifiers{cure} to "
            "bake what they make"
        )
        base = mesh = replace(base, face_origin=None, rest=None)
        snapshot = replace(snapshot, surface=read_surface(ob.data, snapshot.shadings, reader.baked_layers))
    return BakedObject(replace(snapshot, mesh=mesh), base, ob.session_uid)


def _with_kept_uv(ob: bpy.types.Object, snapshot: ObjectSnapshot, lightmap: LightmapSettings) -> BakedObject:
    """An object as modifiers make it, with the UV map that came with it."""
    if snapshot.mesh.uv is None:
        missing = f"no UV map named '{lightmap.uv_map}'" if lightmap.uv_map else "no UV map"
        raise GeometryError(f"object '{ob.name}' has {missing} to keep: choose another one, or let the bake unwrap")
    mesh = replace(snapshot.mesh, face_origin=None, rest=None)
    return BakedObject(replace(snapshot, mesh=mesh), mesh, ob.session_uid)


class _Reader:
    """Reads instances one by one; meshes, materials and images are read once however often they are used."""

    def __init__(
        self,
        context: bpy.types.Context,
        notes: list[str],
        baked_layers: Sequence[str],
        lights: LightReader | None,
        lightmap: LightmapSettings | None,
    ) -> None:
        self.lightmap = lightmap
        self.baked_layers = baked_layers
        self._lights = lights
        self._scene = context.scene
        self._rendered = rendered_objects(context.view_layer.layer_collection)
        # The depsgraph also holds objects of collections whose eye is closed, so its word alone is not enough.
        self._visible = {
            ob.session_uid for ob in context.view_layer.objects if ob.visible_get(view_layer=context.view_layer)
        }
        self.notes = notes
        self._members: dict[int, set[int]] = {}
        self._meshes: dict[int, MeshArrays] = {}
        self._surfaces: dict[tuple, SurfaceArrays] = {}
        self._materials: dict[int, Shading] = {}
        self._images = ImageCache()
        self._hidden: set[str] = set()

    def read(self, instance: bpy.types.DepsgraphObjectInstance) -> ObjectSnapshot | None:
        """Arrays of one instance, or None when it is not a visible mesh with faces."""
        ob = instance.object
        if ob.type == "LIGHT":
            self._read_light(instance)
            return None
        # Curves, texts and metaballs come twice: as themselves, and as the mesh that they evaluate to.
        if not instance.show_self or not isinstance(ob.data, bpy.types.Mesh) or not len(ob.data.polygons):
            return None
        owner = instance.parent if instance.is_instance else ob
        if not self._renders(ob, owner, instance.is_instance):
            self._hidden.add(ob.name)
            return None
        if owner.original.session_uid not in self._visible:
            return None
        if self._lights is not None:
            self._lights.note_linking(ob)
        shadings = [self._shading(slot.material) for slot in ob.material_slots]
        shadings.append(self._shading(None))
        key = ob.data.as_pointer()
        surface_key = (key, *map(id, shadings))
        if surface_key not in self._surfaces:
            mesh = ob.to_mesh()  # not ob.data, which lacks the last subdivision where the graphics card makes it
            if key not in self._meshes:
                self._meshes[key] = read_mesh(mesh, self.lightmap and self.lightmap.uv_map)
            else:
                mesh.calc_loop_triangles()
            self._surfaces[surface_key] = read_surface(mesh, shadings, self.baked_layers)
            ob.to_mesh_clear()
        matrix = np.array(instance.matrix_world, np.float64)
        return ObjectSnapshot(ob.name, self._meshes[key], matrix, shadings, self._surfaces[surface_key])

    def _read_light(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        ob = instance.object
        owner = instance.parent if instance.is_instance else ob
        if (
            self._lights is not None
            and instance.show_self
            and self._renders(ob, owner, instance.is_instance)
            and owner.original.session_uid in self._visible
        ):
            self._lights.read(ob, np.array(instance.matrix_world, np.float64))

    def light_sources(self) -> LightSources:
        """Lights and world, once all instances are read."""
        if self._lights is None:
            return LightSources()
        self._lights.finish(self._scene.frame_current)
        self._note_volumes()
        return LightSources(tuple(self._lights.lamps), read_world(self._scene.world, self.notes))

    def _note_volumes(self) -> None:
        """Name objects that fill space with something, which is not modelled."""
        volumes = {
            ob.name
            for ob in self._scene.collection.all_objects
            if ob.session_uid in self._visible and (ob.type == "VOLUME" or any(map(_has_volume, ob.material_slots)))
        }
        if volumes:
            self.notes.append(f"volumes are not supported, so these do not dim or scatter light: {_names(volumes)}")

    def _shading(self, material: bpy.types.Material | None) -> Shading:
        key = material.as_pointer() if material else 0
        if key not in self._materials:
            self._materials[key] = snapshot_material(material, self.notes, self._images)
        return self._materials[key]

    def _renders(self, ob: bpy.types.Object, owner: bpy.types.Object, is_instance: bool) -> bool:
        """Whether an object, or its instance by an owner, shows up in renders."""
        if ob.hide_render or owner.hide_render or owner.original.session_uid not in self._rendered:
            return False
        if is_instance:
            return ob.original.session_uid not in self._hidden_members(owner.original)
        return not ob.is_instancer or ob.show_instancer_for_render

    def _hidden_members(self, owner: bpy.types.Object) -> set[int]:
        """Session uids of objects that an instance of a collection shows in the viewport, but not in renders."""
        collection = owner.instance_collection
        if owner.instance_type != "COLLECTION" or collection is None:
            return set()
        uid = collection.session_uid
        if uid not in self._members:
            self._members[uid] = {ob.session_uid for ob in collection.all_objects} - rendered_members(collection)
        return self._members[uid]

    def note_hidden(self) -> None:
        """Name what does not count although a user may expect it to."""
        unseen, dark = set(), set()
        for ob in self._scene.collection.all_objects:
            is_light = ob.type == "LIGHT" and self._lights is not None
            if is_light and not ob.hide_render and ob.session_uid in self._rendered - self._visible:
                dark.add(ob.name)
            if ob.type not in SOLID_TYPES:
                continue
            if ob.hide_render or ob.session_uid not in self._rendered:
                self._hidden.add(ob.name)
            elif ob.session_uid not in self._visible:
                unseen.add(ob.name)
        if self._hidden:
            self.notes.append(f"hidden from renders, so they do not occlude: {_names(self._hidden)}")
        if dark:
            self.notes.append(f"hidden in the viewport, so they do not light although they render: {_names(dark)}")
        if unseen:
            self.notes.append(f"hidden in the viewport, so they do not occlude although they render: {_names(unseen)}")


def _has_volume(slot: bpy.types.MaterialSlot) -> bool:
    tree = node_tree_of(slot.material) if slot.material else None
    end = tree.get_output_node("CYCLES") if tree else None
    return end is not None and end.inputs["Volume"].is_linked


def _names(names: Iterable[str], most: int = 12) -> str:
    names = sorted(names)
    listed = ", ".join(f"'{name}'" for name in names[:most])
    return listed if len(names) <= most else f"{listed} and {len(names) - most} more"
