"""Small scenes, bakes, and what a file holds, for the tests."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import bpy
import numpy as np

from obscurance_addon.blender.jobs.job import BakeJob, BakeReport
from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.core.light.settings import LightSettings
from obscurance_addon.core.order.arrays import BakeArrays, prepare_arrays
from obscurance_addon.core.order.output import OutputSettings, Target
from obscurance_addon.core.order.snapshot import SceneSnapshot
from obscurance_addon.core.settings import BakeSettings

FACE_LAYER, CORNER_LAYER = "Obscurance", "Obscurance Color"
ROUNDING = 1e-6  # of float32 values near 1
SEEDS, SIGMAS = 16, 5.0  # Student's t with 15 degrees of freedom exceeds 5 once in 6,000 comparisons
NEAR_ORIGIN = 2e-6  # rays start a hair above their patch

_SETTINGS = {field.name for field in dataclasses.fields(BakeSettings)}
_LIGHT = {field.name for field in dataclasses.fields(LightSettings)}
_READERS = {
    "FLOAT": ("value", "f4", 1),
    "INT": ("value", "i4", 1),
    "INT8": ("value", "i4", 1),
    "BOOLEAN": ("value", "?", 1),
    "FLOAT_VECTOR": ("vector", "f4", 3),
    "FLOAT2": ("vector", "f4", 2),
    "FLOAT_COLOR": ("color", "f4", 4),
    "BYTE_COLOR": ("color", "f4", 4),
    "INT32_2D": ("value", "i4", 2),
    "INT16_2D": ("value", "i4", 2),
    "QUATERNION": ("value", "f4", 4),
}

# ------------------------------------------------------------------------------------------------------- building


def material(name: str, color: Sequence[float]) -> bpy.types.Material:
    """A Principled material of a linear base colour."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        made.use_nodes = True
    node = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Base Color"].default_value = (*color, 1.0)
    return made


def new_object(
    name: str,
    vertices: Iterable[Sequence[float]],
    faces: Iterable[Sequence[int]],
    color: Sequence[float] | None = None,
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """A mesh object in the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, v)) for v in vertices], [], [tuple(map(int, f)) for f in faces])
    mesh.update()
    if color is not None:
        mesh.materials.append(material(name, color))
    made = bpy.data.objects.new(name, mesh)
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def sheet(
    name: str, corner: Sequence[float], u: Sequence[float], v: Sequence[float], nu: int = 1, nv: int = 1, **kw: object
) -> bpy.types.Object:
    """A parallelogram of nu x nv quads; face j * nu + i lies i steps along u and j along v, its normal is u x v."""
    corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
    points = [corner + u * i / nu + v * j / nv for j in range(nv + 1) for i in range(nu + 1)]
    first = [j * (nu + 1) + i for j in range(nv) for i in range(nu)]
    return new_object(name, points, [(a, a + 1, a + nu + 2, a + nu + 1) for a in first], **kw)


def floor(name: str = "Floor", size: float = 2.0, n: int = 1, z: float = 0.0, **kw: object) -> bpy.types.Object:
    """A horizontal square of n x n faces about the z axis, looking up."""
    return sheet(name, (-size / 2, -size / 2, z), (size, 0, 0), (0, size, 0), n, n, **kw)


CUBE_VERTICES = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # -x +x -y +y -z +z


def cube(name: str = "Cube", half: float = 1.0, **kw: object) -> bpy.types.Object:
    """A cube seen from outside, faces in the order -x, +x, -y, +y, -z, +z."""
    return new_object(name, np.array(CUBE_VERTICES) * half, CUBE_FACES, **kw)


def put(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str) -> None:
    """An attribute as a user may have made it, with values that differ, alpha included."""
    mesh.attributes.new(name, data_type, domain)
    key, dtype, width = _READERS[data_type]
    count = len(mesh.attributes[name].data) * width
    values = np.arange(count) if dtype == "i4" else np.linspace(0.0, 1.0, count)
    mesh.attributes[name].data.foreach_set(key, values.astype(dtype))


def select(*objects: bpy.types.Object) -> None:
    """Select these objects only; the first one is active."""
    bpy.context.view_layer.update()
    for ob in bpy.context.view_layer.objects:
        ob.select_set(ob in objects)
    bpy.context.view_layer.objects.active = objects[0] if objects else None


def layer_collection(name: str) -> bpy.types.LayerCollection:
    """A collection right below the scene's, as the view layer sees it."""
    return bpy.context.view_layer.layer_collection.children[name]


def new_collection(name: str, linked: bool = True) -> bpy.types.Collection:
    """A collection, in the scene or only in the file."""
    made = bpy.data.collections.new(name)
    if linked:
        bpy.context.scene.collection.children.link(made)
    return made


# -------------------------------------------------------------------------------------------------------- reading


def snapshot(*objects: bpy.types.Object, needs_rest: bool = False) -> SceneSnapshot:
    """What a bake of these objects reads."""
    bpy.context.view_layer.update()
    return snapshot_scene(bpy.context, objects, needs_rest=needs_rest)


def arrays(*objects: bpy.types.Object, target: str = "FACE") -> BakeArrays:
    """What a bake of these objects hands to the core."""
    return prepare_arrays(snapshot(*objects, needs_rest=target != "FACE"), Target(target))


def occluders(*objects: bpy.types.Object) -> dict[str, list[np.ndarray]]:
    """World triangles (t, 3, 3) of what occludes these objects, by name, one entry for each instance."""
    found: dict[str, list[np.ndarray]] = {}
    taken = snapshot(*objects)
    for part in taken.occluders:
        points = part.mesh.positions @ part.matrix[:3, :3].T + part.matrix[:3, 3]
        found.setdefault(part.name, []).append(points[part.mesh.corner_vertex[part.mesh.triangle_corners]])
    return found


def areas(triangles: np.ndarray) -> np.ndarray:
    """(t,) areas of triangles (t, 3, 3)."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return 0.5 * np.linalg.norm(normal, axis=1)


def element_areas(made: BakeArrays, index: int = 0) -> np.ndarray:
    """Area of the patch behind each element of one baked object."""
    own = made.ranges[index]
    patch_areas = np.bincount(made.patches.patch, areas(made.patches.corners), len(made.patches))
    return patch_areas[own.first : own.end][own.element_patch]


def notes_about(notes: Iterable[str], *words: str) -> list[str]:
    """The notes that have all of these words."""
    return [note for note in notes if all(word in note for word in words)]


# --------------------------------------------------------------------------------------------------------- baking


def job(*objects: bpy.types.Object, **changes: object) -> BakeJob:
    """A bake with 16 rays and a reach of 1 m unless told otherwise; settings of estimator, light and output by name."""
    bpy.context.view_layer.update()
    changes = {"rays": 16, "distance": 1.0, "threads": 1} | changes
    settings = BakeSettings(**{k: v for k, v in changes.items() if k in _SETTINGS})
    light = LightSettings(**{k: v for k, v in changes.items() if k in _LIGHT})
    output = OutputSettings(**{k: v for k, v in changes.items() if k not in _SETTINGS | _LIGHT})
    return BakeJob(bpy.context, objects, settings, output, light)


def bake(*objects: bpy.types.Object, **changes: object) -> BakeReport:
    """Bake and write."""
    return job(*objects, **changes).run()


def read(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """All values of an attribute, (n, width) or (n,)."""
    attribute = mesh.attributes[name]
    key, dtype, width = _READERS[attribute.data_type]
    values = np.empty(len(attribute.data) * width, dtype)
    attribute.data.foreach_get(key, values)
    return values.reshape(-1, width) if width > 1 else values


def colors(ob: bpy.types.Object, name: str = FACE_LAYER) -> np.ndarray:
    """Baked colours (n, 3) of an object."""
    return read(ob.data, name)[:, :3]


def baked(ob: bpy.types.Object, name: str = FACE_LAYER, **changes: object) -> np.ndarray:
    """Bake one object and return its colours (n, 3)."""
    bake(ob, **changes)
    return colors(ob, name)


def mean_over_seeds(values: Callable[[int], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean over independent seeds of values(seed), and what it may differ from the truth by."""
    all_values = np.array([values(seed) for seed in range(SEEDS)], np.float64)
    return all_values.mean(0), SIGMAS * all_values.std(0, ddof=1) / SEEDS**0.5 + NEAR_ORIGIN


# ------------------------------------------------------------------------------------------------- what a file holds


def mesh_state(mesh: bpy.types.Mesh, without: Sequence[str] = ()) -> dict[str, object]:
    """Everything that a mesh holds, as comparable values; attributes named in `without` are left out."""
    names = [name for name in mesh.attributes.keys() if name not in without]  # noqa: SIM118 - names, not attributes
    active = mesh.attributes.active
    return {
        "attributes": {
            name: (mesh.attributes[name].data_type, mesh.attributes[name].domain, read(mesh, name).tobytes())
            for name in names
        },
        "active attribute": active.name if active else None,
        "active color": mesh.attributes.active_color_name,
        "default color": mesh.attributes.default_color_name,
        "uv": [(uv.name, uv.active_render) for uv in mesh.uv_layers],
        "active uv": mesh.uv_layers.active.name if mesh.uv_layers.active else None,
        "materials": [m.name if m else None for m in mesh.materials],
        "shape keys": [(k.name, k.value, _points(k.data)) for k in mesh.shape_keys.key_blocks]
        if mesh.shape_keys
        else None,
        "custom": {key: value for key, value in mesh.items() if key != "obscurance_layers"},
        "users": mesh.users,
    }


def _points(data: bpy.types.bpy_prop_collection) -> bytes:
    points = np.empty(len(data) * 3, np.float32)
    data.foreach_get("co", points)
    return points.tobytes()


def _settings(owner: bpy.types.bpy_struct) -> dict[str, object]:
    """All plain properties of a struct."""
    found = {}
    for prop in owner.bl_rna.properties:
        if prop.type in {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"} and prop.identifier != "execution_time":
            value = getattr(owner, prop.identifier)
            found[prop.identifier] = tuple(np.ravel(value)) if getattr(prop, "is_array", False) else value
    return found


def object_state(ob: bpy.types.Object) -> dict[str, object]:
    """Everything that an object holds but its mesh."""
    return {
        "data": ob.data.name if ob.data else None,
        "mode": ob.mode,
        "selected": ob.select_get(),
        "matrix": [tuple(row) for row in ob.matrix_world],
        "groups": [(g.name, g.index) for g in ob.vertex_groups],
        "active group": ob.vertex_groups.active_index,
        "slots": [(slot.link, slot.material.name if slot.material else None) for slot in ob.material_slots],
        "modifiers": [_settings(modifier) for modifier in ob.modifiers],
        "hidden": (ob.hide_render, ob.hide_viewport, ob.hide_get()),
        "custom": dict(ob.items()),
        "parent": ob.parent.name if ob.parent else None,
    }


def file_state(without: Sequence[str] = ()) -> dict[str, object]:
    """Everything of a file that a bake could spoil; needs object mode. Attributes in `without` are left out."""
    view_layer = bpy.context.view_layer
    view_layer.update()
    groups = (kind for kind in dir(bpy.data) if isinstance(getattr(bpy.data, kind), bpy.types.bpy_prop_collection))
    return {
        "names": {kind: [block.name for block in getattr(bpy.data, kind)] for kind in groups},
        "meshes": {mesh.name: mesh_state(mesh, without) for mesh in bpy.data.meshes},
        "objects": {ob.name: object_state(ob) for ob in view_layer.objects},
        "active": view_layer.objects.active.name if view_layer.objects.active else None,
        "settings": _settings(bpy.context.scene.obscurance),
        "frame": bpy.context.scene.frame_current,
    }


def subset(state: dict[str, object]) -> dict[str, object]:
    """A mesh's state without what a bake is meant to change: the active and, where there was none, default colour."""
    return {key: value for key, value in state.items() if key not in {"active color", "default color", "users"}}
