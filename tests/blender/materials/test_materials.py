"""Materials as a whole: what shaders scatter and emit, what is clamped, what is noted."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.materials import shaders
from obscurance_addon.blender.materials.snapshot import snapshot_material
from obscurance_addon.core.notes import Notes
from obscurance_addon.core.shading.expressions import Constant
from obscurance_addon.core.shading.shading import DEFAULT_REFLECTANCE, MAX_REFLECTANCE, Shading, shade_faces
from obscurance_addon.core.shading.surfaces import NO_TRIANGLES
from tests.blender.materials.material_helpers import (
    COLOR,
    Tree,
    close,
    emission_of,
    make_image,
    quads,
    reflectance_of,
    shade,
    transmission_of,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def test_empty_slot_is_the_default_grey_and_dark():
    reflectance, emission = shade(None)
    close(reflectance, DEFAULT_REFLECTANCE)
    close(emission, 0.0)


@pytest.mark.skipif(bpy.app.version >= (5, 0, 0), reason="materials always use nodes")
@pytest.mark.parametrize("has_tree", [False, True])
def test_material_without_nodes_shows_its_viewport_color(has_tree):
    material = bpy.data.materials.new("Plain")
    material.use_nodes = has_tree
    material.use_nodes = False
    material.diffuse_color = (*COLOR, 0.5)
    reflectance, emission = shade(material)
    close(reflectance, COLOR)
    close(emission, 0.0)


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="older materials may do without nodes")
@pytest.mark.filterwarnings("error")
def test_new_versions_are_not_asked_whether_they_use_nodes():
    close(reflectance_of(Tree().diffuse()), COLOR)


def test_tree_without_output_and_unlinked_output_are_black():
    notes = []
    tree = Tree()
    close(reflectance_of(tree, notes=notes), 0.0)
    assert notes == []
    tree.tree.nodes.clear()
    close(reflectance_of(tree, notes=notes), 0.0)
    assert len(notes) == 1
    assert "'Paint'" in notes[0]


def test_cycles_output_wins_over_the_output_for_all_renderers():
    tree = Tree()
    tree.output.target = "EEVEE"
    tree.diffuse(color=(0.1, 0.1, 0.1))
    tree.output = tree.node("ShaderNodeOutputMaterial", target="CYCLES")
    close(reflectance_of(tree.diffuse()), COLOR)


@pytest.mark.parametrize(
    ("inputs", "share"),
    [
        ({}, 1.0),
        ({"Metallic": 0.5}, 1.0),
        ({"Metallic": 1.0}, 1.0),
        ({"Transmission_Weight": 0.25}, 0.75),
        ({"Metallic": 0.5, "Transmission_Weight": 0.5}, 0.75),
        ({"Alpha": 0.25}, 0.25),
        ({"Subsurface_Weight": 1.0}, 1.0),
        ({"Metallic": 0.5, "Transmission_Weight": 0.5, "Alpha": 0.5}, 0.375),
    ],
)
def test_principled_diffuse_share(inputs, share):
    tree = Tree()
    tree.principled(**inputs)
    close(reflectance_of(tree), np.multiply(COLOR, share))
    close(emission_of(tree), 0.0)


def test_principled_emission_is_pi_times_radiance_and_scaled_by_alpha():
    tree = Tree()
    node = tree.principled(Emission_Color=(1.0, 0.5, 0.25, 1.0), Emission_Strength=2.0)
    close(emission_of(tree), np.pi * np.array([2.0, 1.0, 0.5]), 1e-5)
    close(reflectance_of(tree), COLOR)
    node.inputs["Alpha"].default_value = 0.25
    close(emission_of(tree), np.pi * np.array([0.5, 0.25, 0.125]), 1e-5)


def test_emission_node():
    tree = Tree()
    tree.surface(tree.node("ShaderNodeEmission", {"Color": (*COLOR, 1), "Strength": 3.0}).outputs[0])
    close(emission_of(tree), 3.0 * np.pi * np.array(COLOR), 1e-5)
    close(reflectance_of(tree), 0.0)


@pytest.mark.parametrize(
    ("kind", "name"),
    [("ShaderNodeBsdfDiffuse", "Color"), ("ShaderNodeSubsurfaceScattering", "Color"), ("ShaderNodeBsdfToon", "Color")],
)
def test_diffuse_shaders_reflect_their_color(kind, name):
    tree = Tree()
    tree.surface(tree.node(kind, {name: (*COLOR, 1)}).outputs[0])
    close(reflectance_of(tree), COLOR)


def test_eevee_specular():
    tree = Tree()
    inputs = {"Base Color": (*COLOR, 1), "Emissive Color": (1, 2, 3, 1), "Transparency": 0.5}
    tree.surface(tree.node("ShaderNodeEeveeSpecular", inputs).outputs[0])
    close(reflectance_of(tree), np.multiply(COLOR, 0.5))
    close(emission_of(tree), np.pi * np.array([0.5, 1.0, 1.5]), 1e-5)


@pytest.mark.parametrize(
    "kind",
    [
        "ShaderNodeBackground",
        "ShaderNodeBsdfHair",
        "ShaderNodeBsdfHairPrincipled",
        "ShaderNodeBsdfSheen",
        "ShaderNodeBsdfTranslucent",
        "ShaderNodeHoldout",
        "ShaderNodeVolumePrincipled",
    ],
)
def test_shaders_without_diffuse_part_are_black(kind):
    tree, notes = Tree(), []
    try:
        node = tree.node(kind)
    except RuntimeError:
        pytest.skip("this version has no such node")
    tree.surface(node.outputs[0])
    close(reflectance_of(tree, notes=notes), 0.0)
    close(emission_of(tree), 0.0)
    assert notes == []


def test_unknown_shader_is_default_grey_with_a_note(monkeypatch):
    tree, notes = Tree(), []
    tree.surface(tree.node("ShaderNodeBsdfDiffuse").outputs[0])
    # A node of another renderer's add-on would look like this: a shader that the table does not list.
    monkeypatch.delitem(shaders.SHADER_NODES, "ShaderNodeBsdfDiffuse")
    close(reflectance_of(tree, notes=notes), DEFAULT_REFLECTANCE)
    assert len(notes) == 1
    assert "Diffuse BSDF" in notes[0]


def test_mix_of_emission_and_diffuse():
    tree = Tree()
    emission = tree.node("ShaderNodeEmission", {"Color": (1, 0.5, 0, 1), "Strength": 4.0})
    diffuse = tree.node("ShaderNodeBsdfDiffuse", {"Color": (*COLOR, 1)})
    inputs = {"Fac": 0.25, "Shader": emission.outputs[0], "Shader_001": diffuse.outputs[0]}
    tree.surface(tree.node("ShaderNodeMixShader", inputs).outputs[0])
    close(reflectance_of(tree), np.multiply(COLOR, 0.25))
    close(emission_of(tree), np.pi * 0.75 * np.array([4.0, 2.0, 0.0]), 1e-5)


def test_mix_factor_is_clamped_and_a_missing_shader_is_black():
    tree = Tree()
    diffuse = tree.node("ShaderNodeBsdfDiffuse", {"Color": (*COLOR, 1)})
    mix = tree.node("ShaderNodeMixShader", {"Fac": tree.number(0.25), "Shader": diffuse.outputs[0]})
    tree.surface(mix.outputs[0])
    close(reflectance_of(tree), np.multiply(COLOR, 0.75))
    mix.inputs[0].links[0].from_node.outputs[0].default_value = -3.0
    close(reflectance_of(tree), COLOR)


def test_add_shader_sums():
    tree = Tree()
    shaders = [tree.node("ShaderNodeBsdfDiffuse", {"Color": (0.1, 0.2, 0.3, 1)}) for _ in range(2)]
    add = tree.node("ShaderNodeAddShader", {"Shader": shaders[0].outputs[0], "Shader_001": shaders[1].outputs[0]})
    tree.surface(add.outputs[0])
    close(reflectance_of(tree), (0.2, 0.4, 0.6))


def test_color_linked_to_the_surface_emits():
    tree = Tree()
    tree.surface(tree.rgb())
    close(emission_of(tree), np.pi * np.array(COLOR), 1e-5)
    close(reflectance_of(tree), 0.0)


def test_white_is_clamped_and_black_stays_black():
    close(reflectance_of(Tree().diffuse(color=(1.0, 7.0, 0.0))), (MAX_REFLECTANCE, MAX_REFLECTANCE, 0.0))
    assert not reflectance_of(Tree().diffuse(color=(0.0, 0.0, 0.0))).any()


def test_nothing_negative_or_infinite_leaves():
    values = Shading(Constant((np.nan, np.inf, -1.0)), Constant((np.nan, np.inf, -1.0)))
    reflectance, emission, _ = shade_faces([values], np.zeros(2, np.int32), NO_TRIANGLES)
    close(reflectance, (0.0, MAX_REFLECTANCE, 0.0))
    assert np.isfinite(emission).all()
    assert (emission[:, [0, 2]] == 0.0).all()
    tree = Tree()
    tree.surface(tree.node("ShaderNodeEmission", {"Color": (1, 1, 1, 1), "Strength": -2.0}).outputs[0])
    close(emission_of(tree), 0.0)


def test_faces_are_clamped_after_their_mean():
    """Half of the face at 1.5 and half at 0.5 is 1.0: clamped once, not per texel (0.725)."""
    image = make_image(np.repeat([[[1.5] * 3], [[0.5] * 3]], 2, axis=1), byte=False)
    tree = Tree()
    tree.diffuse(tree.image(image, interpolation="Closest").outputs[0])
    close(reflectance_of(tree, quads((0, 0, 1, 1))), MAX_REFLECTANCE)


def test_procedural_texture_keeps_the_socket_color_with_a_note_for_each_kind():
    tree, notes = Tree("Marble"), []
    node = tree.principled()
    noise = tree.node("ShaderNodeTexNoise")
    tree.link(noise.outputs["Color"], node.inputs["Base Color"])
    tree.link(tree.node("ShaderNodeFresnel").outputs[0], node.inputs["Transmission Weight"])
    node.inputs["Transmission Weight"].default_value = 0.5
    close(reflectance_of(tree, notes=notes), np.multiply(COLOR, 0.5))
    assert len(notes) == 2
    for note, node in zip(sorted(notes), ("Fresnel", "Noise Texture"), strict=True):
        assert all(text in note for text in ("'Marble'", f"'{node}'", "keep their own value", "mean of what you see"))


def test_factor_of_a_mix_keeps_its_value():
    tree, notes = Tree("Varnish"), []
    diffuse = tree.node("ShaderNodeBsdfDiffuse", {"Color": (*COLOR, 1)})
    sheen = tree.node("ShaderNodeBsdfSheen")
    mix = tree.node("ShaderNodeMixShader", {"Fac": 0.25, "Shader": diffuse.outputs[0], "Shader_001": sheen.outputs[0]})
    tree.link(tree.node("ShaderNodeLayerWeight").outputs[0], mix.inputs[0])
    close(reflectance_of(tree.surface(mix.outputs[0]), notes=notes), np.multiply(COLOR, 0.75))
    assert len(notes) == 1
    assert "'Varnish'" in notes[0]


def test_note_names_the_inner_socket_that_kept_its_value():
    """Noise through a ramp: the ramp's own factor of 0.5 stands in for the noise."""
    tree, notes = Tree(), []
    ramp = tree.node("ShaderNodeValToRGB", {"Fac": tree.node("ShaderNodeTexNoise").outputs[0]})
    tree.diffuse(ramp.outputs[0])
    close(reflectance_of(tree, notes=notes), 0.5, 1e-5)
    assert len(notes) == 1


def test_clean_materials_leave_no_notes():
    tree, notes = Tree(), []
    tree.principled()
    reflectance_of(tree, notes=notes)
    assert notes == []


@pytest.mark.parametrize(("method", "told"), [("BUMP", 0), ("DISPLACEMENT", 1), ("BOTH", 1)])
@pytest.mark.parametrize("is_linked", [True, False])
def test_displacement_that_renders_only_is_noted(method, told, is_linked):
    """Bump leaves surfaces where they are, and so does a socket without a link."""
    material = bpy.data.materials.new("Rough")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.displacement_method = method
    tree = material.node_tree
    node, end = tree.nodes.new("ShaderNodeDisplacement"), tree.get_output_node("CYCLES")
    if is_linked:
        tree.links.new(node.outputs[0], end.inputs["Displacement"])
    notes = Notes()
    snapshot_material(material, notes)
    lines = [line for line in notes.lines() if "displaced in renders" in line]
    assert len(lines) == told * is_linked
    assert all("'Rough'" in line for line in lines)


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ({}, (0.0, 0.0, 0.0)),
        ({"Alpha": 0.25}, (0.75, 0.75, 0.75)),
        ({"Alpha": 0.0}, (1.0, 1.0, 1.0)),
        ({"Transmission_Weight": 1.0}, np.sqrt(COLOR)),
        ({"Transmission_Weight": 1.0, "Alpha": 0.5}, 0.5 + 0.5 * np.sqrt(COLOR)),
        ({"Transmission_Weight": 0.5, "Metallic": 0.5}, 0.25 * np.sqrt(COLOR)),
        ({"Transmission_Weight": 1.0, "Metallic": 1.0}, (0.0, 0.0, 0.0)),
    ],
)
def test_what_passes_a_principled_surface(inputs, expected):
    """What passes, is scattered and is hidden by alpha never adds up to more than all light."""
    tree = Tree()
    tree.principled(**inputs)
    close(transmission_of(tree), expected)
    assert (transmission_of(tree) + reflectance_of(tree) <= 1.0 + 1e-6).all()


@pytest.mark.parametrize("kind", ["Transparent", "Glass", "Refraction"])
def test_clear_shaders_let_their_color_through_and_scatter_nothing(kind):
    tree, notes = Tree(), []
    tree.surface(tree.node(f"ShaderNodeBsdf{kind}", {"Color": (*COLOR, 1)}).outputs[0])
    close(transmission_of(tree, notes=notes), COLOR)
    close(reflectance_of(tree), 0.0)
    assert notes == []


@pytest.mark.parametrize(("kind", "name"), [("Glossy", "Color"), ("Metallic", "Base Color")])
def test_metals_reflect_their_color(kind, name):
    tree = Tree()
    try:
        node = tree.node(f"ShaderNodeBsdf{kind}", {name: (*COLOR, 1)})
    except RuntimeError:
        pytest.skip("this version has no such node")
    tree.surface(node.outputs[0])
    close(reflectance_of(tree), COLOR)
    close(transmission_of(tree), 0.0)


def test_a_physical_conductor_has_the_color_of_its_constants():
    """Gold at 0.65, 0.55 and 0.45 micrometres: reflectances of Johnson and Christy's constants."""
    tree = Tree()
    try:
        node = tree.node("ShaderNodeBsdfMetallic", fresnel_type="PHYSICAL_CONDUCTOR")
    except RuntimeError:
        pytest.skip("this version has no such node")
    node.inputs["IOR"].default_value, node.inputs["Extinction"].default_value = (0.15, 0.38, 1.45), (3.5, 2.6, 1.88)
    tree.surface(node.outputs[0])
    close(reflectance_of(tree), (MAX_REFLECTANCE, 0.826, 0.390), 5e-3)


@pytest.mark.parametrize(
    ("kind", "inputs", "shares"),
    [("ShaderNodeMixShader", {"Fac": 0.25}, (0.75, 0.25)), ("ShaderNodeAddShader", {}, (1.0, 1.0))],
)
def test_mixed_and_added_transparency(kind, inputs, shares):
    tree = Tree()
    diffuse = tree.node("ShaderNodeBsdfDiffuse", {"Color": (*COLOR, 1)})
    clear = tree.node("ShaderNodeBsdfTransparent", {"Color": (1.0, 0.5, 0.0, 1.0)})
    node = tree.node(kind, inputs | {"Shader": diffuse.outputs[0], "Shader_001": clear.outputs[0]})
    tree.surface(node.outputs[0])
    close(reflectance_of(tree), np.multiply(COLOR, shares[0]))
    close(transmission_of(tree), np.multiply((1.0, 0.5, 0.0), shares[1]))


def test_nothing_but_a_volume_is_no_surface():
    """A volume under a surface leaves the surface what it is, and no link at all is black and opaque."""
    tree = Tree()
    close(transmission_of(tree), 0.0)
    tree.link(tree.node("ShaderNodeVolumePrincipled").outputs[0], tree.output.inputs["Volume"])
    close(transmission_of(tree), 1.0)
    close(reflectance_of(tree), 0.0)
    tree.diffuse()
    close(transmission_of(tree), 0.0)
    close(reflectance_of(tree), COLOR)


def test_alpha_of_a_texture_passes_as_its_mean_over_a_face():
    pixels = np.ones((4, 4, 4), np.float32)
    pixels[:, 1:, 3] = 0.0
    tree = Tree()
    node = tree.principled()
    tree.link(
        tree.image(make_image(pixels, byte=False), interpolation="Closest").outputs["Alpha"], node.inputs["Alpha"]
    )
    mesh = quads((0, 0, 1, 1), (0, 0, 0.25, 1))
    close(transmission_of(tree, mesh), [(0.75,) * 3, (0.0,) * 3])
