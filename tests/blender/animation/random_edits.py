"""A scene that is edited at random, in every way that users edit scenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from tests.blender.animation.preview_helpers import build_room
from tests.blender.helpers import FACE_LAYER, cube, material, select, sheet

MODIFIERS = (
    "ARRAY", "BEVEL", "BOOLEAN", "BUILD", "CAST", "DECIMATE", "DISPLACE", "EDGE_SPLIT", "MASK", "MIRROR", "MULTIRES",
    "REMESH", "SCREW", "SHRINKWRAP", "SIMPLE_DEFORM", "SKIN", "SMOOTH", "SOLIDIFY", "SUBSURF", "TRIANGULATE", "WAVE",
    "WEIGHTED_NORMAL", "WELD", "WIREFRAME",
)  # fmt: skip
MOST_OBJECTS, MOST_FACES, LAST_FRAME = 9, 400, 12


class RandomEdits:
    """A scene that is edited at random; all edits follow from the seed.

    Parameters
    ----------
    seed : int
    folder : Path
        For files that are saved and loaded.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self._random = np.random.default_rng(seed)
        self._path, self._number = str(folder / "edited.blend"), 0
        bpy.ops.wm.read_factory_settings(use_empty=True)
        build_room(bpy.context.scene)
        bpy.context.scene.obscurance.live_preview = True
        self.set_frame()
        self.push("start")

    def edit(self) -> str:
        """Edit something; what was done."""
        edit = self._any(EDITS)
        name = edit.__name__
        try:
            edit(self)
        except (RuntimeError, TypeError) as error:  # what Blender cannot do in this scene
            name = f"{name}, refused: {str(error).strip()[:60]}"
        self._limit()
        return name

    def set_frame(self) -> None:
        """Go to some frame."""
        bpy.context.scene.frame_set(int(self._random.integers(1, LAST_FRAME)))

    def push(self, name: str) -> None:
        """Add an undo step."""
        bpy.ops.ed.undo_push(message=name)

    def happens(self, chance: float) -> bool:
        """True in that share of all cases."""
        return bool(self._random.random() < chance)

    # ------------------------------------------------------------------------------------------------ what edits use

    def _meshes(self) -> list[bpy.types.Object]:
        return [ob for ob in bpy.context.view_layer.objects if ob.type == "MESH"]

    def _any(self, of: list) -> object:
        if not of:
            raise RuntimeError("there is none")
        return of[self._random.integers(len(of))]

    def _object(self) -> bpy.types.Object:
        return self._any(self._meshes())

    def _place(self, low: float = 0.2) -> np.ndarray:
        return self._random.uniform((-1.5, -1.5, low), (1.5, 1.5, 1.5))

    def _color(self) -> np.ndarray:
        return self._random.uniform(0.05, 0.9, 3)

    def _name(self, kind: str) -> str:
        self._number += 1
        return f"{kind} {self._number}"

    def _limit(self) -> None:
        """Keep the scene small."""
        if bpy.context.mode != "OBJECT":
            return
        for ob in self._meshes()[MOST_OBJECTS:]:
            bpy.data.objects.remove(ob)
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for ob in self._meshes():
            if len(ob.data.polygons) > MOST_FACES:
                bpy.data.objects.remove(ob)
            elif len(ob.evaluated_get(depsgraph).data.polygons) > MOST_FACES:
                ob.modifiers.clear()
        if not any(len(ob.data.polygons) and not ob.hide_render for ob in self._meshes()):
            cube(self._name("Cube"), 0.3, color=self._color()).location = self._place()

    # ------------------------------------------------------------------------------------------------------- edits

    def add(self) -> None:
        if self.happens(0.5):
            made = cube(self._name("Cube"), self._random.uniform(0.1, 0.4), color=self._color())
        else:
            made = sheet(self._name("Sheet"), (0, 0, 0), (0.8, 0, 0.1), (0, 0.7, 0.2), 2, 2, color=self._color())
        made.location, made.rotation_euler = self._place(), self._random.uniform(0, 3, 3)

    def remove(self) -> None:
        bpy.data.objects.remove(self._object())

    def duplicate(self) -> None:
        ob = self._object()
        twin = ob.copy()
        if self.happens(0.6):
            twin.data = ob.data.copy()
        twin.location = self._place()
        bpy.context.scene.collection.objects.link(twin)

    def rename(self) -> None:
        self._object().name = self._name("Named")

    def link_data(self) -> None:
        self._object().data = self._object().data

    def make_single_user(self) -> None:
        ob = self._object()
        ob.data = ob.data.copy()

    def move(self) -> None:
        ob = self._object()
        ob.location = self._place()
        ob.rotation_euler = self._random.uniform(0, 3, 3)

    def scale(self) -> None:
        self._object().scale = self._random.uniform(0.5, 1.3, 3) * self._random.choice([-1, 1], 3, p=[0.1, 0.9])

    def key_location(self) -> None:
        ob = self._object()
        for frame in (1, LAST_FRAME):
            ob.location = self._place()
            ob.keyframe_insert("location", frame=frame)

    def key_visibility(self) -> None:
        ob, path = self._object(), self._any(["hide_render", "hide_viewport"])
        for frame in (1, 4, 8):
            setattr(ob, path, self.happens(0.5))
            ob.keyframe_insert(path, frame=frame)

    def clear_animation(self) -> None:
        self._object().animation_data_clear()

    def toggle_visibility(self) -> None:
        ob = self._object()
        path = self._any(["hide_render", "hide_viewport", "eye"])
        if path == "eye":
            ob.hide_set(not ob.hide_get())
        else:
            setattr(ob, path, not getattr(ob, path))

    def parent(self) -> None:
        one, other = self._object(), self._object()
        if one != other and other.parent is None and not one.children:
            one.parent = other

    def add_modifier(self) -> None:
        ob, kind = self._object(), self._any(list(MODIFIERS))
        made = ob.modifiers.new(kind, kind)
        if made is None:
            raise RuntimeError("not for this object")
        others = [other for other in self._meshes() if other != ob and not other.modifiers]
        if kind in {"BOOLEAN", "SHRINKWRAP"} and others:
            setattr(made, "object" if kind == "BOOLEAN" else "target", self._any(others))
        if kind == "SCREW":
            made.steps = made.render_steps = 3
        if kind == "REMESH":
            made.mode, made.octree_depth = "BLOCKS", 2
        if kind in {"WIREFRAME", "SOLIDIFY"}:
            made.thickness = 0.05
        self._vary(made)

    def _vary(self, modifier: bpy.types.Modifier) -> None:
        for name, low, high in (
            ("count", 1, 4), ("width", 0.01, 0.1), ("ratio", 0.3, 1.0), ("strength", 0.1, 0.6), ("factor", 0.1, 1.0),
            ("frame_duration", 2, 10), ("angle", 0.1, 2.0), ("merge_threshold", 0.001, 0.3), ("levels", 0, 2),
        ):  # fmt: skip
            if hasattr(modifier, name):
                value = self._random.uniform(low, high)
                setattr(modifier, name, int(value) if isinstance(getattr(modifier, name), int) else value)

    def _modifier(self) -> tuple[bpy.types.Object, bpy.types.Modifier]:
        ob = self._any([ob for ob in self._meshes() if ob.modifiers])
        return ob, self._any(list(ob.modifiers))

    def change_modifier(self) -> None:
        self._vary(self._modifier()[1])

    def toggle_modifier(self) -> None:
        _ob, modifier = self._modifier()
        modifier.show_viewport = not modifier.show_viewport

    def remove_modifier(self) -> None:
        ob, modifier = self._modifier()
        ob.modifiers.remove(modifier)

    def apply_modifier(self) -> None:
        ob, modifier = self._modifier()
        select(ob)
        bpy.ops.object.modifier_apply(modifier=modifier.name)

    def move_vertex(self) -> None:
        mesh = self._object().data
        vertex = self._any(list(mesh.vertices))
        vertex.co += type(vertex.co)(self._random.uniform(-0.1, 0.1, 3))
        mesh.update()

    def edit_faces(self) -> None:
        import bmesh  # there only once bpy is

        mesh = self._object().data
        made = bmesh.new()
        made.from_mesh(mesh)
        made.faces.ensure_lookup_table()
        face = self._any(list(made.faces))
        if self.happens(0.5):
            bmesh.ops.delete(made, geom=[face], context="FACES_ONLY")
        else:
            bmesh.ops.subdivide_edges(made, edges=list(face.edges), cuts=1, use_grid_fill=True)
        made.to_mesh(mesh)
        made.free()
        mesh.update()

    def flip_normals(self) -> None:
        self._object().data.flip_normals()

    def edit_mode(self) -> None:
        select(self._object())
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        self.set_frame()
        if self.happens(0.7):
            bpy.ops.transform.translate(value=self._random.uniform(-0.1, 0.1, 3))
        bpy.ops.object.mode_set(mode="OBJECT")

    def paint_mode(self) -> None:
        select(self._object())
        bpy.ops.object.mode_set(mode=self._any(["VERTEX_PAINT", "WEIGHT_PAINT", "SCULPT", "TEXTURE_PAINT"]))
        self.set_frame()
        bpy.ops.object.mode_set(mode="OBJECT")

    def shape_key(self) -> None:
        ob = self._object()
        if ob.data.shape_keys is None:
            ob.shape_key_add(name="Basis")
        key = ob.shape_key_add(name="Key")
        for point in key.data:
            point.co *= float(self._random.uniform(0.7, 1.3))
        for frame, value in ((1, 0.0), (6, 1.0), (9, 0.0)):
            key.value = value
            key.keyframe_insert("value", frame=frame)

    def new_material(self) -> None:
        mesh = self._object().data
        made = material(self._name("Material"), self._color())
        if mesh.materials and self.happens(0.6):
            mesh.materials[0] = made
        else:
            mesh.materials.append(made)
            self._any(list(mesh.polygons)).material_index = len(mesh.materials) - 1

    def _nodes(self) -> tuple[bpy.types.Material, bpy.types.Node]:
        made = self._any([m for m in bpy.data.materials if m.users and m.node_tree is not None])
        return made, next(node for node in made.node_tree.nodes if node.type == "BSDF_PRINCIPLED")

    def change_color(self) -> None:
        self._nodes()[1].inputs["Base Color"].default_value = (*self._color(), 1.0)

    def key_color(self) -> None:
        color = self._nodes()[1].inputs["Base Color"]
        for frame in (1, LAST_FRAME):
            color.default_value = (*self._color(), 1.0)
            color.keyframe_insert("default_value", frame=frame)

    def remove_material(self) -> None:
        bpy.data.materials.remove(self._nodes()[0])

    def object_material(self) -> None:
        slot = self._any(list(self._any([ob for ob in self._meshes() if ob.material_slots]).material_slots))
        slot.link = "OBJECT" if slot.link == "DATA" else "DATA"
        slot.material = self._nodes()[0]

    def new_texture(self) -> None:
        made, shader = self._nodes()
        node = made.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.new(self._name("Image"), 8, 8)
        node.image.pixels.foreach_set(self._random.random(256).astype(np.float32))
        made.node_tree.links.new(node.outputs[0], shader.inputs["Base Color"])

    def new_color_source(self) -> None:
        made, shader = self._nodes()
        node = made.node_tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = "mine"
        made.node_tree.links.new(node.outputs[0], shader.inputs["Base Color"])

    def paint_own_layer(self) -> None:
        mesh = self._object().data
        layer = mesh.attributes.get("mine") or mesh.attributes.new("mine", "FLOAT_COLOR", "CORNER")
        layer.data.foreach_set("color", self._random.random(4 * len(layer.data)).astype(np.float32))
        mesh.update()

    def unlink_texture(self) -> None:
        shader = self._nodes()[1]
        for link in list(shader.inputs["Base Color"].links):
            shader.id_data.links.remove(link)

    def _image(self) -> bpy.types.Image:
        return self._any([image for image in bpy.data.images if image.size[0] == image.size[1] and image.users])

    def set_pixels(self) -> None:
        image = self._image()
        image.pixels.foreach_set(self._random.random(len(image.pixels)).astype(np.float32))
        if self.happens(0.5):
            image.update()

    def set_pixels_and_pack(self) -> None:
        self.set_pixels()
        self._image().pack()

    def scale_image(self) -> None:
        self._image().scale(4, 4)

    def color_space(self) -> None:
        self._image().colorspace_settings.name = self._any(["sRGB", "Non-Color"])

    def new_uv_map(self) -> None:
        layer = self._object().data.uv_layers.new(name=self._name("UV"))
        if layer is None:
            raise RuntimeError("no more")
        layer.uv.foreach_set("vector", self._random.random(2 * len(layer.uv)).astype(np.float32))
        layer.active_render = self.happens(0.5)

    def change_uv(self) -> None:
        mesh = self._any([ob.data for ob in self._meshes() if ob.data.uv_layers])
        layer = self._any(list(mesh.uv_layers))
        if self.happens(0.3):
            mesh.uv_layers.remove(layer)
        else:
            layer.uv.foreach_set("vector", self._random.random(2 * len(layer.uv)).astype(np.float32))
        mesh.update()

    def _result(self) -> bpy.types.Attribute:
        found = [ob.data.attributes[FACE_LAYER] for ob in self._meshes() if FACE_LAYER in ob.data.attributes]
        return self._any(found)

    def remove_result(self) -> None:
        layer = self._result()
        layer.id_data.attributes.remove(layer)

    def rename_result(self) -> None:
        self._result().name = self._name("Kept")

    def new_collection(self) -> None:
        made = bpy.data.collections.new(self._name("Collection"))
        bpy.context.scene.collection.children.link(made)
        made.objects.link(self._object())

    def hide_collection(self) -> None:
        layer = self._any(list(bpy.context.view_layer.layer_collection.children))
        path = self._any(["exclude", "hide_viewport"])
        setattr(layer, path, not getattr(layer, path))

    def hide_collection_in_renders(self) -> None:
        layer = self._any(list(bpy.context.view_layer.layer_collection.children))
        layer.collection.hide_render = not layer.collection.hide_render

    def instance_collection(self) -> None:
        empty = bpy.data.objects.new(self._name("Empty"), None)
        empty.instance_type, empty.instance_collection = "COLLECTION", self._any(list(bpy.data.collections))
        empty.location = self._place(0.5)
        bpy.context.scene.collection.objects.link(empty)

    def remove_empties(self) -> None:
        for ob in [ob for ob in bpy.context.view_layer.objects if ob.type == "EMPTY"]:
            bpy.data.objects.remove(ob)

    def undo(self) -> None:
        bpy.ops.ed.undo()

    def redo(self) -> None:
        bpy.ops.ed.redo()

    def undo_and_redo(self) -> None:
        bpy.ops.ed.undo()
        self.set_frame()
        bpy.ops.ed.redo()

    def copy_scene(self) -> None:
        if len(bpy.data.scenes) > 1:
            bpy.ops.scene.delete()
        else:
            bpy.ops.scene.new(type=self._any(["FULL_COPY", "LINK_COPY"]))

    def save_and_load(self) -> None:
        bpy.ops.wm.save_as_mainfile(filepath=self._path)
        bpy.ops.wm.open_mainfile(filepath=self._path)
        self.push("loaded")

    def switch_off_and_on(self) -> None:
        group = bpy.context.scene.obscurance
        group.live_preview = False
        self.set_frame()
        group.live_preview = True

    def change_settings(self) -> None:
        group = bpy.context.scene.obscurance
        group.use_bleeding = not group.use_bleeding


EDITS: list[Callable[[RandomEdits], None]] = [
    function for name, function in vars(RandomEdits).items()
    if not name.startswith("_") and name not in {"edit", "set_frame", "push", "happens"}
]  # fmt: skip
