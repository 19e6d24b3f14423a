"""What is read from a scene: where the evaluated surfaces stand in the world, and what occludes."""

import sys

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.blender.reading.visibility import rendered_meshes
from obscurance_addon.core.errors import GeometryError, ObscuranceError
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import Target
from tests.blender.helpers import (
    CUBE_FACES,
    CUBE_VERTICES,
    areas,
    arrays,
    bake,
    baked,
    colors,
    cube,
    file_state,
    floor,
    job,
    layer_collection,
    material,
    new_collection,
    new_object,
    notes_about,
    occluders,
    snapshot,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def world_triangles(ob, target="FACE"):
    """(t, 3, 3) of the object that is baked."""
    made = arrays(ob, target=target)
    return made.surfaces.vertices[made.surfaces.triangles[: len(ob.data.loop_triangles)]]


def signed_volume(triangles):
    return np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6.0


# ------------------------------------------------------------------------------------------------------- deformation


def test_shape_keys_deform_what_is_baked():
    """Half of a shape key lifts every vertex by half of its height."""
    ob = floor()
    ob.shape_key_add(name="Basis")
    key = ob.shape_key_add(name="Up")
    for point in key.data:
        point.co.z = 3.0
    key.value = 0.5
    assert (world_triangles(ob)[..., 2] == 1.5).all()


def test_armatures_deform_what_is_baked():
    """A bone moved by 2 m takes the vertices along that its group holds."""
    ob = floor()
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.tail = (0.0, 1.0, 0.0)  # the rest matrix is the identity
    bpy.ops.object.mode_set(mode="OBJECT")
    ob.vertex_groups.new(name="Bone").add([0, 1], 1.0, "REPLACE")
    ob.modifiers.new("Rig", "ARMATURE").object = rig
    rig.pose.bones["Bone"].matrix = Matrix.Translation((0.0, 0.0, 2.0))
    triangles = world_triangles(ob)
    assert set(triangles[..., 2][triangles[..., 1] < 0.0]) == {2.0}
    assert set(triangles[..., 2][triangles[..., 1] > 0.0]) == {0.0}


def test_modifiers_deform_what_is_baked():
    """Displace moves all vertices along one axis by its strength."""
    ob = floor()
    displace = ob.modifiers.new("Displace", "DISPLACE")
    displace.direction, displace.strength, displace.mid_level = "Z", 0.75, 0.0
    assert (world_triangles(ob)[..., 2] == 0.75).all()


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
@pytest.mark.parametrize("scale", [(2.0, 3.0, 0.5), (-2.0, 3.0, 0.5), (-2.0, -3.0, 0.5), (-2.0, -3.0, -0.5)])
def test_solids_face_outwards_under_any_mirroring(scale, target):
    """Surfaces and patches enclose the volume of the cube times |determinant|, with a positive sign."""
    ob = cube(half=0.5)
    ob.matrix_world = Matrix.LocRotScale((5.0, -1.0, 2.0), None, scale)
    made = arrays(ob, target=target)
    assert signed_volume(world_triangles(ob, target)) == pytest.approx(3.0, rel=1e-6)
    assert signed_volume(made.patches.corners) == pytest.approx(3.0, rel=1e-6)


def test_mirrored_solids_are_seen_from_outside():
    """A mirrored cube alone in the world is open everywhere: no ray starts inside of it."""
    ob = cube()
    ob.scale = (-1.0, 1.0, 1.0)
    assert np.allclose(baked(ob), 1.0, atol=1e-6)


def test_shear_is_kept():
    """A child turned below a parent of unequal scales stands at its world matrix, which no scale and rotation make."""
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (1.0, 4.0, 1.0)
    ob = cube()
    ob.parent, ob.rotation_euler = parent, (0.0, 0.0, 0.6)
    triangles = world_triangles(ob)
    matrix = np.array(ob.matrix_world)
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    assert abs(gram[0, 1]) > 1.0  # sheared indeed
    expected = np.array(CUBE_VERTICES) @ matrix[:3, :3].T + matrix[:3, 3]
    found = np.unique(np.round(triangles.reshape(-1, 3), 5), axis=0)
    assert np.allclose(found, np.unique(np.round(expected, 5), axis=0), atol=2e-5)
    assert signed_volume(triangles) == pytest.approx(8.0 * 4.0, rel=1e-5)


# --------------------------------------------------------------------------------------------------------- occluders


def test_collection_instances_occlude():
    """Two empties that instance a collection put its cube where each of them stands; the cube itself is not there."""
    ob = floor()
    hidden_away = new_collection("Assets", linked=False)
    cube("Thing", half=0.5, collection=hidden_away)
    for x in (3.0, -4.0):
        empty = bpy.data.objects.new("Instance", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", hidden_away, (x, 0.0, 0.0)
        bpy.context.scene.collection.objects.link(empty)
    found = occluders(ob)
    assert list(found) == ["Thing"]
    assert sorted(triangles.reshape(-1, 3).mean(0)[0].round(5) for triangles in found["Thing"]) == [-4.0, 3.0]
    assert [len(triangles) for triangles in found["Thing"]] == [12, 12]


def test_geometry_nodes_instances_occlude():
    """One instance of an object on each vertex of a modifier's mesh."""
    ob = floor()
    thing = cube("Thing", half=0.1)
    thing.location = (100.0, 0.0, 0.0)
    scatterer = floor("Scatterer", z=5.0)
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes = [
        tree.nodes.new(kind)
        for kind in (
            "NodeGroupInput",
            "GeometryNodeInstanceOnPoints",
            "NodeGroupOutput",
            "GeometryNodeObjectInfo",
        )
    ]
    nodes[3].inputs["Object"].default_value = thing
    tree.links.new(nodes[0].outputs[0], nodes[1].inputs["Points"])
    tree.links.new(nodes[3].outputs["Geometry"], nodes[1].inputs["Instance"])
    tree.links.new(nodes[1].outputs[0], nodes[2].inputs[0])
    scatterer.modifiers.new("Scatter", "NODES").node_group = tree
    found = [triangles for parts in occluders(ob).values() for triangles in parts]
    centres = sorted(tuple(triangles.reshape(-1, 3).mean(0).round(4)) for triangles in found)
    assert centres == [(-1, -1, 5), (-1, 1, 5), (1, -1, 5), (1, 1, 5), (100, 0, 0)]


def test_particles_occlude():
    """Hair particles on the faces of an emitter instance an object, each counted once beside the emitter itself."""
    ob = floor()
    thing = cube("Thing", half=0.1)
    emitter = floor("Emitter", z=5.0)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    system = emitter.particle_systems[0].settings
    system.type, system.count, system.render_type, system.instance_object = "HAIR", 7, "OBJECT", thing
    found = occluders(ob)
    assert len(found["Thing"]) == 1 + 7
    assert [len(triangles) for triangles in found["Emitter"]] == [2]
    heights = sorted(triangles.reshape(-1, 3).mean(0)[2] for triangles in found["Thing"])
    assert heights[0] == pytest.approx(0.0)
    assert min(heights[1:]) > 4.0


def test_an_emitter_that_does_not_render_does_not_occlude():
    """'Show Emitter' switched off for renders takes the emitter away, not its particles; the note names it."""
    ob = floor()
    thing = cube("Thing", half=0.1)
    emitter = floor("Emitter", z=5.0)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    system = emitter.particle_systems[0].settings
    system.type, system.count, system.render_type, system.instance_object = "HAIR", 3, "OBJECT", thing
    emitter.show_instancer_for_render = False
    taken = snapshot(ob)
    assert sorted(part.name for part in taken.occluders) == ["Thing"] * 4
    assert notes_about(taken.notes, "hidden from renders", "'Emitter'")


def curve_ball():
    data = bpy.data.curves.new("Curve", "CURVE")
    data.dimensions, data.bevel_depth = "3D", 0.1
    spline = data.splines.new("POLY")
    spline.points.add(1)
    spline.points[1].co = (1.0, 0.0, 0.0, 1.0)
    return data


def text():
    data = bpy.data.curves.new("Text", "FONT")
    data.body = "L"
    return data


def metaball():
    data = bpy.data.metaballs.new("Meta")
    data.elements.new()
    return data


@pytest.mark.parametrize("make", [curve_ball, text, metaball])
def test_curves_texts_and_metaballs_occlude_once(make):
    """What occludes are the triangles that the object turns into as a mesh, once, at its place."""
    ob = floor()
    data = make()
    solid = bpy.data.objects.new("Solid", data)
    solid.location = (0.0, 0.0, 8.0)
    bpy.context.scene.collection.objects.link(solid)
    found = occluders(ob)
    evaluated = solid.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    expected = np.array([[mesh.vertices[v].co for v in t.vertices] for t in mesh.loop_triangles])
    expected[..., 2] += 8.0
    evaluated.to_mesh_clear()
    assert len(expected) > 0
    (parts,) = found.values()
    assert len(parts) == 1
    assert np.array_equal(parts[0].astype(np.float32), expected.astype(np.float32))


def test_instances_of_what_is_baked_occlude_it():
    """An object that is baked and instanced as well is one patch set and one more occluder."""
    shared = new_collection("Shared")
    ob = floor(collection=shared)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", shared, (0.0, 0.0, 0.5)
    bpy.context.scene.collection.objects.link(empty)
    taken = snapshot(ob)
    assert [part.snapshot.matrix[2, 3] for part in taken.baked] == [0.0]
    assert [part.matrix[2, 3] for part in taken.occluders] == [0.5]


# ------------------------------------------------------------------------------------------------------------ hidden


def test_objects_hidden_from_renders_do_not_count_and_are_named():
    """A ceiling that does not render leaves the floor open."""
    ob = floor()
    ceiling = floor("Ceiling", z=0.1)
    assert baked(ob).max() < 0.9
    ceiling.hide_render = True
    report = bake(ob)
    assert notes_about(report.warnings, "hidden from renders", "'Ceiling'")
    assert np.allclose(baked(ob), 1.0, atol=1e-6)


def disabled(name):
    layer_collection(name).collection.hide_render = True


def excluded(name):
    layer_collection(name).exclude = True


def disabled_above(name):
    """The collection itself renders, the one that it is in does not."""
    outer = new_collection("Outer")
    inner = bpy.data.collections[name]
    bpy.context.scene.collection.children.unlink(inner)
    outer.children.link(inner)
    outer.hide_render = True


@pytest.mark.parametrize("hide", [disabled, excluded, disabled_above])
def test_collections_that_do_not_render_do_not_count_and_their_objects_are_named(hide):
    """A ceiling in such a collection does not occlude; in a second collection that renders it does."""
    ob = floor()
    ceiling = floor("Ceiling", z=0.1, collection=new_collection("Off"))
    hide("Off")
    taken = snapshot(ob)
    assert taken.occluders == []
    assert notes_about(taken.notes, "hidden from renders", "'Ceiling'")
    new_collection("On").objects.link(ceiling)
    taken = snapshot(ob)
    assert [part.name for part in taken.occluders] == ["Ceiling"]
    assert not notes_about(taken.notes, "'Ceiling'")


def test_collections_taken_in_below_an_excluded_one_count():
    """Blender renders them, so their objects occlude, and the outer one's do not."""
    ob = floor()
    inner = new_collection("Inner", linked=False)
    outer = new_collection("Outer")
    outer.children.link(inner)
    floor("Ceiling", z=0.1, collection=inner)
    floor("Out", z=0.2, collection=outer)
    layer_collection("Outer").exclude = True
    layer_collection("Outer").children["Inner"].exclude = False
    taken = snapshot(ob)
    assert [part.name for part in taken.occluders] == ["Ceiling"]
    assert notes_about(taken.notes, "hidden from renders", "'Out'")
    assert not notes_about(taken.notes, "'Ceiling'")


def test_what_an_instanced_collection_hides_from_renders_does_not_count():
    """A collection inside of the one that is instanced may not render; an object that is also in another one does."""
    ob = floor()
    assets, off = new_collection("Assets", linked=False), new_collection("Off", linked=False)
    assets.children.link(off)
    off.hide_render = True
    cube("Hidden", collection=off)
    both = cube("Both", collection=off)
    assets.objects.link(both)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", assets
    bpy.context.scene.collection.objects.link(empty)
    taken = snapshot(ob)
    assert [part.name for part in taken.occluders] == ["Both"]
    assert notes_about(taken.notes, "hidden from renders", "'Hidden'")


def test_instances_by_a_hidden_object_do_not_count():
    """An instancer that does not render takes its instances away."""
    ob = floor()
    assets = new_collection("Assets", linked=False)
    cube("Thing", collection=assets)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", assets
    bpy.context.scene.collection.objects.link(empty)
    empty.hide_render = True
    taken = snapshot(ob)
    assert taken.occluders == []
    assert notes_about(taken.notes, "hidden from renders", "'Thing'")


def by_eye(ob):
    ob.hide_set(True)


def by_monitor(ob):
    ob.hide_viewport = True


def by_collection(_ob):
    bpy.context.view_layer.layer_collection.children["Off"].hide_viewport = True


def by_the_monitor_of_a_collection(_ob):
    layer_collection("Off").collection.hide_viewport = True


HIDE_IN_VIEWPORT = [by_eye, by_monitor, by_collection, by_the_monitor_of_a_collection]


@pytest.mark.parametrize("hide", HIDE_IN_VIEWPORT)
def test_what_the_viewport_hides_occludes_where_it_renders(hide):
    """A bake reads the scene as it renders, and leaves all as it was."""
    ob = floor()
    ceiling = floor("Ceiling", z=0.1, collection=new_collection("Off"))
    bpy.context.view_layer.update()
    shown = baked(ob)
    hide(ceiling)
    before = file_state(["Obscurance", "Obscurance Color"])
    report = bake(ob)
    assert np.array_equal(colors(ob), shown)
    assert report.warnings == []
    assert file_state(["Obscurance", "Obscurance Color"]) == before
    assert not ceiling.visible_get()
    ceiling.hide_render = True
    assert notes_about(bake(ob).warnings, "hidden from renders", "'Ceiling'")
    assert np.allclose(colors(ob), 1.0, atol=1e-6)


@pytest.mark.parametrize("hide", HIDE_IN_VIEWPORT)
def test_what_the_viewport_hides_is_noted_where_nothing_may_be_evaluated(hide):
    """As in Live Preview: it does not occlude although it renders, which is another trap than not rendering."""
    ob = floor()
    ceiling = floor("Ceiling", z=0.1, collection=new_collection("Off"))
    hide(ceiling)
    taken = snapshot(ob)
    assert taken.occluders == []
    assert notes_about(taken.notes, "hidden in the viewport", "although they render", "'Ceiling'")
    assert not notes_about(taken.notes, "hidden from renders")


def test_what_the_viewport_hides_of_an_instanced_collection_occludes():
    """The members of a collection that is not in the scene itself."""
    ob = floor()
    assets = new_collection("Assets", linked=False)
    thing = floor("Thing", z=0.1, collection=assets)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", assets
    bpy.context.scene.collection.objects.link(empty)
    shown = baked(ob)
    assert shown.max() < 0.9
    thing.hide_viewport = True
    assert np.array_equal(baked(ob), shown)
    assert thing.hide_viewport


def test_what_the_viewport_hides_can_be_baked():
    """The command line bakes all that renders."""
    ob = floor()
    ob.hide_set(True)
    assert rendered_meshes(bpy.context) == [ob]
    assert bake(*rendered_meshes(bpy.context)).objects == ["Floor"]
    assert ob.hide_get()


def test_a_bake_that_fails_leaves_all_hidden():
    ob, other = floor(), floor("Other")
    ob.hide_render = True
    other.hide_set(True)
    with pytest.raises(GeometryError, match="nothing to bake"):
        job(ob)
    assert other.hide_get()


def on_particles(thing):
    emitter = floor("Emitter", size=0.1, z=2.0)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    system = emitter.particle_systems[0].settings
    system.type, system.count, system.render_type, system.instance_object = "HAIR", 3, "OBJECT", thing


def on_points(thing):
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    points, copies, end, source = (
        tree.nodes.new(f"GeometryNode{kind}") if kind != "NodeGroupOutput" else tree.nodes.new(kind)
        for kind in ("Points", "InstanceOnPoints", "NodeGroupOutput", "ObjectInfo")
    )
    points.inputs["Count"].default_value = 3
    source.inputs["Object"].default_value = thing
    source.inputs["As Instance"].default_value = True
    tree.links.new(points.outputs[0], copies.inputs["Points"])
    tree.links.new(source.outputs["Geometry"], copies.inputs["Instance"])
    tree.links.new(copies.outputs[0], end.inputs[0])
    floor("Scatterer", size=0.1).modifiers.new("Scatter", "NODES").node_group = tree


def on_faces(thing):
    owner = floor("Owner", n=2, z=1.0)
    owner.instance_type, thing.parent = "FACES", owner


def in_a_collection(thing):
    assets = new_collection("Assets", linked=False)
    assets.objects.link(thing)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", assets
    bpy.context.scene.collection.objects.link(empty)


@pytest.mark.parametrize(
    ("instance", "copies"), [(on_particles, 3), (on_points, 3), (on_faces, 0), (in_a_collection, 0)]
)
def test_copies_of_what_does_not_render_itself(instance, copies):
    """Cycles renders those by particles and nodes, not those by faces and collections; measured in 4.5."""
    ob = floor()
    thing = cube("Thing", half=0.1)
    instance(thing)
    assert len(occluders(ob)["Thing"]) > 1
    thing.hide_render = True
    taken = snapshot(ob)
    assert [part.name for part in taken.occluders].count("Thing") == copies
    assert bool(notes_about(taken.notes, "hidden from renders", "'Thing'")) == (copies == 0)


def test_nothing_hidden_no_note():
    """A scene in which everything counts has no notes."""
    ob = floor()
    cube()
    assert snapshot(ob).notes == []


def test_baking_what_is_hidden_fails_by_name():
    """An object that does not render cannot be baked; beside another one it is left out and named."""
    ob, other = floor(), floor("Ceiling", z=0.5)
    ob.hide_render = True
    with pytest.raises(GeometryError, match=r"nothing to bake.*'Floor'"):
        job(ob)
    report = bake(ob, other)
    assert report.objects == ["Ceiling"]
    assert notes_about(report.warnings, "nothing was baked onto", "'Floor'")
    assert "Obscurance" not in ob.data.attributes


# ------------------------------------------------------------------------------------------------------ odd geometry


def test_vertices_that_are_not_finite_are_named():
    """The face with the NaN is left out, the note names the object, the other faces get true values."""
    ob = floor(n=2)
    ob.data.vertices[0].co.x = float("nan")
    report = bake(ob)
    assert notes_about(report.warnings, "'Floor'", "no finite position")
    values = baked(ob)
    assert np.allclose(values, 1.0, atol=1e-6)


def test_occluders_with_vertices_that_are_not_finite_are_named():
    """What is in the way may be broken too."""
    ob, other = floor(), cube("Broken")
    other.data.vertices[0].co.z = float("nan")
    assert notes_about(bake(ob).warnings, "'Broken'", "no finite position")


def test_objects_without_faces_are_named_or_fail():
    """A mesh of one edge beside a floor is left out by name; alone there is nothing to bake."""
    ob = floor()
    wire = new_object("Wire", [(0, 0, 0), (1, 0, 0)], [])
    report = bake(ob, wire)
    assert report.objects == ["Floor"]
    assert notes_about(report.warnings, "without faces", "'Wire'")
    with pytest.raises(ObscuranceError, match=r"nothing to bake.*without faces.*'Wire'"):
        job(wire)


def test_objects_whose_modifiers_remove_every_face_are_named():
    """A mask that leaves nothing makes an object that has faces but shows none."""
    ob, gone = floor(), floor("Gone", z=1.0)
    gone.vertex_groups.new(name="None")
    gone.modifiers.new("Mask", "MASK").vertex_group = "None"
    report = bake(ob, gone)
    assert report.objects == ["Floor"]
    assert notes_about(report.warnings, "left without faces by modifiers", "'Gone'")
    assert "Obscurance" not in gone.data.attributes


def test_nothing_given_fails():
    """No object at all."""
    with pytest.raises(ObscuranceError, match="nothing to bake: no mesh object with faces"):
        job()


def test_what_is_not_a_mesh_is_named():
    """Text can only occlude."""
    ob = floor()
    words = bpy.data.objects.new("Words", text())
    bpy.context.scene.collection.objects.link(words)
    assert notes_about(bake(ob, words).warnings, "not a mesh", "'Words'")
    with pytest.raises(ObscuranceError, match=r"nothing to bake.*not a mesh.*'Words'"):
        job(words)


def test_faces_that_name_slots_which_are_not_there_have_the_default_material():
    """Material indices without any slot are legal in Blender."""
    ob = floor()
    ob.data.polygons[0].material_index = 3
    assert ob.material_slots.keys() == []
    assert bake(ob).r_ave == pytest.approx((0.8, 0.8, 0.8))


def test_faces_that_name_a_slot_beyond_the_last_have_the_last_material():
    """As Cycles renders them."""
    ob = floor(color=(0.5, 0.1, 0.1))
    ob.data.materials.append(material("Green", (0.1, 0.6, 0.1)))
    ob.data.polygons[0].material_index = 7
    assert bake(ob).r_ave == pytest.approx((0.1, 0.6, 0.1))


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_no_python_line_runs_per_face(target):
    """Reading 64 times the faces runs as many lines of Python, but for the few passes over the joined corners."""

    def lines(n):
        count = 0

        def trace(_frame, event, _argument):
            nonlocal count
            count += event == "line"
            return trace

        ob = floor(f"Floor {n}", n=n)
        ob.modifiers.new("Keeps faces", "TRIANGULATE")
        bpy.context.view_layer.update()
        previous = sys.gettrace()
        sys.settrace(trace)
        try:
            taken = snapshot_scene(bpy.context, [ob], needs_rest=target != "FACE")
            prepare_arrays(taken, Target(target))
        finally:
            sys.settrace(previous)
        bpy.data.objects.remove(ob)
        return count

    lines(2)  # what runs once per process, such as imports, is not counted
    assert lines(64) - lines(8) < 8 * 64


def test_areas_of_patches_are_those_of_the_faces():
    """The patches of a cube have the areas of its faces in square metres, in the order of the faces."""
    ob = cube()
    ob.scale = (0.5, 1.0, 2.0)
    made = arrays(ob)
    assert np.allclose(areas(made.patches.corners).reshape(6, 2).sum(1), [8.0, 8.0, 4.0, 4.0, 2.0, 2.0])
    assert len(made.patches) == len(CUBE_FACES)
