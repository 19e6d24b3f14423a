"""Texture coordinates: UV maps, Mapping nodes, what lies beyond the image."""

import numpy as np
import pytest

from obscurance_addon.blender.materials.snapshot import snapshot_material
from obscurance_addon.core.notes import Notes
from tests.blender.materials.material_helpers import (
    BLUE,
    GREEN,
    RED,
    WHITE,
    Tree,
    close,
    make_image,
    put_uv,
    quads,
    quarters,
    reflectance_of,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize(
    ("extension", "expected"),
    [
        # Boxes: the second copy to the right, its left half, the copy to the left of the origin's left half.
        ("REPEAT", [(0.5, 0.25), (1.0, 0.0), (0.0, 0.5)]),
        ("MIRROR", [(0.5, 0.25), (0.0, 0.5), (1.0, 0.0)]),
        ("EXTEND", [(0.0, 0.5), (0.0, 0.5), (1.0, 0.0)]),
        ("CLIP", [(0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]),
    ],
)
def test_extensions(extension, expected):
    rows = np.zeros((8, 8, 3), np.float32)
    rows[:, :4, 0], rows[:, 4:, 1] = 0.9, 0.45
    tree = Tree()
    tree.diffuse(tree.image(make_image(rows, byte=False), extension=extension, interpolation="Closest").outputs[0])
    reflectance = reflectance_of(tree, quads((1, 0, 2, 1), (1, 0, 1.5, 1), (-0.5, 0, 0, 1)))
    close(reflectance, [(0.9 * red, 0.9 * green, 0.0) for red, green in expected])


def test_clipped_image_covers_its_part_of_the_face():
    tree = Tree()
    image = make_image(np.full((8, 8, 3), 0.8), byte=False)
    tree.diffuse(tree.image(image, extension="CLIP", interpolation="Closest").outputs[0])
    close(reflectance_of(tree, quads((0.5, 0, 1.5, 1), (0, 0, 2, 2))), [[0.4] * 3, [0.2] * 3])


def test_named_and_active_uv_maps():
    mesh = quads((0, 0, 0.5, 0.5))
    put_uv(mesh, "Second", [(0.5, 0.5, 1, 1)])
    put_uv(mesh, "Third", [(0, 0.5, 0.5, 1)])
    image = quarters(byte=False)

    def looked_up(kind, output=0, **properties):
        tree = Tree()
        node = tree.image(image, interpolation="Closest")
        if kind:
            tree.link(tree.node(kind, **properties).outputs[output], node.inputs[0])
        return reflectance_of(tree.diffuse(node.outputs[0]), mesh)

    close(looked_up("ShaderNodeUVMap", uv_map="Second"), WHITE)
    close(looked_up("ShaderNodeAttribute", "Vector", attribute_name="Third"), BLUE)
    for kind, output in ((None, 0), ("ShaderNodeUVMap", 0), ("ShaderNodeTexCoord", "UV")):
        mesh.uv_layers["UVMap"].active_render = True
        close(looked_up(kind, output), RED)
        mesh.uv_layers["Second"].active_render = True
        close(looked_up(kind, output), WHITE)


def test_mesh_without_the_uv_map_takes_the_mean_of_the_image():
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False)).outputs[0])
    mean = np.mean([RED, GREEN, BLUE, WHITE], axis=0)
    close(reflectance_of(tree, quads((0, 0, 0.5, 0.5), uv_name="")), mean)
    tree.link(tree.node("ShaderNodeUVMap", uv_map="Elsewhere").outputs[0], tree.tree.nodes["Image Texture"].inputs[0])
    close(reflectance_of(tree, quads((0, 0, 0.5, 0.5))), mean)


@pytest.mark.parametrize(
    ("kind", "values", "uv"),
    [
        # Where the corner (1, 0) of the UV square goes, worked out by hand; all boxes are a quarter of the image wide.
        ("POINT", {"Scale": (0.25, 0.25, 1), "Location": (0.5, 0.5, 0)}, (0.5, 0.5, 0.75, 0.75)),
        ("POINT", {"Scale": (0.25, 0.25, 1), "Rotation": (0, 0, np.pi / 2)}, (-0.25, 0, 0, 0.25)),
        ("POINT", {"Scale": (0.25, -0.25, 1), "Location": (0.75, 0, 0)}, (0.75, -0.25, 1, 0)),
        ("VECTOR", {"Scale": (0.25, 0.25, 1), "Rotation": (0, 0, np.pi)}, (-0.25, -0.25, 0, 0)),
        ("TEXTURE", {"Scale": (4, 4, 1), "Location": (-2, -2, 0)}, (0.5, 0.5, 0.75, 0.75)),
    ],
)
def test_mapping_node(kind, values, uv):
    image = quarters(byte=False)
    tree = Tree()
    node = tree.image(image, interpolation="Closest")
    mapping = tree.node("ShaderNodeMapping", {"Vector": tree.node("ShaderNodeTexCoord").outputs["UV"], **values})
    mapping.vector_type = kind
    tree.link(mapping.outputs[0], node.inputs[0])
    plain = Tree()
    plain.diffuse(plain.image(image, interpolation="Closest").outputs[0])
    mapped = reflectance_of(tree.diffuse(node.outputs[0]), quads((0, 0, 1, 1)))
    close(mapped, reflectance_of(plain, quads(uv)), 1e-5)


def test_mapping_rotates_about_x_then_y_then_z():
    """Where Cycles puts three of the pixels of an 8 x 8 picture of the UV square (rendered, noise below 3e-3)."""
    tree = Tree()
    image = tree.image(quarters(byte=False))
    values = {"Location": (0.25, 0.1, 0), "Rotation": (0.3, 0.2, 0.5), "Scale": (0.5, 0.4, 1.5)}
    mapping = tree.node("ShaderNodeMapping", {"Vector": tree.node("ShaderNodeTexCoord").outputs["UV"], **values})
    tree.link(mapping.outputs[0], image.inputs[0])
    tree.diffuse(image.outputs[0])
    matrices = {}
    for kind in ("POINT", "TEXTURE"):
        mapping.vector_type = kind
        matrices[kind] = snapshot_material(tree.material, Notes()).reflectance.projection.matrix
    centres = np.array([(1, 1, 16), (1, 15, 16), (15, 1, 16)]) / 16
    close(centres @ matrices["POINT"].T, [(0.2665, 0.1361), (0.1244, 0.4396), (0.6433, 0.3422)], 1e-3)
    close(centres @ matrices["TEXTURE"].T, [(-0.3599, 0.1089), (0.4641, 2.0052), (1.1489, -0.7816)], 3e-3)


def test_other_coordinates_take_the_mean_with_a_note():
    tree, notes = Tree("Wall"), []
    node = tree.image(quarters(byte=False, name="bricks"))
    tree.link(tree.node("ShaderNodeTexCoord").outputs["Generated"], node.inputs[0])
    tree.diffuse(node.outputs[0])
    mean = np.mean([RED, GREEN, BLUE, WHITE], axis=0)
    close(reflectance_of(tree, quads((0, 0, 0.5, 0.5)), notes), mean)
    assert len(notes) == 1
    assert all(word in notes[0] for word in ("Generated", "not a UV map", "'bricks'"))
