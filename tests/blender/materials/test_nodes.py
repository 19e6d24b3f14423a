"""Nodes between sockets: colour and number arithmetic."""

import numpy as np
import pytest

from tests.blender.materials.material_helpers import (
    BLUE,
    COLOR,
    RED,
    Tree,
    close,
    input_of,
    out_of,
    put_color,
    quads,
    reflectance_of,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("MIX", 0.5 * (0.4 + 0.3)),
        ("MULTIPLY", 0.5 * (0.4 + 0.12)),
        ("ADD", 0.4 + 0.5 * 0.3),
        ("SUBTRACT", 0.4 - 0.5 * 0.3),
        ("SCREEN", 0.5 * (0.4 + 1 - 0.6 * 0.7)),
        ("DARKEN", 0.5 * (0.4 + 0.3)),
        ("LIGHTEN", 0.4),
    ],
)
@pytest.mark.parametrize("kind", ["ShaderNodeMixRGB", "ShaderNodeMix"])
def test_blend_types(kind, mode, expected):
    tree = Tree()
    a, b = (0.4, 0.4, 0.4, 1), (0.3, 0.3, 0.3, 1)
    if kind == "ShaderNodeMixRGB":
        node = tree.node(kind, {"Fac": 0.5, "Color1": a, "Color2": b}, blend_type=mode)
        tree.diffuse(node.outputs[0])
    else:
        inputs = {"Factor_Float": 0.5, "A_Color": a, "B_Color": b}
        node = tree.node(kind, inputs, data_type="RGBA", blend_type=mode)
        tree.diffuse(out_of(node, "Result_Color"))
    close(reflectance_of(tree), expected)


def test_other_blend_types_give_the_first_color_and_a_note():
    tree, notes = Tree("Wall"), []
    inputs = {"Fac": 0.5, "Color1": (*COLOR, 1), "Color2": (1, 1, 1, 1)}
    tree.diffuse(tree.node("ShaderNodeMixRGB", inputs, blend_type="DODGE").outputs[0])
    close(reflectance_of(tree, notes=notes), COLOR)
    assert len(notes) == 1
    assert "DODGE" in notes[0]


def test_mix_node_of_numbers_and_its_clamps():
    tree = Tree()
    inputs = {"Factor_Float": 2.0, "A_Float": 0.25, "B_Float": 0.5}
    node = tree.node("ShaderNodeMix", inputs, data_type="FLOAT")
    tree.link(out_of(node, "Result_Float"), tree.principled().inputs["Transmission Weight"])
    close(reflectance_of(tree), np.multiply(COLOR, 0.5))
    node.clamp_factor = False
    close(reflectance_of(tree), np.multiply(COLOR, 0.25))
    tree = Tree()
    inputs = {"Factor_Float": 1.0, "A_Color": (2, 2, 2, 1), "B_Color": (1, 1, 1, 1)}
    node = tree.node("ShaderNodeMix", inputs, data_type="RGBA", blend_type="ADD", clamp_result=True)
    half = {"Fac": 0.5, "Color1": out_of(node, "Result_Color"), "Color2": (0, 0, 0, 1)}
    tree.diffuse(tree.node("ShaderNodeMixRGB", half).outputs[0])
    close(reflectance_of(tree), 0.5)


@pytest.mark.parametrize(
    ("operation", "a", "b", "expected"),
    [
        ("ADD", 0.2, 0.3, 0.5),
        ("SUBTRACT", 0.6, 0.2, 0.4),
        ("MULTIPLY", 0.6, 0.5, 0.3),
        ("DIVIDE", 0.3, 0.5, 0.6),
        ("DIVIDE", 0.3, 0.0, 0.0),
        ("POWER", 0.5, 2.0, 0.25),
        ("POWER", -0.5, 0.5, 0.0),
        ("MINIMUM", 0.6, 0.2, 0.2),
        ("MAXIMUM", 0.6, 0.2, 0.6),
        ("GREATER_THAN", 0.6, 0.7, 0.0),
    ],
)
def test_math(operation, a, b, expected):
    tree = Tree()
    node = tree.node("ShaderNodeMath", {"Value": tree.number(a), "Value_001": b}, operation=operation)
    tree.diffuse(node.outputs[0])
    close(reflectance_of(tree), expected)


def test_math_clamps_when_asked_and_notes_what_it_cannot_do():
    tree, notes = Tree(), []
    node = tree.node("ShaderNodeMath", {"Value": 3.0, "Value_001": 2.0}, operation="ADD", use_clamp=True)
    half = tree.node("ShaderNodeMath", {"Value": node.outputs[0], "Value_001": 0.5}, operation="MULTIPLY")
    tree.diffuse(half.outputs[0])
    close(reflectance_of(tree), 0.5)
    node.operation = "SINE"
    half.inputs[0].default_value = 0.4
    close(reflectance_of(tree, notes=notes), 0.2)
    assert len(notes) == 1
    assert "SINE" in notes[0]


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        ("ShaderNodeGamma", {"Gamma": 2.0}, np.square(COLOR)),
        ("ShaderNodeInvert", {"Fac": 1.0}, np.subtract(1, COLOR)),
        ("ShaderNodeInvert", {"Fac": 0.5}, 0.5),
        ("ShaderNodeBrightContrast", {"Bright": 0.1, "Contrast": 0.0}, np.add(COLOR, 0.1)),
        ("ShaderNodeBrightContrast", {"Bright": 0.0, "Contrast": 1.0}, (0.0, 0.3, 0.7)),
        ("ShaderNodeHueSaturation", {}, COLOR),
        ("ShaderNodeHueSaturation", {"Value": 0.5}, np.multiply(COLOR, 0.5)),
        ("ShaderNodeHueSaturation", {"Saturation": 0.0}, 0.6),
        ("ShaderNodeHueSaturation", {"Hue": 0.5 + 1 / 3}, (0.6, 0.2, 0.4)),
        ("ShaderNodeHueSaturation", {"Hue": 0.7, "Saturation": 0.5, "Value": 1.5, "Fac": 0.0}, COLOR),
        # (0.2, 0.4, 0.6) turned by a fifth of the circle, half as saturated, half as bright again.
        ("ShaderNodeHueSaturation", {"Hue": 0.7, "Saturation": 0.5, "Value": 1.5}, (0.81, 0.6, 0.9)),
        ("ShaderNodeRGBCurve", {}, COLOR),
        ("ShaderNodeRGBToBW", {}, 0.2126 * 0.2 + 0.7152 * 0.4 + 0.0722 * 0.6),
    ],
)
@pytest.mark.parametrize("constant", [True, False])
def test_color_nodes(kind, inputs, expected, constant):
    tree = Tree()
    mesh = quads((0, 0, 1, 1), uv_name="")
    put_color(mesh, "Paint", [COLOR], "FACE")
    source = tree.rgb() if constant else tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs[0]
    tree.diffuse(tree.node(kind, {"Color": source, **inputs}).outputs[0])
    close(reflectance_of(tree, mesh), expected, 1e-5)


def test_curves_bend_each_channel_after_all():
    tree = Tree()
    node = tree.node("ShaderNodeRGBCurve", {"Fac": 1.0, "Color": tree.rgb()})
    for index, height in ((0, 0.5), (3, 0.8)):
        node.mapping.curves[index].points[1].location = (1.0, height)
    node.mapping.update()
    tree.diffuse(node.outputs[0])
    close(reflectance_of(tree), 0.8 * np.array([0.5, 1.0, 1.0]) * COLOR, 1e-4)


@pytest.mark.parametrize("varying", [True, False])
def test_color_ramp(varying):
    mesh = quads(*[(0, 0, 1, 1)] * 2, uv_name="")
    put_color(mesh, "Paint", [(0.25, 0.25, 0.25), (0.75, 0.75, 0.75)], "FACE")
    tree = Tree()
    paint = tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs[0]
    node = tree.node("ShaderNodeValToRGB", {"Fac": paint if varying else tree.number(0.25)})
    node.color_ramp.elements[0].color = (*RED, 1)
    node.color_ramp.elements[1].color = (*BLUE, 0.5)
    tree.diffuse(node.outputs["Color"])
    red, blue = np.array(RED), np.array(BLUE)
    expected = np.array([0.75 * red + 0.25 * blue, 0.25 * red + 0.75 * blue])
    close(reflectance_of(tree, mesh)[: 2 if varying else 1], expected[: 2 if varying else 1], 1e-5)
    node.color_ramp.interpolation = "CONSTANT"
    close(reflectance_of(tree, mesh), RED)
    tree.diffuse(node.outputs["Alpha"])
    node.color_ramp.interpolation = "LINEAR"
    close(reflectance_of(tree, mesh)[0], 0.875, 1e-5)


@pytest.mark.parametrize(("kind", "expected"), [("MINMAX", 0.3), ("RANGE", 0.6)])
def test_clamp_node(kind, expected):
    tree = Tree()
    inputs = {"Value": tree.number(0.6), "Min": 0.8, "Max": 0.3}
    tree.diffuse(tree.node("ShaderNodeClamp", inputs, clamp_type=kind).outputs[0])
    close(reflectance_of(tree), expected)


def test_map_range():
    tree, mesh = Tree(), quads((0, 0, 1, 1), uv_name="")
    inputs = {"Value": tree.number(0.5), "From Min": 0.25, "From Max": 1.25, "To Min": 0.0, "To Max": 0.8}
    node = tree.node("ShaderNodeMapRange", inputs)
    tree.diffuse(node.outputs["Result"])
    close(reflectance_of(tree, mesh), 0.2)
    input_of(node, "Value").links[0].from_node.outputs[0].default_value = 5.0
    close(reflectance_of(tree, mesh), 0.8)


def test_separate_and_combine():
    tree = Tree()
    parts = tree.node("ShaderNodeSeparateColor", {"Color": tree.rgb()})
    order = {"Red": parts.outputs["Blue"], "Green": parts.outputs["Red"], "Blue": parts.outputs["Green"]}
    tree.diffuse(tree.node("ShaderNodeCombineColor", order).outputs[0])
    close(reflectance_of(tree), (0.6, 0.2, 0.4))
