"""Values of modified meshes come back to the unmodified faces that the evaluated ones came from."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs import BakeJob
from obscurance_addon.blender.reading import origins
from obscurance_addon.blender.writing.layers import AttributeNameError
from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.lightmap import LightmapSettings
from obscurance_addon.core.order import OutputSettings
from obscurance_addon.core.settings import BakeSettings
from tests.blender.helpers import (
    FACE_LAYER,
    arrays,
    bake,
    baked,
    colors,
    cube,
    element_areas,
    floor,
    job,
    material,
    mean_over_seeds,
    mesh_state,
    notes_about,
    sheet,
)
from tests.core.closed_forms import planes

pytestmark = pytest.mark.usefixtures("empty_scene")
CORNERED = ["FACE", "CORNER", "POINT"]


def subdivide(ob):
    modifier = ob.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels = "SIMPLE", 2


def repeat(ob):
    modifier = ob.modifiers.new("Array", "ARRAY")
    modifier.count, modifier.relative_offset_displace = 3, (2.0, 0.0, 0.0)


def mirror(ob):
    modifier = ob.modifiers.new("Mirror", "MIRROR")
    centre = bpy.data.objects.new("Centre", None)
    centre.location = (10.0, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(centre)
    modifier.mirror_object = centre


def solidify(ob):
    modifier = ob.modifiers.new("Solidify", "SOLIDIFY")
    modifier.thickness, modifier.use_rim = 0.25, False


def triangulate(ob):
    ob.modifiers.new("Triangulate", "TRIANGULATE")


def decimate(ob):
    modifier = ob.modifiers.new("Decimate", "DECIMATE")
    modifier.decimate_type, modifier.iterations = "UNSUBDIV", 0


def nothing(_ob):
    pass


@pytest.mark.parametrize("target", CORNERED)
@pytest.mark.parametrize(("modify", "copies"), [(nothing, 1), (subdivide, 1), (repeat, 3), (mirror, 2), (solidify, 2)])
def test_each_element_owns_the_surface_that_came_from_it(modify, copies, target):
    """On a 4 x 2 grid of unlike faces, areas behind faces, corners and vertices are those before times the copies."""
    ob = sheet("Sheet", (0, 0, 0), (4, 0, 0), (0, 6, 0), 4, 2)
    for polygon in ob.data.polygons:
        polygon.use_smooth = True
    plain = element_areas(arrays(ob, target=target))
    modify(ob)
    assert np.allclose(element_areas(arrays(ob, target=target)), copies * plain, rtol=1e-5)


@pytest.mark.parametrize("target", CORNERED)
def test_triangulated_faces_belong_to_their_elements(target):
    """Faces own the same as before; corners and vertices own the thirds of the triangles that they are corners of."""
    ob = floor(size=2.0)
    triangulate(ob)
    found = sorted(element_areas(arrays(ob, target=target)))
    third = 2.0 / 3.0
    assert np.allclose(found, [4.0] if target == "FACE" else [third, third, 2.0 * third, 2.0 * third])


@pytest.mark.parametrize("target", CORNERED)
def test_subdivided_parts_go_to_the_corner_they_lie_at(target):
    """Each cell of a finely subdivided face lies in the quarter of the face around its own corner."""
    ob = floor(size=2.0)
    subdivide(ob)
    made = arrays(ob, target=target)
    assert made.patches.corners[..., :2].min() == pytest.approx(-1.0)
    assert made.patches.corners[..., :2].max() == pytest.approx(1.0)
    if target == "FACE":
        assert made.ranges[0].element_patch.tolist() == [0]
        return
    centres = made.patches.corners.mean(1)[:, :2]
    loops = ob.data.loops if target == "CORNER" else ob.data.vertices
    at = np.array([ob.data.vertices[x.vertex_index if target == "CORNER" else x.index].co[:2] for x in loops])
    assert (np.sign(centres) == np.sign(at[np.argsort(made.ranges[0].element_patch)][made.patches.patch])).all()


def test_bevelled_cubes_lose_no_surface():
    """All faces of a bevelled cube came from its six; together they own its whole area."""
    ob = cube()
    modifier = ob.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments = 0.2, 2
    evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    evaluated.calc_loop_triangles()
    total = sum(triangle.area for triangle in evaluated.loop_triangles)
    assert len(evaluated.polygons) > 6
    for target in CORNERED:
        made = arrays(ob, target=target)
        unique = np.unique(made.ranges[0].element_patch, return_index=True)[1]
        assert element_areas(made)[unique].sum() == pytest.approx(total, rel=1e-5)
        assert (element_areas(made) > 0.0).all()


@pytest.mark.parametrize("target", CORNERED)
def test_decimated_faces_that_vanish_take_their_neighbours_value(target):
    """A flat grid dissolved into one face bakes as open on all of its faces, with as many values as it has elements."""
    ob = floor(n=4)
    modifier = ob.modifiers.new("Decimate", "DECIMATE")
    modifier.decimate_type, modifier.angle_limit = "DISSOLVE", 0.1
    assert len(ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons) == 1
    values = baked(ob, target=target)
    assert len(values) == {"FACE": 16, "CORNER": 64, "POINT": 25}[target]
    assert np.allclose(values, 1.0, atol=1e-6)


def test_a_collapsed_mesh_keeps_its_area():
    """Decimate (Collapse) to half of the triangles of a flat grid: the rest still covers it and belongs to it."""
    ob = floor(n=6)
    ob.modifiers.new("Decimate", "DECIMATE").ratio = 0.5
    made = arrays(ob)
    assert element_areas(made).sum() == pytest.approx(4.0, rel=1e-5)
    assert len(made.patches.corners) < 72


def boolean(ob, cutter):
    modifier = ob.modifiers.new("Boolean", "BOOLEAN")
    modifier.object, modifier.operation, modifier.solver = cutter, "DIFFERENCE", "EXACT"
    cutter.hide_render = True


@pytest.mark.parametrize("cutter_is_modified", [False, True])
def test_cutter_faces_belong_to_nobody(cutter_is_modified):
    """A notch of 1 x 1 x 1 in a corner of a cube: three faces lose 1 each, and the walls of the notch are nobody's.

    Also when the cutter is baked itself and has modifiers of its own, so that it carries indices too.
    """
    ob, cutter = cube(), cube("Cutter")
    cutter.location = (1.0, 1.0, 1.0)
    cutter.scale = (1.0, 1.0, 1.0)
    boolean(ob, cutter)
    others = []
    if cutter_is_modified:
        cutter.hide_render = False
        triangulate(cutter)
        others = [cutter]
    made = arrays(ob, *others)
    assert np.allclose(element_areas(made), [4.0, 3.0, 4.0, 3.0, 4.0, 3.0], rtol=1e-5)
    assert len(made.surfaces.triangles) > len(made.patches.corners) - 12 * len(others)


@pytest.mark.parametrize("target", CORNERED)
@pytest.mark.parametrize("depth", [1, 3])
def test_remeshed_objects_are_baked_unmodified_and_said_so(target, depth):
    """Remesh loses the faces: areas, order and number are those of the unmodified cube, even where it makes six too."""
    ob = cube(half=1.0)
    plain = arrays(ob, target=target)
    modifier = ob.modifiers.new("Remesh", "REMESH")
    modifier.mode, modifier.octree_depth, modifier.scale = "BLOCKS", depth, 0.5
    evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert (len(evaluated.polygons) == 6) == (depth == 1)
    made = arrays(ob, target=target)
    assert np.array_equal(made.patches.corners, plain.patches.corners)
    report = bake(ob, target=target)
    assert notes_about(report.warnings, "'Cube'", "unmodified mesh was baked")
    assert np.allclose(colors(ob), 1.0, atol=1e-6)


def replace_by_a_block(ob, size, at):
    """Nodes that make a block of their own, whatever the mesh was."""
    tree = bpy.data.node_groups.new("Block", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    made, moved, end = (
        tree.nodes.new(kind) for kind in ("GeometryNodeMeshCube", "GeometryNodeTransform", "NodeGroupOutput")
    )
    made.inputs["Size"].default_value, moved.inputs["Translation"].default_value = size, at
    tree.links.new(made.outputs[0], moved.inputs[0])
    tree.links.new(moved.outputs[0], end.inputs[0])
    ob.modifiers.new("Nodes", "NODES").node_group = tree
    return made


def scatter_posts(ob, density=5.0):
    """Nodes that join a mesh with posts on it, whose faces are real."""
    tree = bpy.data.node_groups.new("Posts", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    source, points, post, copies, real, both, end = (
        tree.nodes.new(kind)
        for kind in (
            "NodeGroupInput",
            "GeometryNodeDistributePointsOnFaces",
            "GeometryNodeMeshCube",
            "GeometryNodeInstanceOnPoints",
            "GeometryNodeRealizeInstances",
            "GeometryNodeJoinGeometry",
            "NodeGroupOutput",
        )
    )
    points.inputs["Density"].default_value, post.inputs["Size"].default_value = density, (0.1, 0.1, 0.5)
    for one, other in (
        (source.outputs[0], points.inputs["Mesh"]),
        (points.outputs["Points"], copies.inputs["Points"]),
        (post.outputs[0], copies.inputs["Instance"]),
        (copies.outputs[0], real.inputs[0]),
        (real.outputs[0], both.inputs[0]),
        (source.outputs[0], both.inputs[0]),
        (both.outputs[0], end.inputs[0]),
    ):
        tree.links.new(one, other)
    ob.modifiers.new("Posts", "NODES").node_group = tree


@pytest.mark.parametrize("target", CORNERED)
def test_what_is_scattered_on_a_mesh_is_not_part_of_it(target):
    """Posts, for which the flat ground cannot stand though they are low and within its bounds, darken it."""
    ob = floor(size=4.0, n=2)
    patches = arrays(ob, target=target).patches
    scatter_posts(ob)
    made = arrays(ob, target=target)
    assert np.array_equal(made.patches.corners, patches.corners)
    n_posts, rest = divmod(len(made.surfaces.triangles) - 8, 12)
    assert (n_posts > 20, rest) == (True, 0)
    assert baked(ob, target=target, rays=512).max() < 0.98


@pytest.mark.parametrize("target", CORNERED)
def test_what_nodes_make_elsewhere_occludes_others(target):
    """A floor below a block that nodes make of a small cube is as dark as below a mesh of that shape."""
    ground, ob = floor(size=8.0, n=4), cube("Small", half=0.1)
    ob.location = (-2.0, 0.0, 0.6)
    replace_by_a_block(ob, (4.0, 0.8, 0.8), (2.0, 0.0, 0.0))
    report = bake(ground, ob, target=target, distance=2.0)
    found = colors(ground)
    assert notes_about(report.warnings, "'Small'", "unmodified mesh was baked", "beside what they make elsewhere")
    stands = cube("Stands", half=1.0)
    stands.location, stands.scale = (0.0, 0.0, 0.6), (2.0, 0.4, 0.4)
    ob.modifiers.clear()
    expected = baked(ground, target=target, distance=2.0)
    assert expected.min() < 0.8
    assert np.allclose(found, expected, atol=1e-5)


def test_values_are_averaged_over_the_copies_of_a_face():
    """Of two copies of a face one lies open and one below a large ceiling: their mean, by the closed form."""
    ob = floor(size=1.0)
    modifier = ob.modifiers.new("Array", "ARRAY")
    modifier.count, modifier.use_relative_offset, modifier.use_constant_offset = 2, False, True
    modifier.constant_offset_displace = (20.0, 0.0, 0.0)
    ceiling = floor("Ceiling", size=6.0, z=0.25)
    ceiling.location.x = 20.0
    bpy.context.view_layer.update()
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, use_bleeding=False, rays=64, seed=seed)[0])
    assert (abs(mean - 0.5 * (1.0 + planes(Falloff.SQRT, 0.25))) <= tolerance).all()


def test_averages_weigh_by_area():
    """A copy of four times the area counts four times: open is the large one, below a ceiling the small one."""
    ob = floor(size=1.0)
    modifier = ob.modifiers.new("Array", "ARRAY")
    offset = bpy.data.objects.new("Offset", None)
    offset.location, offset.scale = (20.0, 0.0, 0.0), (2.0, 2.0, 2.0)
    bpy.context.scene.collection.objects.link(offset)
    modifier.count, modifier.use_relative_offset, modifier.use_object_offset = 2, False, True
    modifier.offset_object = offset
    floor("Ceiling", size=6.0, z=0.25)
    bpy.context.view_layer.update()
    assert element_areas(arrays(ob)) == pytest.approx([5.0])
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, use_bleeding=False, rays=64, seed=seed)[0])
    assert (abs(mean - (0.8 + 0.2 * planes(Falloff.SQRT, 0.25))) <= tolerance).all()


@pytest.mark.parametrize("target", CORNERED)
@pytest.mark.parametrize("modify", [subdivide, repeat, solidify, triangulate])
def test_nothing_carried_is_left_on_the_mesh(modify, target):
    """After reading, the mesh holds what it held, bit for bit."""
    ob = floor(n=3)
    modify(ob)
    before = mesh_state(ob.data)
    arrays(ob, target=target)
    assert mesh_state(ob.data) == before


@pytest.mark.parametrize("at", ["read_attribute", "EvaluatedMesh"])
def test_nothing_carried_is_left_when_reading_fails(monkeypatch, at):
    """Whatever breaks while indices ride along, neither the mesh nor the depsgraph's copy of it keeps them."""
    ob = floor(n=3)
    triangulate(ob)
    before = mesh_state(ob.data)

    def fails(*_arguments, **_keywords):
        raise MemoryError("no more")

    with monkeypatch.context() as patch:
        patch.setattr(origins, at, fails)
        with pytest.raises(MemoryError):
            job(ob, target="CORNER")
    assert mesh_state(ob.data) == before
    copy = mesh_state(ob.data.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    assert copy == before | {"users": copy["users"]}


@pytest.mark.parametrize("name", ["obscurance_face_index", "obscurance_rest_position"])
def test_an_attribute_of_the_users_is_not_taken_over(name):
    """What the user keeps under a name that a bake would use for itself stays, and changes nothing."""
    ob, twin = floor(n=3), floor("Twin", n=3)
    twin.location.x = 100.0
    for each in (ob, twin):
        triangulate(each)
    ob.data.attributes.new(name, "FLOAT", "FACE")
    twin.vertex_groups.new(name=name)
    before = mesh_state(ob.data)
    made = arrays(ob, twin, target="CORNER")
    assert np.array_equal(made.ranges[0].element_patch, made.ranges[1].element_patch)
    assert mesh_state(ob.data) == before


@pytest.mark.parametrize(
    "kind", ["ARRAY", "BEVEL", "DECIMATE", "MIRROR", "REMESH", "SCREW", "SOLIDIFY", "SUBSURF", "WELD", "WIREFRAME"]
)
def test_faces_come_from_the_same_ones_whether_or_not_there_is_a_result(kind):
    """A Bevel takes the data of new faces from one side or the other by what colours and UV maps hold."""
    block, ground = cube("Block", 0.5), floor(n=4)
    block.location.z = 0.4
    block.modifiers.new(kind, kind)
    first = baked(block)
    bake(block, ground, attribute_name="Other", target="POINT")
    output, lightmap = OutputSettings(target="LIGHTMAP", attribute_name="Map"), LightmapSettings(size=256)
    BakeJob(bpy.context, [block, ground], BakeSettings(rays=4), output, lightmap=lightmap).run()
    assert FACE_LAYER in block.data.attributes
    assert np.array_equal(baked(block), first)


def test_results_that_materials_read_are_read():
    """Another bake's colours below a modifier that makes faces are not blank, as they are for where these come from."""
    ob, twin = cube("Block", 0.5), cube("Twin", 0.5)
    for each, place in ((ob, 0.0), (twin, 50.0)):
        each.location.x = place
        bake(each, attribute_name="Other", target="FACE")
        each.data.attributes["Other"].data.foreach_set("color", np.tile(np.float32([0.2, 0.4, 0.6, 1.0]), 6))
        made = material(each.name, (1.0, 1.0, 1.0))
        node = made.node_tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = "Other"
        made.node_tree.links.new(node.outputs[0], made.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
        each.data.materials.append(made)
    triangulate(twin)
    reflectance = [arrays(each).materials.reflectance for each in (ob, twin)]
    assert np.allclose(reflectance[0], [0.2, 0.4, 0.6], atol=1e-6)
    assert np.allclose(reflectance[1], reflectance[0], atol=1e-6)


def test_nothing_carried_is_left_when_the_name_is_refused():
    """A name that cannot be used fails before anything is put on any mesh."""
    ob = floor(n=3)
    triangulate(ob)
    before = mesh_state(ob.data)
    with pytest.raises(AttributeNameError):
        job(ob, attribute_name="position")
    assert mesh_state(ob.data) == before


def test_shared_meshes_with_unlike_modifiers_keep_their_own_faces():
    """Two objects share a grid, one of them subdivided: both own all of their own surface."""
    ob = floor(n=2)
    other = bpy.data.objects.new("Other", ob.data)
    other.location = (10.0, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(other)
    subdivide(other)
    made = arrays(ob, other)
    assert np.allclose(element_areas(made, 0), 1.0)
    assert np.allclose(element_areas(made, 1), 1.0)
    bake(ob, other)
    assert np.allclose(colors(ob), 1.0, atol=1e-6)
    assert np.allclose(colors(other), 1.0, atol=1e-6)
    assert FACE_LAYER in other.data.attributes
