"""Lightmaps of light know materials texel by texel: textures and colours that vary over a face."""

import bpy
import numpy as np
import pytest

from tests.blender.helpers import ROUNDING, sheet
from tests.blender.jobs.test_lightmap_bake import arrays_of, finished, texels_of
from tests.blender.materials.material_helpers import Tree
from tests.blender.reading.light_helpers import lamp

pytestmark = pytest.mark.usefixtures("empty_scene")

SUN = 2.0  # W/m^2, from straight above


def places(running):
    """World positions (n, 3) of the texels of a job's first page, and their radiance over that of white, (n, 3)."""
    texels, values = texels_of(running)[0]
    corners = arrays_of(running).patches.corners.reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    position = texels.positions(np.arange(len(texels))) * 0.5 * np.linalg.norm(high - low) + 0.5 * (low + high)
    whole = texels.cover > 1.0 - 1e-6
    return position[whole], values[whole] / (SUN / np.pi)


def ramp(ob, domain):
    """A colour attribute that is x in red and y in green, at corners or vertices."""
    attribute = ob.data.color_attributes.new("Ramp", "FLOAT_COLOR", domain)
    where = {"POINT": range(len(ob.data.vertices)), "CORNER": [loop.vertex_index for loop in ob.data.loops]}[domain]
    for value, vertex in zip(attribute.data, where, strict=True):
        x, y, _ = ob.data.vertices[vertex].co
        value.color = (x, y, 0.25, 1.0)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_color_attributes_are_looked_up_at_each_texel(domain, mirrored):
    """One quad with a ramp over it: the light of a texel is that of its place, exactly, also on a mirrored object."""
    lamp("SUN", (0.3, 0.3, 3.0), energy=SUN)
    ob = sheet("Sheet", (0.1, 0.1, 0), (0.8, 0, 0), (0, 0.6, 0))
    ramp(ob, domain)
    tree = Tree()
    node = tree.node("ShaderNodeVertexColor", layer_name="Ramp")
    tree.diffuse(node.outputs["Color"])
    ob.data.materials.append(tree.material)
    if mirrored:
        ob.scale.x = -1.0
    position, found = places(finished(ob, quantity="DIRECT"))
    expected = np.stack([np.abs(position[:, 0]), position[:, 1], np.full(len(position), 0.25)], -1)
    assert len(position) > 1000
    np.testing.assert_allclose(found, expected, rtol=0, atol=100 * ROUNDING)


def test_textures_are_looked_up_at_each_texel():
    """Two colours side by side in an image: each texel beside the border has one of them, beside another object."""
    lamp("SUN", (0.3, 0.3, 3.0), energy=SUN)
    ob, plain = sheet("Sheet", (0, 0, 0), (1, 0, 0), (0, 1, 0)), sheet("Plain", (3, 0, 0), (1, 0, 0), (0, 1, 0))
    ob.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]))
    image = bpy.data.images.new("Halves", 64, 64, float_buffer=True)
    pixels = np.ones((64, 64, 4), np.float32)
    pixels[:, :32, :3], pixels[:, 32:, :3] = (0.75, 0.0, 0.0), (0.0, 0.5, 0.0)
    image.pixels.foreach_set(pixels.ravel())
    tree = Tree()
    tree.diffuse(tree.image(image).outputs["Color"])
    ob.data.materials.append(tree.material)
    other = Tree("Plain")
    other.diffuse(color=(0.1, 0.2, 0.3))
    plain.data.materials.append(other.material)
    position, found = places(finished(ob, plain, quantity="DIRECT"))
    x = position[:, 0]  # the image repeats, so that its ends mix as its middle does
    left, right = np.abs(x - 0.25) < 0.25 - 1 / 32, np.abs(x - 0.75) < 0.25 - 1 / 32
    assert left.sum() > 1000
    np.testing.assert_allclose(found[left], np.tile((0.75, 0.0, 0.0), (left.sum(), 1)), rtol=0, atol=100 * ROUNDING)
    np.testing.assert_allclose(found[right], np.tile((0.0, 0.5, 0.0), (right.sum(), 1)), rtol=0, atol=100 * ROUNDING)
    beyond = position[:, 0] > 2.0
    np.testing.assert_allclose(found[beyond], np.tile((0.1, 0.2, 0.3), (beyond.sum(), 1)), rtol=1e-4)
