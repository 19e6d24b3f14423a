"""Image textures: pixels, colour spaces, alpha, and means over faces of all sizes."""

import itertools

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.materials.textures import ImageCache
from obscurance_addon.core.shading import means
from obscurance_addon.core.shading.arithmetic import srgb_to_linear
from obscurance_addon.core.shading.points import part_centres
from obscurance_addon.core.shading.pyramid import Pyramid
from tests.blender.materials.material_helpers import (
    BLUE,
    COLOR,
    GREEN,
    RED,
    WHITE,
    Tree,
    close,
    make_image,
    quads,
    quarters,
    reflectance_of,
    shade,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize("byte", [False, True])
@pytest.mark.parametrize("side", [8, 6, 256])
def test_known_parts_of_an_image(byte, side):
    tree = Tree()
    tree.diffuse(tree.image(quarters(side, byte=byte), interpolation="Closest").outputs[0])
    boxes = [(0, 0, 0.5, 0.5), (0, 0, 1, 0.5), (0, 0, 0.5, 1), (0, 0, 1, 1), (0.5, 0.25, 1, 0.75)]
    stored = np.array([RED, GREEN, BLUE, WHITE], np.float32)
    red, green, blue, white = srgb_to_linear(np.round(stored * 255) / np.float32(255)) if byte else stored
    expected = [
        red,
        (red + green) / 2,
        (red + blue) / 2,
        (red + green + blue + white) / 4,
        (green + white) / 2,
    ]
    # The side of 6 has its middle between two parts of the triangle: up to one part in 64 falls on the wrong side.
    close(reflectance_of(tree, quads(*boxes)), expected, 5e-6 if side == 8 else 8e-3)


def test_srgb_decoding_is_the_standard_curve():
    close(srgb_to_linear(np.array([0.0, 0.04045, 0.5, 1.0])), [0.0, 0.0031308, 0.2140411, 1.0])


@pytest.mark.parametrize(
    ("byte", "space", "expected"),
    [
        (True, "sRGB", 0.21586),
        (True, "Non-Color", 128 / 255),
        (True, "Linear Rec.709", 128 / 255),
        (False, "Linear Rec.709", 0.5),
        (False, "Non-Color", 0.5),
        # Float images are linear in memory whatever their colour space says: Cycles renders 0.5 too.
        (False, "sRGB", 0.5),
    ],
)
def test_color_spaces(byte, space, expected):
    tree, notes = Tree(), []
    tree.diffuse(tree.image(make_image(np.full((4, 4, 3), 0.5), byte=byte, space=space)).outputs[0])
    close(reflectance_of(tree, quads((0, 0, 1, 1)), notes), expected, 1e-5)
    assert notes == []


def test_unusual_color_space_is_noted():
    tree, notes = Tree(), []
    image = make_image(np.full((4, 4, 3), 0.5), space="Filmic Log", name="logo")
    tree.diffuse(tree.image(image).outputs[0])
    close(reflectance_of(tree, quads((0, 0, 1, 1)), notes), 0.21586, 1e-5)
    assert len(notes) == 1
    assert "Filmic Log" in notes[0]
    assert "logo" in notes[0]


@pytest.mark.parametrize(
    ("byte", "mode", "alpha_used", "expected"),
    [
        # Each as rendered by Cycles: byte images are straight in memory, float images have alpha in their colour.
        (True, "STRAIGHT", False, srgb_to_linear(np.float32(64 / 255))),
        (True, "STRAIGHT", True, srgb_to_linear(np.float32(128 / 255))),
        (True, "CHANNEL_PACKED", False, srgb_to_linear(np.float32(128 / 255))),
        (True, "NONE", False, srgb_to_linear(np.float32(128 / 255))),
        (False, "STRAIGHT", False, 0.4),
        (False, "STRAIGHT", True, 0.8),
        (False, "CHANNEL_PACKED", True, 0.4),
    ],
)
def test_alpha_in_the_color(byte, mode, alpha_used, expected):
    value = 0.5 if byte else 0.4
    image = make_image(np.full((4, 4, 4), (value, value, value, 0.5)), byte=byte)
    image.alpha_mode = mode
    tree = Tree()
    node = tree.image(image)
    tree.diffuse(node.outputs["Color"])
    if alpha_used:
        tree.node("ShaderNodeMath", {"Value": node.outputs["Alpha"]})
    close(reflectance_of(tree, quads((0, 0, 1, 1))), expected, 2e-3)


def test_alpha_output_drives_numbers():
    rows = np.full((8, 8, 4), 0.5, np.float32)
    rows[:, :4, 3] = 0.25
    rows[:, 4:, 3] = 0.75
    tree = Tree()
    node = tree.image(make_image(rows, byte=False), interpolation="Closest")
    tree.link(node.outputs["Alpha"], tree.principled().inputs["Alpha"])
    mesh = quads((0, 0, 0.5, 1), (0.5, 0, 1, 1), (0, 0, 1, 1))
    close(reflectance_of(tree, mesh), np.outer([0.25, 0.75, 0.5], COLOR))


def test_color_becomes_number_by_luminance():
    tree = Tree()
    color = tree.image(make_image(np.full((2, 2, 3), (0.1, 0.2, 0.3)), byte=False)).outputs[0]
    tree.link(color, tree.principled().inputs["Transmission Weight"])
    metallic = 0.2126 * 0.1 + 0.7152 * 0.2 + 0.0722 * 0.3
    close(reflectance_of(tree, quads((0, 0, 1, 1))), np.multiply(COLOR, 1 - metallic))


@pytest.mark.parametrize("size", [(64, 64), (50, 31), (1, 7), (33, 1), (1, 1), (1024, 512)])
def test_large_faces_weigh_all_their_texels(size):
    """Random texels have no structure that could hide an error: the mean of the whole image, to sampling precision."""
    rows = np.random.default_rng(7).random((size[1], size[0], 3)).astype(np.float32) * 0.9
    tree = Tree()
    tree.diffuse(tree.image(make_image(rows, byte=False)).outputs[0])
    mean = rows.mean(axis=(0, 1))
    # Stratified, filtered looks miss by less than the standard error of as many independent ones.
    looks = min(size[0] * size[1], 2 * 4096)
    tolerance = rows.std() / np.sqrt(looks) + 1e-6
    close(reflectance_of(tree, quads((0, 0, 1, 1))), mean, tolerance)
    close(reflectance_of(tree, quads((0, 0, 40, 40))), mean, tolerance)


def test_faces_of_all_sizes_against_dense_sampling():
    """Bilinear lookups on a fine grid are the truth that Cycles would render; triangles with tilted UVs."""
    rng = np.random.default_rng(3)
    rows = rng.random((32, 48, 3)).astype(np.float32) * 0.9
    tree = Tree()
    tree.diffuse(tree.image(make_image(rows, byte=False)).outputs[0])
    sizes = np.array([0.002, 0.01, 0.05, 0.2, 0.5, 1.0])
    uv = (rng.random((len(sizes), 3, 2)) * sizes[:, None, None] + 0.1).astype(np.float32)
    mesh = bpy.data.meshes.new("triangles")
    mesh.from_pydata(rng.random((len(sizes) * 3, 3)).tolist(), [], np.arange(len(sizes) * 3).reshape(-1, 3).tolist())
    mesh.uv_layers.new(name="UVMap")
    mesh.uv_layers["UVMap"].uv.foreach_set("vector", uv.ravel())
    points = np.matmul(part_centres(200), uv)
    x = np.mod(points, 1.0) * (48, 32) - 0.5
    low = np.floor(x).astype(int)
    truth = 0.0
    for dx, dy in itertools.product((0, 1), (0, 1)):
        weight = np.abs(1 - dx - (x - low)[..., 0]) * np.abs(1 - dy - (x - low)[..., 1])
        truth += weight[..., None] * rows[(low[..., 1] + dy) % 32, (low[..., 0] + dx) % 48]
    close(reflectance_of(tree, mesh), truth.mean(axis=1), 4e-3)


def test_face_smaller_than_a_texel_shows_that_texel():
    tree = Tree()
    tree.diffuse(tree.image(quarters(4, byte=False)).outputs[0])
    centres = np.array([[1 / 8, 1 / 8], [7 / 8, 1 / 8], [1 / 8, 7 / 8], [7 / 8, 7 / 8]])
    boxes = [(u - 0.001, v - 0.001, u + 0.001, v + 0.001) for u, v in centres]
    # Half a texel from the next colour's centre a bilinear lookup still mixes 0.4 % of the neighbouring texel.
    close(reflectance_of(tree, quads(*boxes)), [RED, GREEN, BLUE, WHITE], 6e-3)
    tree.tree.nodes["Image Texture"].interpolation = "Closest"
    close(reflectance_of(tree, quads(*boxes)), [RED, GREEN, BLUE, WHITE])


def test_faces_without_uv_area_show_one_point():
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False)).outputs[0])
    close(reflectance_of(tree, quads((0.25, 0.25, 0.25, 0.25), (0.75, 0.1, 0.75, 0.4))), [RED, GREEN], 1e-6)


def test_triangles_of_a_face_weigh_by_their_area():
    """A quad of 3 + 1 area units, one triangle of it red and the other green."""
    mesh = bpy.data.meshes.new("kite")
    mesh.from_pydata([(0, 0, 0), (1, -3, 0), (2, 0, 0), (1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap")
    mesh.calc_loop_triangles()
    corners = {tuple(sorted(triangle.vertices)) for triangle in mesh.loop_triangles}
    if corners != {(0, 1, 2), (0, 2, 3)}:
        pytest.skip("Blender cut the kite along its other diagonal")
    uv = np.array([(0.5, 0.25), (0.25, 0.25), (0.5, 0.25), (0.75, 0.25)], np.float32)
    mesh.uv_layers["UVMap"].uv.foreach_set("vector", uv.ravel())
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False), interpolation="Closest").outputs[0])
    close(reflectance_of(tree, mesh), np.array(RED) * 0.75 + np.array(GREEN) * 0.25)


def test_polygon_without_area_keeps_its_texture():
    mesh = bpy.data.meshes.new("line")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [], [(0, 1, 2)])
    mesh.uv_layers.new(name="UVMap")
    mesh.uv_layers["UVMap"].uv.foreach_set("vector", np.full(6, 0.25, np.float32))
    tree = Tree()
    tree.diffuse(tree.image(quarters(byte=False)).outputs[0])
    close(reflectance_of(tree, mesh), RED)


@pytest.mark.parametrize("case", ["none", "file"])
def test_missing_image_keeps_the_socket_color_with_a_note(case):
    image = None
    if case == "file":
        image = bpy.data.images.new("lost", 4, 4)
        image.source = "FILE"
        image.filepath = "/nowhere/lost.png"
    tree, notes = Tree("Wall"), []
    tree.diffuse(tree.image(image).outputs[0])
    close(reflectance_of(tree, quads((0, 0, 1, 1)), notes), COLOR)
    assert len(notes) == 1
    assert all(word in notes[0] for word in (("missing", "'lost'") if image else ("has no image", "'Wall'")))


def test_tiled_images():
    image = bpy.data.images.new("tiles", 4, 4, tiled=True, float_buffer=True)
    image.pixels.foreach_set(np.tile(np.array([*COLOR, 1], np.float32), 16))
    tree, notes = Tree(), []
    tree.diffuse(tree.image(image).outputs[0])
    close(reflectance_of(tree, quads((0, 0, 1, 1)), notes), COLOR)
    assert notes == []
    image.tiles.new(1002)
    close(reflectance_of(tree, quads((1, 0, 2, 1)), notes), COLOR)
    assert len(notes) == 1
    assert "'tiles'" in notes[0]


def test_images_are_read_once_and_left_alone():
    image = quarters()
    image.pack()
    assert not image.is_dirty
    before = np.array(image.pixels[:], np.float32)
    trees = [Tree(), Tree()]
    for tree in trees:
        tree.diffuse(tree.image(image).outputs[0])
    images = ImageCache()
    mesh = quads((0, 0, 1, 1))
    first, _ = shade(trees[0], mesh, images=images)
    texture = images.texture(image, False)
    second, _ = shade(trees[1], mesh, images=images)
    assert len(images) == 1
    assert images.texture(image, False) is texture
    np.testing.assert_array_equal(first, second)
    assert not image.is_dirty
    np.testing.assert_array_equal(before, image.pixels[:])


@pytest.mark.parametrize("size", [(5, 7), (12, 1), (640, 3), (2500, 40)])
def test_pyramid_levels_keep_the_mean(size):
    rows = np.random.default_rng(1).random((size[1], size[0], 4)).astype(np.float32)
    pyramid = Pyramid.of(rows)
    assert pyramid.width.max() <= 2048
    assert (pyramid.width[-1], pyramid.height[-1]) == (1, 1)
    for start, width, height in zip(pyramid.start, pyramid.width, pyramid.height, strict=True):
        level = pyramid.texels[start : start + width * height]
        close(level.mean(axis=0, dtype=np.float64), rows.mean(axis=(0, 1), dtype=np.float64), 2e-6)


@pytest.mark.parametrize("parts", [1, 2, 4, 64])
def test_parts_of_a_triangle_are_stratified_and_centred(parts):
    centres = part_centres(parts).astype(np.float64)
    assert (centres > 0).all()
    assert len(np.unique(centres.round(5), axis=0)) == parts * parts
    close(centres.sum(axis=1), 1.0)
    close(centres.mean(axis=0), 1 / 3)
    # Second moments of a uniform triangle are 1/6 and 1/12; cut into parts they approach them as 1/parts^2.
    close((centres**2).mean(axis=0), 1 / 6, 0.06 / parts**2)


def test_many_textured_faces_stay_within_their_budget(monkeypatch):
    """Faces that want more points than there are to spend get fewer, and still their own colours."""
    monkeypatch.setattr(means, "POINT_BUDGET", 3000)
    tree = Tree()
    tree.diffuse(tree.image(quarters(256, byte=False)).outputs[0])
    boxes = [(0, 0, 0.5, 0.5), (0.5, 0, 1, 0.5), (0, 0.5, 0.5, 1), (0.5, 0.5, 1, 1)] * 40
    # 320 triangles get 3 x 3 points at most, cut to 2 x 2: each point is 32 texels wide.
    close(reflectance_of(tree, quads(*boxes)), np.array([RED, GREEN, BLUE, WHITE] * 40), 0.08)
