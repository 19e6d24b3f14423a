"""The committed sample scenes: exact patch counts, published measurements, closed solids, normals, colours."""

from __future__ import annotations

import importlib.util
import itertools
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from obscurance_addon.core.lightmap import UnwrapMesh, Unwrapper, unwrap

bpy = pytest.importorskip("bpy")

FOLDER = Path(__file__).resolve().parents[3] / "sample_blends"
LARGEST_FILE = 400 * 1024
TIGHT = 1e-6  # metres: float32 coordinates of scenes of a few metres

PATCHES = {
    "cornell_box": 1744,
    "light_near_wall": 1652,
    "room_1423": 1423,
    "room_4016": 4016,
    "infinite_5508": 5508,
    "infinite_13824": 13824,
}
POLYGONS = {
    "cornell_box": 18,
    "light_near_wall": 24,
    "room_1423": 73,
    "room_4016": 73,
    "infinite_5508": 180,
    "infinite_13824": 180,
}
ROOMS = ["room_1423", "room_4016"]
MAZES = ["infinite_5508", "infinite_13824"]

# Linear Rec.709 reflectances as sample_blends/README.md lists them, to three decimals.
COLOURS = {
    "cornell_box": {"White": (0.738, 0.736, 0.737), "Red": (0.524, 0.050, 0.050), "Green": (0.052, 0.397, 0.086)},
    "light_near_wall": {"White": (0.75, 0.75, 0.75), "Blue": (0.08, 0.12, 0.65)},
    "room_1423": {"Red": (0.75, 0.06, 0.05), "Yellow": (0.80, 0.65, 0.06), "Wall": (0.70, 0.70, 0.68)},
    "room_4016": {"Red": (0.75, 0.06, 0.05), "Yellow": (0.80, 0.65, 0.06), "Wall": (0.70, 0.70, 0.68)},
    "infinite_5508": {"Frame": (0.70, 0.70, 0.70), "Blue": (0.12, 0.25, 0.72), "Red": (0.72, 0.10, 0.10)},
    "infinite_13824": {"Frame": (0.70, 0.70, 0.70), "Blue": (0.12, 0.25, 0.72), "Red": (0.72, 0.10, 0.10)},
}
EMISSIONS = {
    "cornell_box": ("Light", (17.971, 11.525, 3.164)),
    "light_near_wall": ("Lamp", (60.0, 60.0, 60.0)),
    "room_1423": ("Light Strip", (4.0, 4.0, 4.0)),
    "room_4016": ("Light Strip", (4.0, 4.0, 4.0)),
}

# Corners of the blocks on the Cornell Box data page, in millimetres: x to the left, y up, z away from the camera.
SHORT_BLOCK = [(130, 65), (82, 225), (240, 272), (290, 114)]
TALL_BLOCK = [(423, 247), (265, 296), (314, 456), (472, 406)]


def load_make_samples():
    spec = importlib.util.spec_from_file_location("make_samples", FOLDER / "make_samples.py")
    module = importlib.util.module_from_spec(spec)
    before = list(sys.path)
    spec.loader.exec_module(module)
    sys.path[:] = before
    return module


MAKE_SAMPLES = load_make_samples()


def open_sample(name: str):
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / f"{name}.blend"))
    return bpy.context.scene


def mesh_objects(scene):
    return [item for item in scene.objects if item.type == "MESH"]


def world_vertices(item) -> np.ndarray:
    local = np.array([vertex.co for vertex in item.data.vertices])
    matrix = np.array(item.matrix_world)
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def unwrap_mesh(item) -> UnwrapMesh:
    item.data.calc_loop_triangles()
    faces, triangles = faces_of(item), item.data.loop_triangles
    return UnwrapMesh(
        item.name,
        world_vertices(item),
        np.concatenate(faces),
        np.cumsum([0, *map(len, faces)]),
        np.array([triangle.loops for triangle in triangles]),
        np.array([triangle.polygon_index for triangle in triangles]),
    )


def faces_of(item) -> list[tuple[int, ...]]:
    return [tuple(polygon.vertices) for polygon in item.data.polygons]


def separate(faces) -> list[list[tuple[int, ...]]]:
    """Split faces into groups that share no vertex."""
    parent: dict[int, int] = {}

    def root(vertex: int) -> int:
        while parent.setdefault(vertex, vertex) != vertex:
            vertex = parent[vertex]
        return vertex

    for face in faces:
        for vertex in face[1:]:
            parent[root(vertex)] = root(face[0])
    groups: dict[int, list[tuple[int, ...]]] = {}
    for face in faces:
        groups.setdefault(root(face[0]), []).append(face)
    return list(groups.values())


def directed_edges(faces) -> Counter:
    return Counter(edge for face in faces for edge in zip(face, (*face[1:], face[0]), strict=True))


def is_closed(faces) -> bool:
    edges = directed_edges(faces)
    return all(count == 1 and edges[end, start] == 1 for (start, end), count in edges.items())


def signed_volume(vertices: np.ndarray, faces) -> float:
    """Six times the sum of tetrahedra to the first vertex, positive for outward normals."""
    points = vertices - vertices[faces[0][0]]
    fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
    a, b, c = (points[[fan[k] for fan in fans]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


def shader_of(material):
    return material.node_tree.get_output_node("CYCLES").inputs["Surface"].links[0].from_node


def extents(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return vertices.min(axis=0), vertices.max(axis=0)


def gap(first, second) -> float:
    """Largest distance along an axis between two boxes; negative when they overlap."""
    return float(np.max(np.maximum(first[0] - second[1], second[0] - first[1])))


def at_frame(scene, frame: int) -> None:
    scene.frame_set(frame)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("name", PATCHES)
def test_file_has_exactly_the_patches(name):
    scene = open_sample(name)
    assert sum(len(item.data.polygons) for item in mesh_objects(scene)) == PATCHES[name]
    assert all(len(face) == 4 for item in mesh_objects(scene) for face in faces_of(item))


@pytest.mark.parametrize("name", PATCHES)
def test_polygons_before_meshing(name):
    sample = MAKE_SAMPLES.SAMPLES[name]()
    assert len(sample.quads()) == POLYGONS[name]
    assert sample.patch_count() == PATCHES[name]
    sample.check()


@pytest.mark.parametrize("name", PATCHES)
def test_file_is_what_make_samples_describes(name):
    sample = MAKE_SAMPLES.SAMPLES[name]()
    scene = open_sample(name)
    assert {item.name for item in mesh_objects(scene)} == {item.name for item in sample.objects}
    for described in sample.objects:
        item = scene.objects[described.name]
        meshes = [body.mesh() for body in described.bodies]
        expected = np.concatenate([vertices for vertices, _, _ in meshes])
        found = np.array([vertex.co for vertex in item.data.vertices])
        np.testing.assert_allclose(found, expected, atol=TIGHT)
        names = [slot.name for slot in item.data.materials]
        painted = [names[polygon.material_index] for polygon in item.data.polygons]
        assert painted == [paint for _, _, paints in meshes for paint in paints]


@pytest.mark.parametrize("name", PATCHES)
def test_file_is_small(name):
    assert (FOLDER / f"{name}.blend").stat().st_size < LARGEST_FILE


@pytest.mark.parametrize("name", PATCHES)
def test_no_patch_without_area_and_no_patch_twice(name):
    centres = []
    for item in mesh_objects(open_sample(name)):
        assert min(polygon.area for polygon in item.data.polygons) > 1e-6
        vertices = world_vertices(item)
        centres += [vertices[list(face)].mean(axis=0) for face in faces_of(item)]
    assert len(np.unique(np.round(centres, 5), axis=0)) == len(centres)


@pytest.mark.parametrize("name", PATCHES)
def test_solids_are_closed_and_face_outwards(name):
    for item in mesh_objects(open_sample(name)):
        if item.name.startswith("Room") or (name, item.name) == ("cornell_box", "Light"):
            continue
        for solid in separate(faces_of(item)):
            assert is_closed(solid), item.name
            assert signed_volume(world_vertices(item), solid) > 0.0, item.name


@pytest.mark.parametrize("name", PATCHES)
def test_rooms_face_inwards(name):
    rooms = [item for item in mesh_objects(open_sample(name)) if item.name.startswith("Room")]
    assert len(rooms) == (6 if name in MAZES else 1)
    for room in rooms:
        lower, upper = extents(world_vertices(room))
        for polygon in room.data.polygons:
            to_middle = (lower + upper) / 2 - np.array(room.matrix_world @ polygon.center)
            assert np.dot(np.array(polygon.normal), to_middle) > 0.0


@pytest.mark.parametrize("name", PATCHES)
def test_materials_have_the_listed_colours(name):
    scene = open_sample(name)
    for colour, reflectance in COLOURS[name].items():
        shader = shader_of(bpy.data.materials[colour])
        assert shader.bl_idname == "ShaderNodeBsdfDiffuse"
        np.testing.assert_allclose(shader.inputs["Color"].default_value[:3], reflectance, atol=6e-4)
    for item in mesh_objects(scene):
        assert all(material is not None for material in item.data.materials)
        used = {polygon.material_index for polygon in item.data.polygons}
        assert used == set(range(len(item.data.materials)))


@pytest.mark.parametrize("name", EMISSIONS)
def test_lights_shine_as_listed(name):
    open_sample(name)
    material, radiance = EMISSIONS[name]
    inputs = shader_of(bpy.data.materials[material]).inputs
    found = np.array(inputs["Emission Color"].default_value[:3]) * inputs["Emission Strength"].default_value
    np.testing.assert_allclose(found, radiance, atol=6e-4)


@pytest.mark.parametrize("unwrapper", Unwrapper)
@pytest.mark.parametrize("name", ["cornell_box", "light_near_wall", "room_1423", "infinite_5508"])
def test_no_face_is_mirrored_in_a_lightmap(name, unwrapper):
    """Whichever way a triangle turns in the mesh, seen from its front it turns the same way in the map."""
    meshes = [unwrap_mesh(item) for item in mesh_objects(open_sample(name))]
    atlas = unwrap(meshes, size=256, padding=4, unwrapper=unwrapper, check=lambda: None)
    for mesh, uv in zip(meshes, atlas.uv, strict=True):
        a, b, c = uv[mesh.triangle_corners].astype(float).transpose(1, 0, 2)
        assert (np.linalg.det(np.stack([b - a, c - a], 1)) > 0.0).all()


@pytest.mark.parametrize("name", PATCHES)
def test_scene_settings(name):
    scene = open_sample(name)
    assert scene.unit_settings.system == "METRIC"
    assert scene.unit_settings.scale_length == 1.0
    assert scene.render.engine == "CYCLES"
    assert not scene.cycles.use_denoising
    assert scene.camera is not None
    assert tuple(scene.world.color) == (0.0, 0.0, 0.0)
    assert scene.render.filepath == "//"


def test_cornell_blocks_have_the_published_corners():
    scene = open_sample("cornell_box")
    for name, foot, height in (("Short Block", SHORT_BLOCK, 165), ("Tall Block", TALL_BLOCK, 330)):
        vertices = world_vertices(scene.objects[name])
        for (x, z), y in itertools.product(foot, (0, height)):
            corner = np.array([-x, z, y]) * 0.001
            assert np.linalg.norm(vertices - corner, axis=1).min() < TIGHT
        lower, upper = extents(vertices)
        assert lower[2] == 0.0
        np.testing.assert_allclose(
            lower[:2], [-0.001 * max(x for x, _ in foot), 0.001 * min(z for _, z in foot)], atol=TIGHT
        )
        np.testing.assert_allclose(
            upper[:2], [-0.001 * min(x for x, _ in foot), 0.001 * max(z for _, z in foot)], atol=TIGHT
        )


def test_cornell_light_fills_the_hole_in_the_ceiling():
    scene = open_sample("cornell_box")
    light, room = scene.objects["Light"], scene.objects["Room"]
    lower, upper = extents(world_vertices(light))
    np.testing.assert_allclose(lower, [-0.343, 0.227, 0.5488], atol=TIGHT)
    np.testing.assert_allclose(upper, [-0.213, 0.332, 0.5488], atol=TIGHT)
    assert all(polygon.normal.z < -0.999 for polygon in light.data.polygons)
    ceiling = [polygon.area for polygon in room.data.polygons if polygon.normal.z < -0.99]
    assert sum(ceiling) + 0.130 * 0.105 == pytest.approx(0.556 * 0.5592, abs=1e-6)
    ring = {tuple(point) for point in np.round(world_vertices(room), 6)}
    assert sum(tuple(point) in ring for point in np.round(world_vertices(light), 6)) == 2 * (4 + 3)


def test_cornell_camera_is_the_published_one():
    camera = open_sample("cornell_box").camera
    np.testing.assert_allclose(camera.matrix_world.translation, [-0.278, -0.8, 0.273], atol=TIGHT)
    np.testing.assert_allclose(camera.matrix_world.col[2][:3], [0.0, -1.0, 0.0], atol=TIGHT)
    assert (camera.data.lens, camera.data.sensor_width) == (35.0, 25.0)


@pytest.mark.parametrize("name", ["light_near_wall"])
def test_closed_room_is_closed(name):
    room = open_sample(name).objects["Room"]
    assert is_closed(faces_of(room))
    assert signed_volume(world_vertices(room), faces_of(room)) == pytest.approx(-3.0 * 4.0 * 2.4, abs=1e-4)


@pytest.mark.parametrize("name", ROOMS)
def test_moving_cube_moves(name):
    scene = open_sample(name)
    cube = scene.objects["Moving Cube"]
    assert len(cube.data.polygons) == 150
    assert len(bpy.data.actions) == 1
    assert (scene.frame_start, scene.frame_end) == (1, 250)
    at_frame(scene, 1)
    start = np.array(cube.matrix_world.translation)
    at_frame(scene, 125)
    assert np.linalg.norm(np.array(cube.matrix_world.translation) - start) > 1.0
    at_frame(scene, 250)
    np.testing.assert_allclose(np.array(cube.matrix_world.translation), start, atol=TIGHT)


@pytest.mark.parametrize("name", ROOMS)
def test_moving_cube_never_touches_anything(name):
    scene = open_sample(name)
    cube, room = scene.objects["Moving Cube"], scene.objects["Room"]
    solids = []
    for item in mesh_objects(scene):
        if item not in (cube, room):
            vertices = world_vertices(item)
            solids += [extents(vertices[np.unique(solid)]) for solid in separate(faces_of(item))]
    assert len(solids) == 10
    inside = extents(world_vertices(room))
    nearest = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        at_frame(scene, frame)
        lower, upper = extents(world_vertices(cube))
        assert (lower > inside[0] + 0.05).all(), frame
        assert (upper < inside[1] - 0.05).all(), frame
        nearest.append(min(gap((lower, upper), solid) for solid in solids))
    assert min(nearest) > 0.05
    assert min(nearest) < 0.25  # it does pass close by


@pytest.mark.parametrize("name", ROOMS)
def test_red_and_yellow_cubes_stand_on_the_floor(name):
    scene = open_sample(name)
    for cube in ("Red Cube", "Yellow Cube"):
        lower, upper = extents(world_vertices(scene.objects[cube]))
        assert lower[2] == 0.0
        np.testing.assert_allclose(upper - lower, 0.6, atol=TIGHT)


@pytest.mark.parametrize("name", MAZES)
def test_maze_rooms_are_joined_by_openings_only_where_rooms_meet(name):
    scene = open_sample(name)
    graph = bpy.context.evaluated_depsgraph_get()
    middles = {}
    for room in mesh_objects(scene):
        lower, upper = extents(world_vertices(room))
        np.testing.assert_allclose(upper - lower, 2.0, atol=TIGHT)
        middles[tuple(np.round((lower + upper) / 2).astype(int))] = room
    joints = 0
    for middle, room in middles.items():
        for axis, sign in itertools.product(range(3), (-1.0, 1.0)):
            direction = np.zeros(3)
            direction[axis] = sign
            joined = tuple((np.array(middle) + 2 * direction).astype(int)) in middles
            hit, place, _, _, seen, _ = scene.ray_cast(graph, middle, direction)
            distance = np.linalg.norm(np.array(place) - middle)
            if joined:
                joints += 1
                assert not hit or distance > 2.0
            else:
                assert hit
                assert seen.name == room.name
                assert distance == pytest.approx(1.0, abs=1e-5)
    assert joints == 2 * 5  # six rooms, a tree: five openings, seen from both sides


def test_divisions_that_cannot_be_reached_are_refused():
    import meshing

    boxes = [meshing.box(name, (0, 0, 0), (1, 1, 1), "White") for name in "ab"]
    assert sum(body.patch_count() for body in meshing.choose_divisions(boxes, 48)) == 48
    with pytest.raises(ValueError, match="exactly 49"):
        meshing.choose_divisions(boxes, 49)
