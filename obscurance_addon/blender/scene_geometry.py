"""Reads a scene from the evaluated depsgraph into plain arrays, the one step of a bake that needs the main thread.

The snapshot holds no bpy object. It is taken in one go, so that nothing the user does later can tear it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.errors import GeometryError
from .materials import ImageCache, Shading, SurfaceArrays, read_surface, snapshot_material

log = logging.getLogger(__name__)

FACE_INDEX = "obscurance_face_index"  # carried through modifiers; above 0, since faces without origin read 0
REST_POSITION = "obscurance_rest_position"
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}

# Modifiers that move vertices at most; every other one may change which faces there are.
_DEFORM_ONLY = {
    "ARMATURE", "CAST", "CLOTH", "COLLISION", "CORRECTIVE_SMOOTH", "CURVE", "DATA_TRANSFER", "DISPLACE", "HOOK",
    "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "NORMAL_EDIT", "PARTICLE_SYSTEM",
    "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM", "UV_PROJECT", "UV_WARP",
    "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "VOLUME_DISPLACE", "WARP", "WAVE",
    "WEIGHTED_NORMAL",
}  # fmt: skip


@dataclass(frozen=True)
class MeshArrays:
    """One mesh in its own space.

    Attributes
    ----------
    positions : ndarray, (v, 3) float32
    corner_vertex : ndarray, (c,) int32
    face_start : ndarray, (f + 1,) int32
        First corner of each face, and the number of corners.
    triangle_corners : ndarray, (t, 3) int32
        Blender's own triangulation.
    triangle_face : ndarray, (t,) int32
    face_material : ndarray, (f,) int32
        Material slot of each face.
    corner_edge : ndarray, (c,) int32
        Edge that begins at each corner.
    sharp_edge, sharp_face : ndarray, (e,) and (f,) bool
        Edges marked sharp, and faces with flat shading.
    face_origin, rest : ndarray, (f,) int and (v, 3) float32, or None
        1-based index of the unmodified face that each face came from, 0 for faces that came from none, and where its
        vertices were before modifiers; None for meshes whose faces are the unmodified ones.
    """

    positions: np.ndarray
    corner_vertex: np.ndarray
    face_start: np.ndarray
    triangle_corners: np.ndarray
    triangle_face: np.ndarray
    face_material: np.ndarray
    corner_edge: np.ndarray
    sharp_edge: np.ndarray
    sharp_face: np.ndarray
    face_origin: np.ndarray | None = None
    rest: np.ndarray | None = None


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


def snapshot_scene(
    context: bpy.types.Context, objects: Iterable[bpy.types.Object], needs_rest: bool = False
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

    Returns
    -------
    SceneSnapshot

    Raises
    ------
    GeometryError
        When none of the objects to bake is visible.
    """
    objects = list(objects)
    notes: list[str] = []
    with _carried_indices(objects, needs_rest) as first_index:
        depsgraph = context.evaluated_depsgraph_get()
        reader = _Reader(context, notes)
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
            _baked_object(ob, found[ob.session_uid], first_index.get(ob.data.session_uid), notes)
            for ob in objects
            if ob.session_uid in found
        ]
    unseen = [ob.name for ob in objects if ob.session_uid not in found]
    if unseen:
        notes.append(f"hidden, or left without faces by modifiers, so nothing was baked onto: {_names(unseen)}")
    if not baked:
        raise GeometryError("; ".join(["there is nothing to bake", *notes]))
    return SceneSnapshot(baked, occluders, notes)


def rendered_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Mesh objects with faces that are visible in the viewport and in renders."""
    rendered = _rendered_objects(context.view_layer.layer_collection)
    return [
        ob
        for ob in context.view_layer.objects
        if ob.type == "MESH"
        and len(ob.data.polygons)
        and ob.visible_get(view_layer=context.view_layer)
        and not ob.hide_render
        and ob.session_uid in rendered
    ]


def _baked_object(
    ob: bpy.types.Object, snapshot: ObjectSnapshot, first_index: int | None, notes: list[str]
) -> BakedObject:
    """Tie what is seen of an object to its unmodified mesh, whose face indices were carried from `first_index` on."""
    base = read_mesh(ob.data)
    mesh = _with_own_origins(snapshot.mesh, base, first_index)
    if mesh.face_origin is None:
        base = mesh
    elif not mesh.face_origin.any():
        notes.append(
            f"object '{ob.name}': its modifiers keep no link to the faces they started from, so its unmodified mesh "
            "was baked; apply the modifiers to bake what they make"
        )
        base = mesh = replace(base, face_origin=None, rest=None)
        snapshot = replace(snapshot, surface=read_surface(ob.data, snapshot.shadings))
    return BakedObject(replace(snapshot, mesh=mesh), base, ob.session_uid)


def _with_own_origins(mesh: MeshArrays, base: MeshArrays, first_index: int | None) -> MeshArrays:
    """An evaluated mesh with `face_origin` as 1-based faces of the object's own mesh, 0 for those of any other.

    Faces that are the unmodified ones, in the same order, come back without `face_origin`.
    """
    n_faces = len(base.face_start) - 1
    same = np.array_equal(mesh.face_start, base.face_start) and np.array_equal(mesh.corner_vertex, base.corner_vertex)
    if first_index is None:
        origin = np.arange(1, n_faces + 1) if same else np.zeros(len(mesh.face_start) - 1, np.int64)
    elif mesh.face_origin is None or (base.rest is not None and mesh.rest is None):
        origin = np.zeros(len(mesh.face_start) - 1, np.int64)
    else:
        origin = mesh.face_origin.astype(np.int64) - first_index
        origin[(origin < 1) | (origin > n_faces)] = 0
    if same and np.array_equal(origin, np.arange(1, n_faces + 1)):
        return replace(mesh, face_origin=None, rest=None)
    return replace(mesh, face_origin=origin)


class _Reader:
    """Reads instances one by one; meshes, materials and images are read once however often they are used."""

    def __init__(self, context: bpy.types.Context, notes: list[str]) -> None:
        self._scene = context.scene
        self._rendered = _rendered_objects(context.view_layer.layer_collection)
        # The depsgraph also holds objects of collections whose eye is closed, so its word alone is not enough.
        self._visible = {
            ob.session_uid for ob in context.view_layer.objects if ob.visible_get(view_layer=context.view_layer)
        }
        self._notes = notes
        self._members: dict[int, set[int]] = {}
        self._meshes: dict[int, MeshArrays] = {}
        self._surfaces: dict[tuple, SurfaceArrays] = {}
        self._materials: dict[int, Shading] = {}
        self._images = ImageCache()
        self._hidden: set[str] = set()

    def read(self, instance: bpy.types.DepsgraphObjectInstance) -> ObjectSnapshot | None:
        """Arrays of one instance, or None when it is not a visible mesh with faces."""
        ob = instance.object
        # Curves, texts and metaballs come twice: as themselves, and as the mesh that they evaluate to.
        if not instance.show_self or not isinstance(ob.data, bpy.types.Mesh) or not len(ob.data.polygons):
            return None
        owner = instance.parent if instance.is_instance else ob
        if not self._renders(ob, owner, instance.is_instance):
            self._hidden.add(ob.name)
            return None
        if owner.original.session_uid not in self._visible:
            return None
        shadings = [self._shading(slot.material) for slot in ob.material_slots]
        shadings.append(self._shading(None))
        key = ob.data.as_pointer()
        surface_key = (key, *map(id, shadings))
        if surface_key not in self._surfaces:
            mesh = ob.to_mesh()  # not ob.data, which lacks the last subdivision where the graphics card makes it
            if key not in self._meshes:
                self._meshes[key] = read_mesh(mesh)
            else:
                mesh.calc_loop_triangles()
            self._surfaces[surface_key] = read_surface(mesh, shadings)
            ob.to_mesh_clear()
        matrix = np.array(instance.matrix_world, np.float64)
        return ObjectSnapshot(ob.name, self._meshes[key], matrix, shadings, self._surfaces[surface_key])

    def _shading(self, material: bpy.types.Material | None) -> Shading:
        key = material.as_pointer() if material else 0
        if key not in self._materials:
            self._materials[key] = snapshot_material(material, self._notes, self._images)
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
            self._members[uid] = {ob.session_uid for ob in collection.all_objects} - _rendered_members(collection)
        return self._members[uid]

    def note_hidden(self) -> None:
        """Name what does not count although a user may expect it to."""
        unseen = set()
        for ob in self._scene.collection.all_objects:
            if ob.type not in SOLID_TYPES:
                continue
            if ob.hide_render or ob.session_uid not in self._rendered:
                self._hidden.add(ob.name)
            elif ob.session_uid not in self._visible:
                unseen.add(ob.name)
        if self._hidden:
            self._notes.append(f"hidden from renders, so they do not occlude: {_names(self._hidden)}")
        if unseen:
            self._notes.append(f"hidden in the viewport, so they do not occlude although they render: {_names(unseen)}")


def _names(names: Iterable[str], most: int = 12) -> str:
    names = sorted(names)
    listed = ", ".join(f"'{name}'" for name in names[:most])
    return listed if len(names) <= most else f"{listed} and {len(names) - most} more"


def _rendered_objects(layer_collection: bpy.types.LayerCollection) -> set[int]:
    """Session uids of objects in collections that are neither excluded nor disabled in renders."""
    if layer_collection.collection.hide_render:
        return set()
    # A collection can be taken in again below one that is excluded.
    own = () if layer_collection.exclude else layer_collection.collection.objects
    return {ob.session_uid for ob in own}.union(*map(_rendered_objects, layer_collection.children))


def _rendered_members(collection: bpy.types.Collection) -> set[int]:
    """Session uids of objects that an instance of a collection shows in renders."""
    uids = {ob.session_uid for ob in collection.objects}
    return uids.union(*(_rendered_members(child) for child in collection.children if not child.hide_render))


@contextmanager
def _carried_indices(objects: list[bpy.types.Object], needs_rest: bool) -> Iterator[dict[int, int]]:
    """Put face indices (and positions) on meshes whose modifiers may change topology, while the block lasts.

    Gives the session uid of each such mesh and the index before its first one: no two meshes use the same indices, so
    that faces which modifiers bring in from another object are not taken for an object's own.
    """
    meshes = {ob.data.session_uid: ob.data for ob in objects if _may_change_topology(ob)}
    counts = [len(mesh.polygons) for mesh in meshes.values()]
    first_index = dict(zip(meshes, np.cumsum([0, *counts]).tolist(), strict=False))
    try:
        for uid, mesh in meshes.items():
            indices = first_index[uid] + np.arange(1, len(mesh.polygons) + 1, dtype=np.int32)
            _put(mesh, FACE_INDEX, "INT", "FACE", "value", indices.astype(np.int32))
            if needs_rest:
                _put(mesh, REST_POSITION, "FLOAT_VECTOR", "POINT", "vector", _read(mesh, "position", "vector", "f4", 3))
            mesh.update()
        yield first_index
    finally:
        for mesh in meshes.values():
            for name in (FACE_INDEX, REST_POSITION):
                if name in mesh.attributes:
                    mesh.attributes.remove(mesh.attributes[name])
            mesh.update()


def _may_change_topology(ob: bpy.types.Object) -> bool:
    return any(modifier.show_viewport and modifier.type not in _DEFORM_ONLY for modifier in ob.modifiers)


def _put(mesh: bpy.types.Mesh, name: str, kind: str, domain: str, field_name: str, values: np.ndarray) -> None:
    mesh.attributes.new(name, kind, domain)
    mesh.attributes[name].data.foreach_set(field_name, values.ravel())


def _read(mesh: bpy.types.Mesh, name: str, field_name: str, dtype: str, width: int) -> np.ndarray:
    """All values of an attribute as (n, width), or (n,) for width 1."""
    data = mesh.attributes[name].data
    values = np.empty(len(data) * width, dtype)
    data.foreach_get(field_name, values)
    return values.reshape(-1, width) if width > 1 else values


def read_mesh(mesh: bpy.types.Mesh) -> MeshArrays:
    """Arrays of a mesh that has at least one face; main thread, object mode."""
    mesh.calc_loop_triangles()
    n_faces, n_corners, n_triangles = len(mesh.polygons), len(mesh.loops), len(mesh.loop_triangles)
    face_start = np.empty(n_faces + 1, np.int32)
    mesh.polygons.foreach_get("loop_start", face_start[:-1])
    face_start[-1] = n_corners
    triangle_corners = np.empty(n_triangles * 3, np.int32)
    mesh.loop_triangles.foreach_get("loops", triangle_corners)
    triangle_face = np.empty(n_triangles, np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", triangle_face)
    names = mesh.attributes.keys()
    return MeshArrays(
        positions=_read(mesh, "position", "vector", "f4", 3),
        corner_vertex=_read(mesh, ".corner_vert", "value", "i4", 1),
        face_start=face_start,
        triangle_corners=triangle_corners.reshape(-1, 3),
        triangle_face=triangle_face,
        face_material=_optional(mesh, "material_index", "i4", n_faces),
        corner_edge=_read(mesh, ".corner_edge", "value", "i4", 1),
        sharp_edge=_optional(mesh, "sharp_edge", "?", len(mesh.edges)),
        sharp_face=_optional(mesh, "sharp_face", "?", n_faces),
        face_origin=_read(mesh, FACE_INDEX, "value", "i4", 1) if FACE_INDEX in names else None,
        rest=_read(mesh, REST_POSITION, "vector", "f4", 3) if REST_POSITION in names else None,
    )


def same_faces(mesh: bpy.types.Mesh, arrays: MeshArrays) -> bool:
    """Whether a mesh still has the vertices, corners and faces of these arrays, wherever its vertices are now."""
    counts = (len(arrays.positions), len(arrays.corner_vertex), len(arrays.face_start) - 1)
    if (len(mesh.vertices), len(mesh.loops), len(mesh.polygons)) != counts:
        return False
    face_start = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", face_start)
    return np.array_equal(face_start, arrays.face_start[:-1]) and np.array_equal(
        _read(mesh, ".corner_vert", "value", "i4", 1), arrays.corner_vertex
    )


def _optional(mesh: bpy.types.Mesh, name: str, dtype: str, n: int) -> np.ndarray:
    """Values (n,) of an attribute that Blender leaves out while all of them are 0."""
    return _read(mesh, name, "value", dtype, 1) if name in mesh.attributes else np.zeros(n, dtype)
