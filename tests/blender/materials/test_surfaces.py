"""Many faces and materials of one mesh, its colour attributes, evaluated meshes, threads."""

import threading
import tracemalloc

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.materials.snapshot import snapshot_material
from obscurance_addon.blender.materials.surfaces import read_surface
from obscurance_addon.core.notes import Notes
from obscurance_addon.core.shading.expressions import Constant
from obscurance_addon.core.shading.shading import DEFAULT_REFLECTANCE, Shading, shade_faces
from obscurance_addon.core.shading.surfaces import NO_TRIANGLES
from tests.blender.materials.material_helpers import (
    BLUE,
    COLOR,
    GREEN,
    RED,
    WHITE,
    Tree,
    close,
    make_image,
    out_of,
    painted,
    put_color,
    quads,
    quarters,
    reflectance_of,
    shade,
)

pytestmark = pytest.mark.usefixtures("empty_scene")

# Four corners, of which the quad's mean is (0.3, 0.5, 0.1).
CORNER_COLORS = np.array([(0.0, 0.5, 0.1), (0.2, 0.5, 0.1), (0.4, 0.5, 0.1), (0.6, 0.5, 0.1)], np.float32)


def test_each_face_gets_its_material():
    slots = [Tree().diffuse(color=RED), None, Tree().diffuse(color=BLUE)]
    mesh = quads(*[(0, 0, 1, 1)] * 4, uv_name="")
    reflectance, _ = shade(slots, mesh, np.array([2, 0, 1, 2], np.int32))
    close(reflectance, [BLUE, RED, (DEFAULT_REFLECTANCE,) * 3, BLUE])


def test_constant_and_textured_materials_side_by_side():
    textured = Tree()
    textured.diffuse(textured.image(quarters(byte=False), interpolation="Closest").outputs[0])
    boxes = [(0, 0, 0.5, 0.5), (0.5, 0, 1, 0.5), (0, 0.5, 0.5, 1), (0.5, 0.5, 1, 1)]
    slots = [textured, Tree().diffuse(), textured]
    reflectance, _ = shade(slots, quads(*boxes), np.array([0, 2, 1, 0], np.int64))
    close(reflectance, [RED, GREEN, COLOR, WHITE])


def test_unknown_material_index_raises():
    with pytest.raises(IndexError):
        shade_faces([Shading()], np.array([1]), NO_TRIANGLES)


def test_a_million_constant_faces_need_no_memory_but_the_result():
    n = 1_000_000
    shadings = [Shading(Constant(COLOR), Constant((1.0,))), Shading()] * 8
    faces = np.arange(n, dtype=np.int32) % 16
    tracemalloc.start()
    reflectance, emission, _ = shade_faces(shadings, faces, NO_TRIANGLES)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # numpy widens the indexes to 8 bytes for each of its two lookups, one after the other.
    assert peak < reflectance.nbytes + emission.nbytes + 8 * n + 100_000
    close(reflectance[:2], [COLOR, (0, 0, 0)])
    close(emission[:2], [(np.pi,) * 3, (0, 0, 0)])


def test_constant_materials_read_no_mesh_data():
    shading = snapshot_material(Tree().diffuse().material, Notes())
    assert not shading.varies()
    assert shading.uv_maps() == shading.color_attributes() == set()
    mesh = quads((0, 0, 1, 1), (0, 0, 1, 1))
    mesh.calc_loop_triangles()
    surface = read_surface(mesh, [shading])
    assert len(surface.triangle_face) == 0


def test_works_in_a_thread_without_blender():
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False), interpolation="Closest").outputs[0])
    mesh = quads((0, 0, 0.5, 0.5))
    mesh.calc_loop_triangles()
    shading = snapshot_material(tree.material, Notes())
    surface = read_surface(mesh, [shading])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    results = []
    thread = threading.Thread(target=lambda: results.append(shade_faces([shading], np.zeros(1, np.int32), surface)))
    thread.start()
    thread.join()
    close(results[0][0], RED)


@pytest.mark.parametrize("data_type", ["FLOAT_COLOR", "BYTE_COLOR"])
@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_colors_of_points_and_corners_average_over_the_face(domain, data_type):
    mesh = quads((0, 0, 1, 1), uv_name="")
    put_color(mesh, "Paint", CORNER_COLORS, domain, data_type)
    mesh.calc_loop_triangles()
    triangles = np.array([triangle.loops for triangle in mesh.loop_triangles])
    exact = CORNER_COLORS[triangles].mean(axis=(0, 1))
    # 8-bit storage is within 0.0045 of what is written.
    tolerance = 1e-6 if data_type == "FLOAT_COLOR" else 4.5e-3
    for tree in (
        painted(layer_name="Paint"),
        painted(layer_name=""),
        painted("ShaderNodeAttribute", attribute_name="Paint"),
        painted("ShaderNodeAttribute", "Vector", attribute_name="Paint"),
    ):
        close(reflectance_of(tree, mesh), exact, tolerance)


@pytest.mark.parametrize("data_type", ["FLOAT_COLOR", "BYTE_COLOR"])
def test_colors_of_faces(data_type):
    mesh = quads(*[(0, 0, 1, 1)] * 3, uv_name="")
    put_color(mesh, "Paint", [RED, GREEN, BLUE], "FACE", data_type)
    tolerance = 1e-6 if data_type == "FLOAT_COLOR" else 4.5e-3
    close(reflectance_of(painted(layer_name="Paint"), mesh), [RED, GREEN, BLUE], tolerance)
    close(reflectance_of(painted(layer_name=""), mesh), [RED, GREEN, BLUE], tolerance)


def test_empty_layer_name_is_the_default_color():
    mesh = quads((0, 0, 1, 1), uv_name="")
    put_color(mesh, "First", [RED] * 4, "CORNER")
    put_color(mesh, "Second", [BLUE] * 4, "CORNER")
    for name, color in (("First", RED), ("Second", BLUE)):
        mesh.attributes.default_color_name = name
        close(reflectance_of(painted(layer_name=""), mesh), color)


def test_missing_attributes_are_black():
    mesh = quads((0, 0, 1, 1), uv_name="")
    close(reflectance_of(painted(layer_name=""), mesh), 0.0)
    close(reflectance_of(painted("ShaderNodeAttribute", attribute_name="nothing"), mesh), 0.0)
    close(reflectance_of(painted("ShaderNodeAttribute", attribute_name=""), mesh), 0.0)


def test_attribute_factor_is_the_mean_of_its_channels():
    mesh = quads((0, 0, 1, 1), uv_name="")
    put_color(mesh, "Paint", [(0.2, 0.4, 0.9)], "FACE")
    tree = Tree()
    node = tree.node("ShaderNodeAttribute", attribute_name="Paint")
    tree.diffuse(out_of(node, "Fac"))
    close(reflectance_of(tree, mesh), 0.5)


def test_number_attributes_are_grey():
    mesh = quads(*[(0, 0, 1, 1)] * 2, uv_name="")
    mesh.attributes.new("level", "FLOAT", "FACE").data.foreach_set("value", np.array([0.25, 0.5], np.float32))
    close(reflectance_of(painted("ShaderNodeAttribute", attribute_name="level"), mesh), [[0.25] * 3, [0.5] * 3])


def test_attribute_of_the_object_is_noted():
    tree, notes = Tree("Wall"), []
    tree.diffuse(tree.node("ShaderNodeAttribute", attribute_type="OBJECT", attribute_name="color").outputs["Color"])
    close(reflectance_of(tree, quads((0, 0, 1, 1)), notes), COLOR)
    assert len(notes) == 1


def test_names_needed_from_the_mesh():
    tree = Tree()
    image = tree.image(quarters())
    tree.link(tree.node("ShaderNodeUVMap", uv_map="Second").outputs[0], image.inputs[0])
    factor = tree.image(quarters()).outputs["Alpha"]
    paint = tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs[0]
    mix = tree.node("ShaderNodeMixRGB", {"Fac": factor, "Color1": image.outputs[0], "Color2": paint})
    tree.diffuse(mix.outputs[0])
    shading = snapshot_material(tree.material, Notes())
    assert shading.varies()
    assert shading.uv_maps() == {"", "Second"}
    assert shading.color_attributes() == {"Paint"}


def test_products_are_taken_before_the_mean():
    """Texture and paint both vary over the face, together: mean(a * a) is not mean(a) * mean(a)."""
    mesh = quads((0, 0, 1, 1))
    put_color(mesh, "Paint", [(0, 0, 0), (0.9, 0.9, 0.9), (0.9, 0.9, 0.9), (0, 0, 0)], "CORNER")
    rows = np.zeros((8, 8, 3), np.float32)
    rows[:, 4:] = 0.8
    tree = Tree()
    image = tree.image(make_image(rows, byte=False), interpolation="Closest").outputs[0]
    paint = tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs[0]
    mix = {"Fac": 1.0, "Color1": image, "Color2": paint}
    tree.diffuse(tree.node("ShaderNodeMixRGB", mix, blend_type="MULTIPLY").outputs[0])
    # The right half: 0.8 times a ramp of 0.45 .. 0.9, over half of the face; parts straddle its edge.
    close(reflectance_of(tree, mesh), 0.8 * 0.675 / 2, 3e-3)


def test_evaluated_material_and_mesh():
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False), interpolation="Closest").outputs[0])
    mesh = quads((0, 0, 0.5, 0.5), (0.5, 0.5, 1, 1))
    mesh.materials.append(tree.material)
    ob = bpy.data.objects.new("quads", mesh)
    bpy.context.scene.collection.objects.link(ob)
    ob.modifiers.new("smooth", "SUBSURF").subdivision_type = "SIMPLE"
    evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get())
    result = evaluated.to_mesh()
    material = evaluated.material_slots[0].material
    assert material.is_evaluated
    reflectance = reflectance_of(material, result)
    assert len(reflectance) == 8
    close(reflectance, np.repeat([RED, WHITE], 4, axis=0))
    evaluated.to_mesh_clear()


def test_mesh_without_faces():
    tree = Tree()
    tree.diffuse(tree.image(quarters()).outputs[0])
    mesh = bpy.data.meshes.new("empty")
    mesh.uv_layers.new(name="UVMap")
    reflectance, emission = shade(tree, mesh)
    assert reflectance.shape == emission.shape == (0, 3)
