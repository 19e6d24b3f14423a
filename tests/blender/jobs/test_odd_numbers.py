"""Numbers that are none, infinite or huge: no warning of numpy, finite results, and a note or an error by name."""

import bpy
import numpy as np
import pytest

from obscurance_addon.core.errors import ObscuranceError
from tests.blender.helpers import bake, colors, cube, floor, material, notes_about

pytestmark = [pytest.mark.usefixtures("empty_scene"), pytest.mark.filterwarnings("error::RuntimeWarning")]
NAN, INF, HUGE = float("nan"), float("inf"), 3e38
ODD = [NAN, INF, -INF, 1e30, HUGE]


def displace(ob, value, whole):
    """Put the first coordinate, or all of them, at a value."""
    coordinates = np.empty(len(ob.data.vertices) * 3, np.float32)
    ob.data.vertices.foreach_get("co", coordinates)
    coordinates[: None if whole else 1] = value
    ob.data.vertices.foreach_set("co", coordinates)
    ob.data.update()


def shaded(ob, value, kind, sockets=("Base Color", "Emission Color")):
    """A material whose colors come from a node of this kind that reads the value."""
    made = material("Odd", (0.5, 0.5, 0.5))
    tree = made.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Emission Strength"].default_value = 1.0
    node = tree.nodes.new(kind)
    for name in sockets:
        tree.links.new(node.outputs[0], shader.inputs[name])
    ob.data.materials.append(made)
    return node


def colored(ob, value):
    layer = ob.data.attributes.new("Color", "FLOAT_COLOR", "CORNER")
    layer.data.foreach_set("color", np.full(len(ob.data.loops) * 4, value, np.float32))
    shaded(ob, value, "ShaderNodeVertexColor").layer_name = "Color"


def textured(ob, value):
    uv = np.full(len(ob.data.loops) * 2, 0.3, np.float32)
    uv[::3] = value
    ob.data.uv_layers.new(name="Map").uv.foreach_set("vector", uv)
    image = bpy.data.images.new("Odd", 4, 4, float_buffer=True)
    image.pixels.foreach_set(np.full(64, value, np.float32))
    shaded(ob, value, "ShaderNodeTexImage").image = image


def emissive(ob, value):
    ob.data.materials.append(material("Odd", (0.5, 0.5, 0.5)))
    shader = next(n for n in ob.data.materials[0].node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    shader.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    shader.inputs["Emission Strength"].default_value = value


@pytest.mark.parametrize("value", ODD)
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("target", ["FACE", "CORNER"])
def test_occluders_with_odd_vertices_are_named_where_they_are_not_finite(value, whole, target):
    ob, odd = floor(n=2), cube("Odd")
    displace(odd, value, whole)
    report = bake(ob, target=target)
    assert bool(notes_about(report.warnings, "'Odd'", "no finite position")) == (not np.isfinite(np.float32(value)))
    assert np.isfinite(colors(ob, "Obscurance")).all()


@pytest.mark.parametrize("value", ODD)
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("target", ["FACE", "CORNER"])
def test_baked_objects_with_odd_vertices_are_named(value, whole, target):
    """Alone and wholly odd there is nothing to bake; else the rest is baked."""
    odd = floor("Odd", n=2)
    displace(odd, value, whole)
    if whole:
        with pytest.raises(ObscuranceError, match="'Odd'"):
            bake(odd, target=target)
        return
    report = bake(odd, target=target)
    assert bool(notes_about(report.warnings, "'Odd'", "no finite position")) == (not np.isfinite(np.float32(value)))
    assert np.isfinite(colors(odd, "Obscurance")).all()


@pytest.mark.parametrize("value", [NAN, INF, HUGE, 1e-40])
@pytest.mark.parametrize("make", [colored, textured, emissive])
def test_odd_materials_give_finite_light(value, make):
    ob, odd = floor(n=2), cube("Odd")
    make(odd, value)
    bake(ob, odd, quantity="COMBINED")
    for one in (ob, odd):
        assert np.isfinite(colors(one)).all()


@pytest.mark.parametrize("kind", ["POINT", "SUN", "AREA", "SPOT"])
def test_lamps_of_huge_power_give_finite_light(kind):
    ob = floor(n=2)
    lamp = bpy.data.lights.new("Lamp", kind)
    lamp.energy = HUGE
    made = bpy.data.objects.new("Lamp", lamp)
    made.location = (0, 0, 2)
    bpy.context.scene.collection.objects.link(made)
    bake(ob, quantity="COMBINED")
    assert np.isfinite(colors(ob)).all()


@pytest.mark.parametrize("value", [NAN, INF, HUGE, 1e-40])
def test_odd_transforms_are_named_or_harmless(value):
    ob, odd = floor(n=2), cube("Odd")
    odd.scale.x = value
    report = bake(ob)
    assert bool(notes_about(report.warnings, "'Odd'", "no finite position")) == np.isnan(value)  # Blender cuts INF
    assert np.isfinite(colors(ob)).all()
