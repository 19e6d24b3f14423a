"""Bakes among transparent materials: cut-outs of textures, volumes without a surface, glass, lamps."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import Target
from obscurance_addon.core.shading.shading import DEFAULT_REFLECTANCE
from tests.blender.helpers import arrays, bake, baked, colors, cube, floor, material, sheet, snapshot
from tests.blender.materials.material_helpers import Tree, make_image
from tests.blender.reading.light_helpers import lamp

pytestmark = pytest.mark.usefixtures("empty_scene")


def principled(mat: bpy.types.Material) -> bpy.types.Node:
    return next(n for n in mat.node_tree.nodes if n.type == "BSDF_PRINCIPLED")


def leaf_material() -> bpy.types.Material:
    """White, with an alpha of 1 where u < 0.5, and holes elsewhere."""
    pixels = np.ones((4, 4, 4), np.float32)
    pixels[:, 2:, 3] = 0.0
    made = material("Leaf", (0.8, 0.8, 0.8))
    tree = made.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, node.interpolation, node.extension = make_image(pixels), "Closest", "EXTEND"
    tree.links.new(node.outputs["Alpha"], principled(made).inputs["Alpha"])
    return made


def card(z: float = 0.3, turned: bool = False) -> bpy.types.Object:
    """A leaf over a floor of 4 m, which stops light at x < 0, or at y < 0 where its UV map is turned."""
    made = sheet("Card", (-2, -2, z), (4, 0, 0), (0, 4, 0))
    uv = [0, 0, 0, 1, 1, 1, 1, 0] if turned else [0, 0, 1, 0, 1, 1, 0, 1]
    made.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32(uv))
    made.data.materials.append(leaf_material())
    return made


@pytest.mark.parametrize("falloff", ["SQRT", "STEP"])
@pytest.mark.parametrize("target", ["FACE", "CORNER"])
def test_a_cut_out_is_as_if_it_were_cut_in_the_mesh(target, falloff):
    found = {}
    for kind in ("texture", "mesh"):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        ground = floor(size=2.0, n=4)
        if kind == "texture":
            card()
        else:
            sheet("Card", (-2, -2, 0.3), (2, 0, 0), (0, 4, 0), color=(0.8, 0.8, 0.8))
        found[kind] = baked(ground, target=target, falloff=falloff, rays=256, use_bleeding=False)
    assert np.ptp(found["mesh"]) > 0.2
    np.testing.assert_allclose(found["texture"], found["mesh"], atol=2e-3)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("alone", [False, True])
def test_light_falls_through_the_holes_of_a_texture(mirrored, turned, alone):
    """Also of mirrored objects, beside other meshes, and with the map turned."""
    ground, leaf = floor(size=1.0, n=2, color=(0.8, 0.8, 0.8)), card(turned=turned)
    lamp("SUN", (0, 0, 3), energy=np.pi)
    if mirrored:
        leaf.scale.x = leaf.scale.y = -1.0
        leaf.scale.z = -1.0
        leaf.location.z = 0.6
    if not alone:
        cube("Beside", 0.2).location = (9, 9, 9)
    bake(ground, quantity="DIRECT", rays=64)
    lit = colors(ground)[:, 0].reshape(2, 2)  # rows along y
    lit = lit.T if turned else lit
    if mirrored:
        lit = lit[:, ::-1]
    np.testing.assert_allclose(lit, [[0.0, 0.8], [0.0, 0.8]], atol=1e-4)


def test_a_volume_without_a_surface_is_not_there():
    """Neither as something that occludes or is hit, nor as a solid, nor in the automatic distance and R_ave."""
    ground, house = floor(size=3.0, n=4, color=(0.5, 0.5, 0.5)), cube("House", 0.5, color=(0.3, 0.4, 0.5))
    bare = [baked(ground, distance=None), baked(house, distance=None)]
    fog = cube("Fog", 4.0)
    tree = Tree("Fog")
    tree.link(tree.node("ShaderNodeVolumePrincipled").outputs[0], tree.output.inputs["Volume"])
    fog.data.materials.append(tree.material)
    for ob, expected in zip((ground, house), bare, strict=True):
        np.testing.assert_array_equal(baked(ob, distance=None), expected)


def test_opaque_scenes_pay_nothing():
    made = arrays(floor(color=(0.5, 0.5, 0.5)), cube(color=(0.1, 0.2, 0.3)))
    assert made.surfaces.transmission is None
    assert made.materials.opacity is None


def test_no_shell_with_a_window_is_a_solid():
    """Nor is a body of glass; a closed wall beside them still is."""
    ground = floor()
    bodies = [cube(name, color=(0.8, 0.8, 0.8)) for name in ("Glass", "Cabinet", "Wall")]
    glass = Tree("Glass")
    glass.surface(glass.node("ShaderNodeBsdfGlass", {"Color": (0.9, 1.0, 0.9, 1.0)}).outputs[0])
    bodies[0].data.materials.clear()
    bodies[0].data.materials.append(glass.material)
    bodies[1].data.materials.append(glass.material)
    bodies[1].data.polygons[1].material_index = 1
    solid = arrays(ground, *bodies).surfaces.shells.solid
    assert solid.tolist() == [False] * (2 + 12 + 12) + [True] * 12


def test_patches_know_their_opacity():
    ground = floor(n=2, color=(0.8, 0.8, 0.8))
    principled(ground.data.materials[0]).inputs["Alpha"].default_value = 0.25
    np.testing.assert_allclose(arrays(ground).materials.opacity, 0.25, rtol=1e-6)


def test_lamps_count_as_a_surface_without_a_material_where_no_light_is_baked():
    tree, ground = Tree("Lamp"), floor(color=(0.5, 0.5, 0.5))
    tree.surface(tree.node("ShaderNodeEmission", {"Strength": 2.0}).outputs[0])
    cube().data.materials.append(tree.material)
    taken = snapshot(ground)
    for needs_light, expected in ((False, DEFAULT_REFLECTANCE), (True, 0.0)):
        made = prepare_arrays(taken, Target.FACE, needs_light)
        np.testing.assert_allclose(made.surfaces.reflectance[2:], expected, rtol=1e-6)
        np.testing.assert_allclose(made.surfaces.emission[2:], 2.0 * np.pi, rtol=1e-6)
