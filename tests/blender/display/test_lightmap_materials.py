"""Lightmaps in materials: added as ambient light, read back as white, shown in a viewport and taken back."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.display import viewport_shading
from obscurance_addon.blender.display.ambient_nodes import add_ambient, remove_ambient, shows_ambient
from obscurance_addon.blender.display.viewport_shading import activate_result, hide_result, lightmaps_are_shown
from obscurance_addon.blender.marks import MADE_HERE
from obscurance_addon.blender.writing.image import stage
from obscurance_addon.blender.writing.records import INDIRECT, claim, remember
from obscurance_addon.core.errors import ObscuranceError
from obscurance_addon.core.order.output import OutputSettings, Target
from tests.blender.display.test_ambient_nodes import baked_floor, file_state, group_nodes, render
from tests.blender.helpers import FACE_LAYER, bake, colors, floor, material, read, select
from tests.blender.materials.material_helpers import COLOR, Tree, close, make_image, quads, reflectance_of

pytestmark = pytest.mark.usefixtures("empty_scene")

OUTPUT = OutputSettings(target=Target.LIGHTMAP)
RED, GREEN = (2.0, 0.25, 0.125), (0.0, 1.0, 0.0)  # exact in half floats; one brighter than white


def page(left=RED, right=None):
    """A page of 8 x 8 texels, of one colour or of two halves."""
    texels = np.ones((8, 8, 4), np.float32)
    texels[..., :3] = left
    if right is not None:
        texels[:, 4:, :3] = right
    return texels


def lightmapped(ob=None, pages=None, name="Obscurance", stored=INDIRECT, exposure=0.0, uv_map="Obscurance"):
    """An object whose own UV map of 0 .. 1 looks up an image that a bake might have made."""
    ob = ob or floor(n=1, color=(0.0, 0.0, 0.0))
    mesh = ob.data
    if uv_map not in mesh.uv_layers:
        mesh.uv_layers.new(name=uv_map, do_init=False)
    points = read(mesh, "position")[[loop.vertex_index for loop in mesh.loops]][:, :2]
    mesh.uv_layers[uv_map].uv.foreach_set("vector", ((points + 1.0) / 2.0).astype(np.float32).ravel())
    image = stage(pages or [page()], name, "", "EXR_HALF").land()
    if name == uv_map:
        claim(mesh, name)
    remember(mesh, name, stored, exposure, image, uv_map)
    return ob


def only(kind, tree):
    """The one node of a kind."""
    (node,) = [n for n in tree.nodes if n.bl_idname == kind]
    return node


# ------------------------------------------------------------------------------------------------------ in materials


def test_a_render_shows_the_lightmap_as_it_is():
    """Each pixel is 16 x 16 of one colour, to rounding; the border of the page does not see the other border."""
    ob = lightmapped(pages=[page(RED, GREEN)])
    assert add_ambient([ob], OUTPUT).objects == ["Floor"]
    picture = render(ob, 4)
    for columns, expected in ((slice(0, 7), RED), (slice(9, 16), GREEN)):
        np.testing.assert_allclose(picture[:, columns], np.broadcast_to(expected, (16, 7, 3)), rtol=1e-3, atol=1e-5)
    assert not add_ambient([ob], OUTPUT).changed


def test_exposure_is_taken_back():
    """What was stored two stops brighter is shown four times darker."""
    ob = lightmapped(exposure=2.0)
    add_ambient([ob], OUTPUT)
    np.testing.assert_allclose(render(ob, 1), np.broadcast_to(np.divide(RED, 4.0), (16, 16, 3)), rtol=1e-4)


def test_tiles_are_shown_each_on_its_own_faces():
    """An image of two pages, the second over UVs of 1 .. 2."""
    ob = lightmapped(pages=[page(RED), page(GREEN)])
    uv = ob.data.uv_layers["Obscurance"].uv
    uv.foreach_set("vector", (read(ob.data, "Obscurance") * (2.0, 1.0)).astype(np.float32).ravel())
    add_ambient([ob], OUTPUT)
    picture = render(ob, 4)
    np.testing.assert_allclose(picture[:, :7], np.broadcast_to(RED, (16, 7, 3)), rtol=1e-3)
    np.testing.assert_allclose(picture[:, 9:], np.broadcast_to(GREEN, (16, 7, 3)), rtol=1e-3, atol=1e-5)


def test_an_object_without_the_uv_map_shows_nothing_of_it():
    """It shares the material; all of it would look up one corner of the image."""
    ob, other = lightmapped(), floor("Other", z=0.5)
    other.data.materials.append(ob.data.materials[0])
    add_ambient([ob], OUTPUT)
    assert not render(other, 1).any()


def test_removed_without_a_trace():
    """Nodes, groups, slots and stand-ins, with and without a material."""
    ob, bare = lightmapped(), lightmapped(floor("Bare", z=-1.0))
    before = file_state()
    assert add_ambient([ob, bare], OUTPUT).objects == ["Floor", "Bare"]
    assert shows_ambient(bare)
    assert remove_ambient([ob, bare]).changed
    assert file_state() == before


def test_attribute_and_lightmap_take_each_others_place():
    """In the same node, without leaving a group behind; a bake of either kind is what is shown then."""
    ob = baked_floor()
    add_ambient([ob], OutputSettings())
    (node,) = group_nodes(ob.data.materials[0])
    ob.data.attributes.remove(ob.data.attributes[FACE_LAYER])
    lightmapped(ob)
    assert add_ambient([ob], OUTPUT).changed
    assert [node] == group_nodes(ob.data.materials[0])
    assert only("ShaderNodeTexImage", node.node_tree).image.name == "Obscurance"
    assert only("ShaderNodeUVMap", node.node_tree).uv_map == "Obscurance"
    assert len(bpy.data.node_groups) == 1
    bake(ob, quantity="AMBIENT", rays=16)
    assert add_ambient([ob], OutputSettings()).changed
    assert [node] == group_nodes(ob.data.materials[0])
    assert only("ShaderNodeAttribute", node.node_tree).attribute_name == FACE_LAYER
    assert len(bpy.data.node_groups) == 1


def test_each_image_and_uv_map_has_a_group_of_its_own():
    """Objects with the same image and UV map share one."""
    one, two, three = lightmapped(), lightmapped(floor("Two", color=GREEN)), lightmapped(floor("Three", color=RED))
    lightmapped(three, uv_map="Mine")
    add_ambient([one, two, three], OUTPUT)
    groups = [group_nodes(ob.data.materials[0])[0].node_tree for ob in (one, two, three)]
    assert groups[0] == groups[1] != groups[2]
    assert {only("ShaderNodeUVMap", tree).uv_map for tree in groups} == {"Obscurance", "Mine"}


def test_a_material_of_objects_that_differ_shows_the_first_and_is_named():
    """One material cannot look up two UV maps; pressing again changes nothing."""
    one, two = lightmapped(), lightmapped(floor("Two"), uv_map="Mine")
    two.data.materials.append(one.data.materials[0])
    change = add_ambient([one, two], OUTPUT)
    assert [note for note in change.notes if "'Floor'" in note and "Single User" in note]
    assert only("ShaderNodeUVMap", group_nodes(one.data.materials[0])[0].node_tree).uv_map == "Obscurance"
    assert not add_ambient([one, two], OUTPUT).changed


@pytest.mark.parametrize(
    ("stored", "message"),
    [
        ("OBSCURANCE", "lightmap 'Obscurance' holds no ambient light: set the quantity to Ambient Light and bake"),
        (None, "lightmap 'Obscurance' belongs to no selected object: set the quantity to Ambient Light and bake"),
    ],
)
def test_what_is_no_ambient_light_is_refused(stored, message):
    ob = floor() if stored is None else lightmapped(stored=stored)
    with pytest.raises(ObscuranceError, match=message):
        add_ambient([ob], OUTPUT)


def test_colors_that_a_lightmap_has_replaced_are_refused():
    """The record of the name is that of the lightmap; what the attribute holds is not known any more."""
    ob = baked_floor()
    lightmapped(ob, uv_map="Mine")
    with pytest.raises(ObscuranceError, match="attribute 'Obscurance' holds no ambient light"):
        add_ambient([ob], OutputSettings())


def test_baking_again_does_not_see_what_was_added():
    """Neither as light nor as colour."""
    ob = baked_floor()
    first = colors(ob).copy()
    lightmapped(ob, name="Map", uv_map="Map")
    assert add_ambient([ob], OutputSettings(target=Target.LIGHTMAP, attribute_name="Map")).changed
    report = bake(ob, quantity="AMBIENT", rays=64)
    np.testing.assert_array_equal(colors(ob), first)
    assert not [w for w in report.warnings if "Material" in w]


# --------------------------------------------------------------------------------------------------- read by materials


@pytest.mark.parametrize("output", ["Color", "Alpha"])
def test_our_own_images_are_read_as_white(output):
    """A darkening lightmap that multiplies the base colour must not darken the next bake."""
    tree, notes = Tree(), []
    texels = page((0.25, 0.25, 0.25))
    texels[..., 3] = 0.5
    image = stage([texels], "Obscurance", "", "EXR_HALF").land()
    node = tree.image(image)
    mix = tree.node(
        "ShaderNodeMixRGB", {"Fac": 1.0, "Color1": (*COLOR, 1.0), "Color2": node.outputs[output]}, blend_type="MULTIPLY"
    )
    tree.diffuse(mix.outputs[0])
    mesh = quads((0, 0, 1, 1))
    close(reflectance_of(tree, mesh, notes), COLOR)
    assert not notes
    del image[MADE_HERE]
    assert reflectance_of(tree, mesh).max() < 0.51 * max(COLOR)


# -------------------------------------------------------------------------------------------------------------- showing


def workbench():
    """The colour in the middle of a picture from above, as Solid shading with "Texture" and flat light shows it."""
    scene = bpy.context.scene
    scene.display.shading.light, scene.display.shading.color_type = "FLAT", "TEXTURE"
    scene.view_settings.view_transform = "Standard"
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 1.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.collection.objects.link(scene.camera)
    scene.camera.location = (0.0, 0.0, 5.0)
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = bpy.app.tempdir + "solid.exr"
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError as error:
        pytest.skip(f"Workbench needs OpenGL, which there is none of: {error}")
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(8, 8, 4)
    bpy.data.images.remove(image)
    bpy.data.cameras.remove(camera)
    return pixels[4, 4, :3]


@pytest.fixture
def view():
    """A 3D view of a window that nobody sees, over an empty scene, for lightmaps."""
    bpy.ops.wm.read_factory_settings()
    for ob in list(bpy.data.objects):
        bpy.data.objects.remove(ob)
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.images):
        for block in list(kind):
            kind.remove(block)
    bpy.context.scene.obscurance.target = "LIGHTMAP"
    return next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")


def press(area):
    """Show Result in one view."""
    override = {"window": bpy.context.window_manager.windows[0], "area": area, "space_data": area.spaces.active}
    with bpy.context.temp_override(**override):
        return bpy.ops.obscurance.show_result()


def look(area):
    shading = area.spaces.active.shading
    return shading.type, shading.light, shading.color_type


def shown_textures():
    """Which node each material shows, and which is active."""
    return {
        m.name: ([n.name for n in m.node_tree.nodes if n.show_texture], getattr(m.node_tree.nodes.active, "name", None))
        for m in bpy.data.materials
        if m.node_tree
    }


def two_textures(mat):
    """A material in which the user looks at one texture and works on another node."""
    nodes = mat.node_tree.nodes
    for name in ("First", "Second"):
        node = nodes.new("ShaderNodeTexImage")
        node.name = name
        node.image = make_image(np.full((4, 4, 3), GREEN))
        nodes.active = node
    nodes.active = nodes["Principled BSDF"]


def scene_to_show():
    """An object with textures and two UV maps of the user's, one without slots, one with an empty slot."""
    ob = floor(n=1, color=(0.5, 0.5, 0.5))
    two_textures(ob.data.materials[0])
    for name in ("One", "Two"):
        ob.data.uv_layers.new(name=name)
    lightmapped(ob)
    ob.data.uv_layers.active = ob.data.uv_layers["Two"]
    bare, empty = lightmapped(floor("Bare", z=-1.0)), lightmapped(floor("Empty", z=-2.0))
    empty.data.materials.append(None)
    select(ob)
    return ob, bare, empty


def whole_state():
    return file_state(), shown_textures()


def test_the_view_shows_the_lightmap_and_goes_back(view):
    """Whatever the objects have for materials; then all is as it was, to the node that was shown."""
    objects = scene_to_show()
    before, usual = whole_state(), look(view)
    assert press(view) == {"FINISHED"}
    assert look(view) == ("SOLID", "FLAT", "TEXTURE")
    assert [ob.data.uv_layers.active.name for ob in objects] == ["Obscurance"] * 3
    assert [uv.name for uv in objects[0].data.uv_layers if uv.active_render] == ["One"]
    assert {shown[0] for shown, _ in shown_textures().values()} == {"Obscurance Result"}
    assert press(view) == {"FINISHED"}
    assert look(view) == usual
    assert whole_state() == before


def test_solid_shading_draws_the_lightmap(view):
    """In Blender's own picture of it: each object, also after a bake has updated the image, and the former texture."""
    objects = scene_to_show()
    usual = workbench()
    press(view)
    for color in (RED, GREEN):
        stage([page(color)], "Obscurance", "", "EXR_HALF").land()
        for ob in objects:
            for other in objects:
                other.hide_render = other != ob
            np.testing.assert_allclose(workbench(), color, atol=0.02)
    press(view)
    for ob in objects:
        ob.hide_render = False
    np.testing.assert_array_equal(workbench(), usual)


def test_the_bake_does_not_see_that_it_is_shown(view):
    """Neither the stand-ins nor the nodes."""
    objects = scene_to_show()
    bake(*objects, attribute_name="Values")
    first = [colors(ob, "Values") for ob in objects]
    press(view)
    bake(*objects, attribute_name="Values")
    for ob, values in zip(objects, first, strict=True):
        np.testing.assert_array_equal(colors(ob, "Values"), values)


def test_a_file_saved_while_shown_can_be_put_right_later(view, tmp_path):
    """Nothing but the file remembers."""
    scene_to_show()
    before = whole_state()
    press(view)
    path = str(tmp_path / "shown.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    assert not viewport_shading._before
    assert lightmaps_are_shown()
    area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
    if look(area) != ("SOLID", "FLAT", "TEXTURE"):  # without a window, Blender may not load the user interface
        press(area)
    press(area)
    assert look(area) != ("SOLID", "FLAT", "TEXTURE")
    assert whole_state() == before


def test_the_last_view_takes_it_back(view):
    """Hiding in one of two views leaves it to the other."""
    scene_to_show()
    other = next(
        area
        for screen in bpy.data.screens
        for area in screen.areas
        if area.type == "VIEW_3D" and area.spaces.active != view.spaces.active
    )
    before = whole_state()
    press(view)
    viewport_shading.show_result(other.spaces.active, Target.LIGHTMAP)
    press(view)
    assert lightmaps_are_shown()
    assert hide_result(other.spaces.active)
    assert whole_state() == before


def test_a_view_of_textures_of_ones_own_shows_no_result(view):
    """As nothing was asked for: Show Result shows, and Hide Result leads back there."""
    scene_to_show()
    shading = view.spaces.active.shading
    shading.light, shading.color_type = "FLAT", "TEXTURE"
    assert not viewport_shading.shows_result(view.spaces.active)
    press(view)
    assert lightmaps_are_shown()
    press(view)
    assert look(view) == ("SOLID", "FLAT", "TEXTURE")
    assert not lightmaps_are_shown()


def test_showing_and_applying_in_any_order(view):
    """Stand-ins stay as long as either needs them, and not longer."""
    objects = scene_to_show()
    before = whole_state()
    press(view)
    add_ambient(objects, OUTPUT)
    press(view)
    assert all(map(shows_ambient, objects))
    remove_ambient(objects)
    assert whole_state() == before
    press(view)
    assert not remove_ambient(objects).changed
    assert all(slot.material for ob in objects for slot in ob.material_slots)
    press(view)
    assert whole_state() == before


def test_materials_of_libraries_are_named(view, tmp_path):
    """They cannot show it; alone they are nothing to show, and the UV map stays."""
    path = str(tmp_path / "library.blend")
    mat = material("Theirs", (0.2, 0.4, 0.6))
    bpy.data.libraries.write(path, {mat}, fake_user=True)
    bpy.data.materials.remove(mat)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.materials = ["Theirs"]
    ob = floor()
    ob.data.uv_layers.new(name="Mine")
    lightmapped(ob)
    ob.data.uv_layers.active = ob.data.uv_layers["Mine"]
    ob.data.materials.append(wanted.materials[0])
    before = whole_state()
    result = activate_result([ob], OUTPUT)
    assert (result.count, result.changed) == (0, False)
    assert [note for note in result.notes if "'Theirs'" in note and "Make Local" in note]
    assert whole_state() == before


def test_there_must_be_a_lightmap_to_show(view):
    """The message says how to get one, and the shading stays."""
    floor()
    before = look(view)
    with pytest.raises(RuntimeError, match="No object in this view layer has a lightmap 'Obscurance' to show: bake fi"):
        press(view)
    assert look(view) == before


def test_in_edit_mode_too(view):
    """The mode is what it was, after showing and after hiding."""
    ob, *_ = scene_to_show()
    bpy.ops.object.mode_set(mode="EDIT")  # which by itself adds selection layers to the mesh
    bpy.ops.object.mode_set(mode="OBJECT")
    before = whole_state()
    for shown in (True, False):
        bpy.ops.object.mode_set(mode="EDIT")
        press(view)
        assert ob.mode == "EDIT"
        assert lightmaps_are_shown() is shown
        bpy.ops.object.mode_set(mode="OBJECT")
    assert whole_state() == before
