"""Reads instances of the evaluated depsgraph one by one into plain arrays."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

import bpy
import numpy as np

from ...core.light import LightSources
from ...core.lightmap import LightmapSettings, UvMode
from ...core.notes import Notes
from ...core.order import MeshArrays, ObjectSnapshot
from ...core.shading import DEFAULT_REFLECTANCE, NO_TRIANGLES, Constant, Shading, SurfaceArrays
from ..materials import ImageCache, node_tree_of, read_surface, snapshot_material
from .as_rendered import renders_otherwise
from .lights import LightReader, read_world
from .meshes import read_mesh
from .origins import EvaluatedMesh, carried_mesh, evaluated_mesh, may_change_topology
from .strands import hair_mesh, hair_systems, has_strands, strands_mesh
from .visibility import rendered_members, rendered_objects, shown_objects

_SHOW = "show them there, or hide them from renders too"
_GREY = Shading(Constant((DEFAULT_REFLECTANCE,)))
_AS_RENDERED = "choose Modifiers: Render (--modifiers RENDER), or give them the same settings in both"
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}


class SceneReader:
    """Reads instances one by one; meshes, materials and images are read once however often they are used.

    Parameters
    ----------
    context : bpy.types.Context
        Whose scene and view layer are read.
    depsgraph : bpy.types.Depsgraph
        Evaluated; all that is read comes from it.
    notes : Notes
        Gets what the user should know.
    wanted : collection of int
        Session uids of the objects to bake, whose faces are followed through their modifiers.
    baked_layers : sequence of str
        As for `snapshot_scene`.
    needs_rest : bool
        As for `snapshot_scene`.
    lights : LightReader, optional
    lightmap : LightmapSettings, optional
    """

    def __init__(
        self,
        context: bpy.types.Context,
        depsgraph: bpy.types.Depsgraph,
        notes: Notes,
        wanted: Collection[int] = (),
        baked_layers: Sequence[str] = (),
        needs_rest: bool = False,
        lights: LightReader | None = None,
        lightmap: LightmapSettings | None = None,
    ) -> None:
        self.lightmap = lightmap
        self.baked_layers = baked_layers
        self._depsgraph, self._wanted, self._needs_rest = depsgraph, wanted, needs_rest
        self._lights = lights
        self._scene = context.scene
        self._rendered = rendered_objects(context.view_layer.layer_collection)
        # The depsgraph also holds objects of collections whose eye is closed, so its word alone is not enough.
        self._shown = shown_objects(context)
        self.notes = notes
        self._members: dict[int, set[int]] = {}
        self._meshes: dict[int, MeshArrays] = {}
        self._hair: dict[tuple[int, int], MeshArrays] = {}
        self._surfaces: dict[tuple, SurfaceArrays] = {}
        self._materials: dict[int, Shading] = {}
        self._images = ImageCache()
        self._hidden: set[str] = set()
        self._copied: set[str] = set()  # what does not render itself, but is shown by instances

    def read(self, instance: bpy.types.DepsgraphObjectInstance) -> ObjectSnapshot | None:
        """Arrays of one instance, or None when it is not a visible mesh with faces."""
        ob = instance.object
        if ob.type == "LIGHT":
            self._read_light(instance)
            return None
        if not self.shows(instance):
            return None
        if self._lights is not None:
            self._lights.note_linking(ob)
        key = ob.data.as_pointer()
        if has_strands(ob.data):
            if key not in self._meshes:
                self._meshes[key] = strands_mesh(ob.data, ob.name, self.notes)
            slot = ob.material_slots[0].material if ob.material_slots else None
            return self._strands(instance, instance_key(instance), self._meshes[key], slot)
        shadings = [*(self._shading(slot.material) for slot in ob.material_slots), self._shading(None)]
        surface_key = (key, *map(id, shadings))
        if surface_key not in self._surfaces:
            with self._evaluated(ob, shadings) as made:
                if key not in self._meshes:
                    mesh = read_mesh(made.mesh, self.lightmap and self.lightmap.uv_map)
                    self._meshes[key] = replace(mesh, face_origin=made.face_origin, rest=made.rest)
                else:
                    made.mesh.calc_loop_triangles()
                self._surfaces[surface_key] = read_surface(made.mesh, shadings, self.baked_layers)
        matrix = np.array(instance.matrix_world, np.float64)
        surface = self._surfaces[surface_key]
        occludes, gives_color = ray_visibility(instance)
        return ObjectSnapshot(
            instance_key(instance),
            ob.name,
            self._meshes[key],
            matrix,
            shadings,
            surface,
            materials_of(ob),
            ob.original.data.session_uid,
            occludes,
            gives_color,
        )

    def read_hair(self, instance: bpy.types.DepsgraphObjectInstance) -> list[ObjectSnapshot]:
        """The strands of particle systems on an instance, whether it is seen itself or not."""
        ob = instance.object
        if not instance.show_particles or not self._counts(instance):
            return []
        found = []
        for number, system in hair_systems(ob):
            key = ob.original.session_uid, number
            if key not in self._hair:
                self._hair[key] = hair_mesh(ob, system, self.notes)
            slot = system.settings.material - 1
            material = ob.material_slots[slot].material if 0 <= slot < len(ob.material_slots) else None
            found.append(self._strands(instance, (instance_key(instance), "hair", number), self._hair[key], material))
        return found

    def _strands(
        self,
        instance: bpy.types.DepsgraphObjectInstance,
        key: Hashable,
        mesh: MeshArrays,
        material: bpy.types.Material | None,
    ) -> ObjectSnapshot:
        shading, ob = self._shading(material), instance.object
        if shading.varies():
            what = "materials of hair and points use textures or attributes, so they count as grey there"
            self.notes.add(what, material.name, cure="give them a plain color, or expect the difference")
            shading = _GREY
        return ObjectSnapshot(
            key,
            ob.name,
            mesh,
            np.array(instance.matrix_world, np.float64),
            [shading, shading],
            NO_TRIANGLES,
            materials_of(ob),
            ob.original.data.session_uid,
            *ray_visibility(instance),
        )

    def _evaluated(self, ob: bpy.types.Object, shadings: list[Shading]) -> AbstractContextManager[EvaluatedMesh]:
        """The mesh of an evaluated object or instance, with where its faces come from if that has to be told."""
        original = ob.original
        keeps_uv = self.lightmap is not None and self.lightmap.uv_mode is UvMode.KEEP
        if isinstance(original.data, bpy.types.Mesh) and may_change_topology(original) and not keeps_uv:
            own = original.evaluated_get(self._depsgraph)  # an instance may be of it, or of what its nodes made
            results = {*self.baked_layers, *unread_results(original, shadings)}
            if own.data.as_pointer() == ob.data.as_pointer() and (
                original.session_uid in self._wanted or not results.isdisjoint(original.data.attributes.keys())
            ):
                return carried_mesh(own, self._depsgraph, self._needs_rest, results)
        return evaluated_mesh(ob)

    @property
    def images(self) -> set[int]:
        """Session uids of the images that were looked at."""
        return self._images.uids

    def shows(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        """Whether an instance is a mesh with faces, hair or points, and visible in the viewport and in renders."""
        ob = instance.object
        # Curves, texts and metaballs come twice: as themselves, and as the mesh that they evaluate to.
        is_mesh = isinstance(ob.data, bpy.types.Mesh) and len(ob.data.polygons)
        if not instance.show_self or not (is_mesh or has_strands(ob.data)):
            return False
        owner = instance.parent if instance.is_instance else ob
        if not self._renders(instance):
            self._hidden.add(ob.name)
            return False
        if instance.is_instance and ob.hide_render:
            self._copied.add(ob.name)
        return self._is_visible(owner)

    def _is_visible(self, ob: bpy.types.Object) -> bool:
        """Whether an object, evaluated or not, is visible in the viewport; in renders that does not count."""
        return self._depsgraph.mode == "RENDER" or (not ob.hide_viewport and ob.original.session_uid in self._shown)

    def _read_light(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        ob = instance.object
        owner = instance.parent if instance.is_instance else ob
        if self._lights is not None and instance.show_self and self._renders(instance) and self._is_visible(owner):
            self._lights.read(ob, np.array(instance.matrix_world, np.float64))

    def light_sources(self) -> LightSources:
        """Lights and world, once all instances are read."""
        if self._lights is None:
            return LightSources()
        self._lights.finish()
        self._note_volumes()
        return LightSources(tuple(self._lights.lamps), read_world(self._scene.world, self.notes))

    def _note_volumes(self) -> None:
        """Name objects that fill space with something, which is not modelled."""
        for ob in self._scene.collection.all_objects:
            if self._is_visible(ob) and (ob.type == "VOLUME" or any(map(_has_volume, ob.material_slots))):
                self.notes.add("volumes are not supported, so these do not dim or scatter light", ob.name)

    def _shading(self, material: bpy.types.Material | None) -> Shading:
        key = material.as_pointer() if material else 0
        if key not in self._materials:
            self._materials[key] = snapshot_material(material, self.notes, self._images)
        return self._materials[key]

    def _renders(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        """Whether an object, or its instance by another one, shows up in renders.

        Particles and nodes show copies of an object that does not render itself, which is the usual way to keep it out
        of the picture; instances of a collection, and on faces and vertices, do not.
        """
        ob = instance.object
        owner = instance.parent if instance.is_instance else ob
        if owner.hide_render or owner.original.session_uid not in self._rendered:
            return False
        if not instance.is_instance:
            return not ob.is_instancer or ob.show_instancer_for_render
        if owner.instance_type == "NONE" or instance.particle_system is not None:
            return True
        return not ob.hide_render and ob.original.session_uid not in self._hidden_members(owner.original)

    def _counts(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        """Whether what an object carries shows up in renders, even if an instancer itself does not."""
        owner = instance.parent if instance.is_instance else instance.object
        if not instance.is_instance:
            rendered = not owner.hide_render and owner.original.session_uid in self._rendered
            return rendered and self._is_visible(owner)
        return self._renders(instance) and self._is_visible(owner)

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
        """Name what does not count, or not as it renders, although a user may expect it to."""
        unseen, dark, otherwise = set(), set(), set()
        for ob in self._scene.collection.all_objects:
            is_light = ob.type == "LIGHT" and self._lights is not None
            if is_light and not ob.hide_render and ob.session_uid in self._rendered and not self._is_visible(ob):
                dark.add(ob.name)
            if ob.type not in SOLID_TYPES:
                continue
            if ob.hide_render or ob.session_uid not in self._rendered:
                self._hidden.add(ob.name)
            elif not self._is_visible(ob):
                unseen.add(ob.name)
            elif self._depsgraph.mode != "RENDER" and renders_otherwise(self._scene, ob):
                otherwise.add(ob.name)
        for names, what, cure in (
            (self._hidden - self._copied, "hidden from renders, so they do not occlude", ""),
            (dark, "hidden in the viewport, so they do not light although they render", _SHOW),
            (unseen, "hidden in the viewport, so they do not occlude although they render", _SHOW),
            (otherwise, "baked as the viewport shows them, while renders use other modifiers or levels", _AS_RENDERED),
        ):
            if names:
                self.notes.add(what, *names, cure=cure)


def instance_key(instance: bpy.types.DepsgraphObjectInstance) -> Hashable:
    """What tells an object or instance from all others, from one frame to the next."""
    uid = instance.object.original.session_uid
    if not instance.is_instance:
        return uid
    return instance.parent.original.session_uid, uid, tuple(instance.persistent_id)


def ray_visibility(instance: bpy.types.DepsgraphObjectInstance) -> tuple[bool, bool]:
    """Whether an object or instance throws shadows, and whether diffuse rays see it, in Cycles and so here.

    Cycles takes both flags from the object that is instanced and from the one that shows the instance. Its ambient
    occlusion asks shadow rays.
    """
    owners = [instance.object, instance.parent] if instance.is_instance else [instance.object]
    return all(ob.visible_shadow for ob in owners), all(ob.visible_diffuse for ob in owners)


def unread_results(ob: bpy.types.Object, shadings: Iterable[Shading]) -> set[str]:
    """Names of the layers of a mesh that bakes made and that neither its materials nor its nodes may read."""
    if any(modifier.type == "NODES" for modifier in ob.modifiers):
        return set()
    mesh = ob.data
    read = {name for shading in shadings for name in (*shading.uv_maps(), *shading.color_attributes())}
    if "" in read:
        read |= {layer.name for layer in mesh.uv_layers if layer.active_render} | {mesh.attributes.default_color_name}
    return {layer.name for layer in mesh.obscurance_layers if any(layer.made())} - read


def materials_of(ob: bpy.types.Object) -> tuple[int, ...]:
    """Session uid of the material in each slot, 0 for none."""
    return tuple(slot.material.original.session_uid if slot.material else 0 for slot in ob.material_slots)


def _has_volume(slot: bpy.types.MaterialSlot) -> bool:
    tree = node_tree_of(slot.material) if slot.material else None
    end = tree.get_output_node("CYCLES") if tree else None
    return end is not None and end.inputs["Volume"].is_linked
