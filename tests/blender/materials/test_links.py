"""Where links lead: reroutes, muted nodes, groups, loops."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.materials.nodes import MAX_DEPTH
from tests.blender.materials.material_helpers import (
    COLOR,
    RED,
    WHITE,
    Tree,
    add_node,
    close,
    put_color,
    put_uv,
    quads,
    quarters,
    reflectance_of,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def make_group(name, build, *, kind="NodeSocketColor", default=(*RED, 1)):
    """A group with one exposed input; `build(tree, socket)` says what becomes of it."""
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    exposed = group.interface.new_socket("Tint", in_out="INPUT", socket_type=kind)
    exposed.default_value = default
    entry = group.nodes.new("NodeGroupInput")
    result = build(group, entry.outputs[0])
    kind = "NodeSocketShader" if result.type == "SHADER" else "NodeSocketColor"
    group.interface.new_socket("Result", in_out="OUTPUT", socket_type=kind)
    end = group.nodes.new("NodeGroupOutput")
    group.links.new(result, end.inputs[0])
    return group


def halved(tree, socket):
    mix = {"Fac": 0.5, "Color1": socket, "Color2": (0, 0, 0, 1)}
    return add_node(tree, "ShaderNodeMixRGB", mix).outputs[0]


def grouped(inner):
    def build(tree, socket):
        node = add_node(tree, "ShaderNodeGroup", node_tree=inner)
        tree.links.new(socket, node.inputs[0])
        return node.outputs[0]

    return build


def test_reroutes_are_followed_and_dangling_ones_are_no_link():
    tree, notes = Tree(), []
    first, second = tree.node("NodeReroute"), tree.node("NodeReroute")
    tree.diffuse(second.outputs[0], color=RED)
    tree.link(first.outputs[0], second.inputs[0])
    close(reflectance_of(tree, notes=notes), RED)
    tree.link(tree.rgb(), first.inputs[0])
    close(reflectance_of(tree, notes=notes), COLOR)
    assert notes == []


def test_frames_do_not_matter():
    tree = Tree()
    source = tree.rgb()
    source.node.parent = tree.node("NodeFrame")
    close(reflectance_of(tree.diffuse(source)), COLOR)


def test_muted_link_is_no_link():
    tree = Tree()
    tree.diffuse(tree.rgb(), color=RED)
    next(link for link in tree.tree.links if link.from_node.bl_idname == "ShaderNodeRGB").is_muted = True
    close(reflectance_of(tree), RED)


def test_muted_node_passes_its_first_input_on():
    tree = Tree()
    mix = tree.node("ShaderNodeMixRGB", {"Fac": 1.0, "Color1": tree.rgb(), "Color2": (*RED, 1)})
    mix.mute = True
    # Version 4.2 finds the links inside a muted node only when the tree's links change.
    tree.diffuse(mix.outputs[0])
    close(reflectance_of(tree), COLOR)


def test_muted_node_without_way_through_is_no_link():
    tree, notes = Tree(), []
    source = tree.rgb()
    source.node.mute = True
    tree.diffuse(source, color=RED)
    close(reflectance_of(tree, notes=notes), RED)
    assert notes == []


def test_muted_shader():
    tree = Tree()
    diffuse = tree.node("ShaderNodeBsdfDiffuse", {"Color": (*COLOR, 1)})
    mix = tree.node("ShaderNodeMixShader", {"Fac": 0.25, "Shader": diffuse.outputs[0]})
    mix.mute = True
    tree.surface(mix.outputs[0])
    close(reflectance_of(tree), COLOR)
    diffuse.mute = True
    tree.surface(diffuse.outputs[0])
    close(reflectance_of(tree), 0.0)


def test_groups_nested_twice_take_the_color_of_their_instance():
    nested = make_group("Outer", grouped(make_group("Inner", halved)))
    tree = Tree()
    group = tree.node("ShaderNodeGroup", node_tree=nested)
    tree.diffuse(group.outputs[0])
    close(reflectance_of(tree), np.multiply(RED, 0.5))
    group.inputs[0].default_value = (*COLOR, 1)
    close(reflectance_of(tree), np.multiply(COLOR, 0.5))
    tree.link(tree.rgb(WHITE), group.inputs[0])
    close(reflectance_of(tree), np.multiply(WHITE, 0.5))


def test_two_instances_of_a_group_keep_apart():
    group = make_group("Half", halved)
    tree = Tree()
    instances = [tree.node("ShaderNodeGroup", node_tree=group) for _ in range(2)]
    instances[0].inputs[0].default_value = (0.8, 0, 0, 1)
    instances[1].inputs[0].default_value = (0, 0.4, 0, 1)
    mix = {"Fac": 1.0, "Color1": instances[0].outputs[0], "Color2": instances[1].outputs[0]}
    tree.diffuse(tree.node("ShaderNodeMixRGB", mix, blend_type="ADD").outputs[0])
    close(reflectance_of(tree), (0.4, 0.2, 0.0))


def test_group_with_a_shader_inside():
    def build(tree, socket):
        return add_node(tree, "ShaderNodeBsdfDiffuse", {"Color": socket}).outputs[0]

    tree = Tree()
    group = tree.node("ShaderNodeGroup", node_tree=make_group("Matte", build))
    group.inputs[0].default_value = (*COLOR, 1)
    close(reflectance_of(tree.surface(group.outputs[0])), COLOR)


def test_group_socket_converts_between_color_and_number():
    """A colour that enters a group through a number socket is grey inside."""
    group = make_group("Grey", halved, kind="NodeSocketFloat", default=0.5)
    tree = Tree()
    node = tree.node("ShaderNodeGroup", node_tree=group)
    tree.link(tree.rgb(), node.inputs[0])
    luminance = 0.2126 * 0.2 + 0.7152 * 0.4 + 0.0722 * 0.6
    close(reflectance_of(tree.diffuse(node.outputs[0])), 0.5 * luminance)


def test_texture_coordinates_through_a_group():
    image = quarters(byte=False)

    def build(tree, socket):
        node = add_node(tree, "ShaderNodeTexImage", image=image, interpolation="Closest")
        tree.links.new(socket, node.inputs[0])
        return node.outputs[0]

    tree = Tree()
    group = make_group("Picture", build, kind="NodeSocketVector", default=(0, 0, 0))
    node = tree.node("ShaderNodeGroup", node_tree=group)
    mesh = quads((0, 0, 0.5, 0.5))
    put_uv(mesh, "Second", [(0.5, 0.5, 1, 1)])
    tree.link(tree.node("ShaderNodeUVMap", uv_map="Second").outputs[0], node.inputs[0])
    close(reflectance_of(tree.diffuse(node.outputs[0]), mesh), WHITE)


def test_group_without_tree_is_no_link():
    tree = Tree()
    node = tree.node("ShaderNodeGroup", node_tree=make_group("Half", halved))
    tree.diffuse(node.outputs[0], color=RED)
    bpy.data.node_groups.remove(bpy.data.node_groups["Half"])
    close(reflectance_of(tree), RED)


def test_loops_and_long_chains_end():
    tree, notes = Tree("Long"), []
    first = tree.node("ShaderNodeMath", {"Value": 0.25, "Value_001": 0.0}, operation="ADD")
    last = first
    for _ in range(2 * MAX_DEPTH):
        last = tree.node("ShaderNodeMath", {"Value": last.outputs[0], "Value_001": 0.0}, operation="ADD")
    tree.diffuse(last.outputs[0])
    close(reflectance_of(tree, notes=notes), 0.5)  # what an unlinked socket of a Math node holds
    assert len(notes) == 1
    assert "'Long'" in notes[0]
    tree.link(last.outputs[0], first.inputs[0])
    assert np.isfinite(reflectance_of(tree)).all()


def test_chain_within_the_limit_is_followed():
    tree, notes = Tree(), []
    last = tree.number(0.125)
    for _ in range(MAX_DEPTH - 10):
        node = tree.node("ShaderNodeMath", {"Value": last, "Value_001": 0.0}, operation="ADD")
        last = node.outputs[0]
    close(reflectance_of(tree.diffuse(last), notes=notes), 0.125)
    assert notes == []


def test_shared_nodes_are_read_once():
    """Every node feeds both inputs of the next: 2^60 paths."""
    tree = Tree()
    paint = tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs[0]
    for _ in range(60):
        paint = tree.node("ShaderNodeMixRGB", {"Fac": 0.5, "Color1": paint, "Color2": paint}).outputs[0]
    mesh = quads((0, 0, 1, 1), uv_name="")
    put_color(mesh, "Paint", [COLOR], "FACE")
    close(reflectance_of(tree.diffuse(paint), mesh), COLOR, 1e-5)
