"""Baked ambient light in materials: added once, seen in renders, taken out without a trace."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.display.ambient_nodes import GROUP_NAME, add_ambient, remove_ambient, shows_ambient
from obscurance_addon.blender.writing.records import INDIRECT, remember
from obscurance_addon.core.errors import ObscuranceError
from obscurance_addon.core.order.output import OutputSettings
from tests.blender.helpers import FACE_LAYER, bake, colors, cube, floor, material, mesh_state, object_state, select
from tests.blender.reading.light_helpers import lamp

pytestmark = pytest.mark.usefixtures("empty_scene")

OUTPUT = OutputSettings()


def tree_state(tree):
    """All nodes with their settings, all links."""
    if tree is None:
        return None
    nodes = {
        node.name: (
            node.bl_idname,
            tuple(node.location),
            node.mute,
            node.node_tree.name if hasattr(node, "node_tree") and node.node_tree else None,
            [str(getattr(socket, "default_value", None)) for socket in node.inputs],
        )
        for node in tree.nodes
    }
    links = sorted(
        (li.from_node.name, li.from_socket.identifier, li.to_node.name, li.to_socket.identifier, li.is_muted)
        for li in tree.links
    )
    return nodes, links


def file_state():
    """Materials, node groups, and all that objects and meshes hold."""
    return {
        "materials": {m.name: (tree_state(m.node_tree), list(m.keys()), m.users) for m in bpy.data.materials},
        "groups": {g.name: tree_state(g) for g in bpy.data.node_groups},
        "objects": {ob.name: object_state(ob) for ob in bpy.data.objects},
        "meshes": {mesh.name: mesh_state(mesh) for mesh in bpy.data.meshes},
    }


def baked_floor(color=(0.5, 0.5, 0.5)):
    """A floor beside a wall, lit and baked."""
    made = floor(n=4, color=color)
    cube("Wall", half=0.4).location = (0.5, 0.0, 0.4)
    lamp("POINT", (-0.5, 0.0, 1.0), energy=50.0)
    bake(made, quantity="AMBIENT", rays=64)
    return made


def group_nodes(mat):
    return [node for node in mat.node_tree.nodes if node.bl_idname == "ShaderNodeGroup" and node.node_tree]


def render(ob, samples=64, seed=0):
    """A square picture from straight above, linear, (n, n, 3); Cycles without indirect light."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.samples = "CPU", False, samples
    scene.cycles.seed = seed
    scene.cycles.diffuse_bounces, scene.cycles.pixel_filter_type, scene.cycles.filter_width = 0, "BOX", 1.0
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.collection.objects.link(scene.camera)
    scene.camera.location = (0.0, 0.0, 5.0)
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    path = bpy.app.tempdir + "picture.exr"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    pixels = np.empty(16 * 16 * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(16, 16, 4)[..., :3].astype(float)


def test_renders_show_direct_light_plus_what_is_baked():
    """The picture with ambient light less the picture without is the attribute, face by face."""
    ob = baked_floor()
    bpy.data.objects["Wall"].hide_render = True
    without = render(ob, 256)
    assert add_ambient([ob], OUTPUT).changed
    difference = render(ob, 256) - without
    per_face = difference.reshape(4, 4, 4, 4, 3).mean((1, 3)).reshape(16, 3)
    np.testing.assert_allclose(per_face, colors(ob), rtol=0.02, atol=2e-3)
    assert colors(ob).mean() > 0.01  # far above the tolerance


def test_ambient_light_lights_nothing_else():
    """Emission that is baked must not come back as light: a white ceiling above stays as dark as before."""
    ob = floor(n=4, color=(0.5, 0.5, 0.5))
    attribute = ob.data.attributes.new(FACE_LAYER, "FLOAT_COLOR", "FACE")
    attribute.data.foreach_set("color", np.full(64, 100.0, np.float32))
    remember(ob.data, FACE_LAYER, INDIRECT, 0.0)
    above = floor("Above", size=0.5, z=1.0, color=(0.8, 0.8, 0.8))
    above.rotation_euler = (0.0, 0.0, 0.3)
    add_ambient([ob], OUTPUT)
    picture = render(ob)
    assert picture[0, 0] == pytest.approx([100.0] * 3, rel=1e-3)
    assert not picture[7:9, 7:9].any()


def test_exposure_is_taken_back():
    """What was stored two stops darker is shown as bright as it is: pixels lit by nothing else agree to rounding."""
    ob = baked_floor()
    bpy.data.objects["Lamp"].hide_render = True
    add_ambient([ob], OUTPUT)
    plain = render(ob, 16)
    attribute = ob.data.attributes[FACE_LAYER]
    darker = np.empty(64, np.float32)
    attribute.data.foreach_get("color", darker)
    attribute.data.foreach_set("color", darker * 0.25)
    ob.data.update()
    remember(ob.data, FACE_LAYER, INDIRECT, -2.0)
    assert add_ambient([ob], OUTPUT).changed
    np.testing.assert_allclose(render(ob, 16), plain, rtol=1e-4, atol=1e-6)
    assert plain.max() > 0.02


def test_twice_changes_nothing():
    ob = baked_floor()
    assert add_ambient([ob], OUTPUT).changed
    before = file_state()
    assert not add_ambient([ob], OUTPUT).changed
    assert file_state() == before
    assert len(group_nodes(ob.data.materials[0])) == 1


def users_tree(mat):
    """A tree of the user's own: a muted link, a node that leads nowhere, a second output."""
    nodes, links = mat.node_tree.nodes, mat.node_tree.links
    end = next(n for n in nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    other, shader = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfGlossy")
    other.target, other.location = "EEVEE", (600, -300)
    links.new(shader.outputs[0], other.inputs["Surface"])
    nodes.new("ShaderNodeTexNoise").location = (-500, 20)
    end.target = "CYCLES"


def test_removed_without_a_trace():
    """Every node, link, material, group and slot is as before; also with two outputs."""
    ob = baked_floor()
    users_tree(ob.data.materials[0])
    before = file_state()
    assert add_ambient([ob], OUTPUT).changed
    assert shows_ambient(ob)
    assert len(group_nodes(ob.data.materials[0])) == 2
    kept = tree_state(ob.data.materials[0].node_tree)[0]
    assert all(kept[name] == node for name, node in before["materials"]["Floor"][0][0].items())
    assert remove_ambient([ob]).objects == ["Floor"]
    assert file_state() == before
    assert not remove_ambient([ob]).changed


def test_a_muted_link_stays_muted():
    ob = baked_floor()
    tree = ob.data.materials[0].node_tree
    end = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    end.inputs["Surface"].links[0].is_muted = True
    before = file_state()
    add_ambient([ob], OUTPUT)
    remove_ambient([ob])
    assert file_state() == before


@pytest.mark.parametrize("what", ["no slot", "empty slot", "no nodes", "no surface", "slot of the object"])
def test_surfaces_without_nodes_get_a_stand_in_and_lose_it_again(what):
    ob = baked_floor()
    mesh = ob.data
    mesh.materials.clear()
    if what == "no slot":
        mesh.polygons.foreach_set("material_index", np.arange(16, dtype=np.int32) % 3)
    else:
        mesh.materials.append(None)
    if what == "no nodes":
        if bpy.app.version >= (5, 0, 0):
            pytest.skip("materials always have nodes")
        mesh.materials[0] = bpy.data.materials.new("Plain")
        mesh.materials[0].diffuse_color = (0.1, 0.6, 0.2, 1.0)
    elif what == "no surface":
        mesh.materials[0] = material("Bare", (1, 1, 1))
        mesh.materials[0].node_tree.links.clear()
    elif what == "slot of the object":
        ob.material_slots[0].link = "OBJECT"
    before = file_state()
    assert add_ambient([ob], OUTPUT).changed
    assert shows_ambient(ob)
    assert not add_ambient([ob], OUTPUT).changed
    assert render(ob, 4).max() > 0.0
    for made in [ob for ob in bpy.data.objects if ob.type == "CAMERA"]:
        bpy.data.cameras.remove(made.data)
    remove_ambient([ob])
    assert file_state() == before


def test_the_stand_in_looks_like_what_it_replaces():
    """0.8 grey for nothing: without ambient light, renders before and after differ by their noise only."""
    ob = baked_floor()
    ob.data.materials.clear()
    ob.data.attributes[FACE_LAYER].data.foreach_set("color", np.zeros(64, np.float32))
    before = [render(ob, 64, seed).mean() for seed in range(4)]
    add_ambient([ob], OUTPUT)
    after = [render(ob, 64, seed).mean() for seed in range(4)]
    noise = np.hypot(np.std(before, ddof=1), np.std(after, ddof=1)) / 2.0
    assert abs(np.mean(after) - np.mean(before)) < 7.0 * noise + 1e-5  # Student's t with 6 degrees of freedom
    assert noise < 0.01 * np.mean(before)


def test_baking_again_does_not_see_what_was_added():
    """Neither as light nor as colour."""
    ob = baked_floor()
    first = colors(ob).copy()
    add_ambient([ob], OUTPUT)
    report = bake(ob, quantity="AMBIENT", rays=64)
    np.testing.assert_array_equal(colors(ob), first)
    assert not [w for w in report.warnings if "Material" in w]


def test_another_attribute_takes_the_place_of_the_first():
    ob = baked_floor()
    add_ambient([ob], OUTPUT)
    bake(ob, quantity="AMBIENT", attribute_name="Shade")
    assert add_ambient([ob], OutputSettings(attribute_name="Shade")).changed
    (node,) = group_nodes(ob.data.materials[0])
    assert [n.attribute_name for n in node.node_tree.nodes if n.bl_idname == "ShaderNodeAttribute"] == ["Shade"]
    remove_ambient([ob])
    assert not [m for m in bpy.data.materials if group_nodes(m)]


def test_objects_that_are_not_baked_are_passed_over():
    ob, other = baked_floor(), cube("Other", color=(1, 0, 0))
    add_ambient([ob, other], OUTPUT)
    assert not shows_ambient(other)
    with pytest.raises(
        ObscuranceError, match="is on the faces of no selected object: set the quantity to Ambient Light"
    ):
        add_ambient([other], OUTPUT)


@pytest.mark.parametrize("quantity", ["OBSCURANCE", "DIRECT", "COMBINED", "RADIOSITY"])
def test_what_is_not_ambient_light_is_refused(quantity):
    """By what was baked, whatever the settings say now."""
    ob = baked_floor()
    bake(ob, quantity=quantity)
    bpy.context.scene.obscurance.quantity = "AMBIENT"
    with pytest.raises(ObscuranceError, match="holds no ambient light: set the quantity to Ambient Light and bake"):
        add_ambient([ob], OUTPUT)
    bake(ob, quantity="RADIOSITY", indirect_only=True)
    bpy.context.scene.obscurance.quantity = "DIRECT"
    assert add_ambient([ob], OUTPUT).changed


def test_objects_of_other_exposure_keep_theirs():
    """Two objects, two materials, two exposures: each is shown as bright as it is."""
    one, two = baked_floor(), floor("Two", color=(0.3, 0.3, 0.3), z=-1.0)
    bake(one, quantity="AMBIENT", exposure=2.0)
    bake(two, quantity="AMBIENT")
    add_ambient([one, two], OUTPUT)
    strengths = {
        ob.name: {
            n.inputs[1].default_value for n in group_nodes(ob.data.materials[0])[0].node_tree.nodes if n.type == "MATH"
        }
        for ob in (one, two)
    }
    assert 0.25 in strengths["Floor"]
    assert 1.0 in strengths["Two"]


def test_nodes_behind_the_group_do_not_make_it_two():
    """A user may put a reroute between the group and the output."""
    ob = baked_floor()
    add_ambient([ob], OUTPUT)
    tree = ob.data.materials[0].node_tree
    (node,) = group_nodes(ob.data.materials[0])
    target = node.outputs[0].links[0].to_socket
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(node.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], target)
    assert not add_ambient([ob], OUTPUT).changed
    assert len(group_nodes(ob.data.materials[0])) == 1


def test_stand_ins_of_several_objects_go_one_by_one():
    """Taking ambient light from one object leaves the other's."""
    one, two = baked_floor(), floor("Two", z=-1.0)
    one.data.materials.clear()
    before = file_state()
    bake(two, quantity="AMBIENT")
    add_ambient([one, two], OUTPUT)
    assert one.data.materials[0] == two.data.materials[0]
    assert remove_ambient([one]).objects == ["Floor"]
    assert shows_ambient(two)
    assert remove_ambient([two]).objects == ["Two"]
    after = file_state()
    assert after["materials"] == before["materials"]
    assert after["groups"] == before["groups"]
    assert not two.material_slots


def test_materials_of_libraries_are_named(tmp_path):
    path = str(tmp_path / "library.blend")
    mat = material("Theirs", (0.2, 0.4, 0.6))
    mat.use_fake_user = True
    bpy.data.libraries.write(path, {mat})
    bpy.data.materials.remove(mat)
    ob = baked_floor()
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.materials = ["Theirs"]
    ob.data.materials[0] = wanted.materials[0]
    change = add_ambient([ob], OUTPUT)
    assert [note for note in change.notes if "'Theirs'" in note and "Make Local" in note]
    assert not shows_ambient(ob)
    assert not change.changed
    assert not change.objects
    assert not bpy.data.node_groups


def test_operator():
    """Adds, does nothing the second time, removes; refuses what would count lamps twice."""
    ob = baked_floor()
    select(ob)
    operator = bpy.ops.obscurance.apply_in_materials
    bake(ob)
    with pytest.raises(RuntimeError, match="set the quantity to Ambient Light and bake"):
        operator(action="ADD")
    bake(ob, quantity="AMBIENT")
    assert operator(action="ADD") == {"FINISHED"}
    assert shows_ambient(ob)
    assert operator(action="ADD") == {"CANCELLED"}
    assert operator(action="REMOVE") == {"FINISHED"}
    assert not shows_ambient(ob)
    assert GROUP_NAME not in bpy.data.node_groups
    assert operator(action="REMOVE") == {"CANCELLED"}
