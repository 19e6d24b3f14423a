"""Scenes in which nothing can be baked, or not everything: the messages name the objects and the cure."""

import bpy
import pytest

from obscurance_addon.blender.reading.left_out import shape_reason
from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.blender.reading.visibility import rendered_meshes
from obscurance_addon.core.errors import ObscuranceError
from tests.blender.helpers import bake, cube, floor, job, new_object, notes_about, select

pytestmark = pytest.mark.usefixtures("empty_scene")


def link(name, data):
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    return made


def words():
    link("Words", bpy.data.curves.new("Words", "FONT"))


def instance_of_a_collection():
    furniture = bpy.data.collections.new("Furniture")
    chair = cube("Chair")
    bpy.context.scene.collection.objects.unlink(chair)
    furniture.objects.link(chair)
    made = link("Furniture here", None)
    made.instance_type, made.instance_collection = "COLLECTION", furniture


def in_another_scene():
    ob = floor()
    bpy.context.scene.collection.objects.unlink(ob)
    bpy.data.scenes.new("Game").collection.objects.link(ob)


def geometry_nodes(name, *kinds):
    """An object whose modifier replaces its mesh by what a chain of nodes makes."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    *chain, end = [tree.nodes.new(kind) for kind in (*kinds, "NodeGroupOutput")]
    for one, following in zip(chain, [*chain[1:], end], strict=True):
        tree.links.new(one.outputs[0], following.inputs[0])
    ob = floor(name)
    ob.modifiers.new("Nodes", "NODES").node_group = tree
    return ob, tree, chain


def only_instances():
    _ob, tree, chain = geometry_nodes("Scatter", "GeometryNodePoints", "GeometryNodeInstanceOnPoints")
    box = tree.nodes.new("GeometryNodeMeshCube")
    tree.links.new(box.outputs[0], chain[1].inputs["Instance"])


def only_points():
    geometry_nodes("Dust", "GeometryNodePoints")


def only_by_modifiers():
    ob = new_object("Skin", [(0, 0, 0), (1, 0, 0)], [])
    ob.data.edges.add(1)
    ob.data.edges[0].vertices = (0, 1)
    ob.modifiers.new("Screw", "SCREW")


def in_a_collection(**switches):
    """An object in a collection of its own, whose switches are set on the collection, or in the view layer."""
    holder = bpy.data.collections.new("Backup")
    bpy.context.scene.collection.children.link(holder)
    floor("Kept", collection=holder)
    layer = bpy.context.view_layer.layer_collection.children["Backup"]
    for name, value in switches.items():
        setattr(layer if hasattr(layer, name) and name != "hide_viewport" else holder, name, value)


def hidden_from_renders():
    floor("Kept").hide_render = True


def disabled_in_viewports():
    floor("Kept").hide_viewport = True


def hidden_in_the_viewport():
    floor("Kept").hide_set(True)


CASES = {
    words: ("'Words'", "Object > Convert > Mesh"),
    instance_of_a_collection: ("'Furniture here'", "Make Instances Real"),
    in_another_scene: ("'Game'", "--scene"),
    only_instances: ("'Scatter'", "Realize Instances"),
    only_points: ("'Dust'", "left without faces by modifiers", "disable the modifier"),
    only_by_modifiers: ("'Skin'", "apply the modifiers"),
    lambda: in_a_collection(exclude=True): ("'Kept'", "excluded from the view layer", "tick the collection"),
    lambda: in_a_collection(hide_render=True): ("'Kept'", "collections hidden from renders", "camera icon"),
    hidden_from_renders: ("'Kept'", "hidden from renders", "camera icon"),
    lambda: new_object("Wire", [(0, 0, 0), (1, 0, 0)], []): ("'Wire'", "without faces", "Face > Fill"),
    lambda: None: ("no mesh object with faces in scene 'Scene'", "choose or add one"),
}


@pytest.mark.parametrize("build", CASES, ids=[build.__name__ for build in CASES])
def test_nothing_to_bake_names_objects_and_cure(build):
    """What the command line does without --objects, and says."""
    build()
    bpy.context.view_layer.update()
    with pytest.raises(ObscuranceError, match=r"^there is nothing to bake") as told:
        job(*rendered_meshes(bpy.context))
    assert notes_about([str(told.value)], *CASES[build])


HIDDEN = {
    lambda: in_a_collection(hide_viewport=True): ("'Kept'", "collections hidden in the viewport", "eye and monitor"),
    disabled_in_viewports: ("'Kept'", "disabled in viewports", "monitor icon"),
    hidden_in_the_viewport: ("'Kept'", "hidden in the viewport", "Show Hidden Objects"),
}


@pytest.mark.parametrize("build", HIDDEN, ids=[build.__name__ for build in HIDDEN])
def test_what_follows_the_viewport_says_what_it_hides(build):
    """A bake shows what renders for as long as it reads; what is given a depsgraph, as Live Preview is, cannot."""
    build()
    bpy.context.view_layer.update()
    meshes = rendered_meshes(bpy.context)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    with pytest.raises(ObscuranceError, match=r"^there is nothing to bake") as told:
        snapshot_scene(bpy.context, meshes, depsgraph=depsgraph)
    assert notes_about([str(told.value)], *HIDDEN[build])
    assert bake(*meshes).objects == ["Kept"]


def test_the_button_says_the_same():
    """The selected object alone is named."""
    hidden_from_renders()
    words()
    select(bpy.data.objects["Kept"])
    with pytest.raises(RuntimeError, match=r"(?i)there is nothing to bake.*hidden from renders: 'Kept'; switch on"):
        bpy.ops.obscurance.bake()


def test_objects_beside_others_are_noted_with_the_cure():
    """Each kind is one note, and the rest is baked."""
    ob = floor()
    two = [link(f"Words {i}", bpy.data.curves.new("Words", "FONT")) for i in range(2)]
    wire = new_object("Wire", [(0, 0, 0), (1, 0, 0)], [])
    report = bake(ob, *two, wire)
    assert report.objects == ["Floor"]
    assert len(notes_about(report.warnings, "nothing was baked onto", "'Words 0', 'Words 1'", "Convert > Mesh")) == 1
    assert len(notes_about(report.warnings, "nothing was baked onto", "'Wire'", "Face > Fill")) == 1


def test_lamps_are_named_when_they_are_asked_for():
    lamp = link("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    assert shape_reason(lamp).what == "not a mesh"
    with pytest.raises(ObscuranceError, match="'Lamp'; choose mesh objects"):
        job(lamp)


@pytest.mark.parametrize(("scale", "axes"), [((1, 1, 0), "one axis"), ((1, 0, 0), "two axes"), ((0, 0, 0), "all axes")])
def test_a_scale_of_zero_is_said(scale, axes):
    """Of a cube, beside others and as an occluder; a plane that is flat anyway loses nothing along its normal."""
    ob, flat = floor(), cube("Flat")
    flat.scale = scale
    told = ("'Flat'", f"0 along {axes}", "set the scale")
    assert notes_about(bake(ob, flat).warnings, *told)
    assert notes_about(bake(ob).warnings, *told)
    ob.scale = (1, 1, 0)
    assert not notes_about(bake(ob).warnings, "'Floor'", "0 along")


def test_missing_libraries_are_noted(tmp_path):
    """The object that is left out, and the material that is grey, with the file that they came from."""
    wall = cube("Wall")
    wall.data.materials.append(bpy.data.materials.new("Paint"))
    library, main = tmp_path / "library.blend", tmp_path / "main.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    ob = floor()
    with bpy.data.libraries.load(str(library), link=True) as (_there, wanted):
        wanted.objects, wanted.materials = ["Wall"], ["Paint"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    ob.data.materials.append(wanted.materials[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(main))
    library.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(main))
    warnings = bake(bpy.data.objects["Floor"]).warnings
    assert notes_about(warnings, "'Wall'", "left out", "library.blend", "Relocate")
    assert notes_about(warnings, "'Paint'", "grey", "library.blend", "Relocate")
