"""The life of a bake: started, stepped, committed or cancelled, and what the scene may do meanwhile."""

import threading

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs import BakeJob
from obscurance_addon.blender.writing.values import SceneChangedError
from obscurance_addon.core.errors import BakeCancelledError, GeometryError, ObscuranceError
from obscurance_addon.core.light.settings import Quantity
from obscurance_addon.core.lightmap import LightmapSettings
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import OutputSettings, Target
from obscurance_addon.core.settings import BakeSettings
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    baked,
    colors,
    cube,
    file_state,
    floor,
    job,
    material,
    select,
    sheet,
    snapshot,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def corner(n=4):
    """A red wall on a floor of n strips."""
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), n)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=(0.8, 0.1, 0.1))
    return ob


def finished(*objects, **changes):
    running = job(*objects, **changes)
    while not running.step(1.0):
        pass
    return running


def bake_threads():
    return [t for t in threading.enumerate() if "obscurance" in t.name or "ThreadPool" in t.name]


# -------------------------------------------------------------------------------------------------- steps and report


@pytest.mark.parametrize("quantity", Quantity)
def test_steps_lead_to_a_result_and_then_stay_there(quantity):
    """Progress never falls and stays within 0 .. 1; a finished job is finished however often it is asked."""
    running = job(corner(), rays=1 << 12, quantity=quantity)
    seen = [running.progress]
    while not running.step(0.001):
        seen.append(running.progress)
        assert running.remaining is None or running.remaining >= 0.0
    seen.append(running.progress)
    assert seen == sorted(seen)
    assert seen[0] >= 0.0
    assert seen[-1] == 1.0
    assert running.step(0.0)
    assert bake_threads() == []


def test_the_report_counts_what_was_done():
    """Patches, triangles, rays (16 for each patch and as many for the error), phases, objects and reach."""
    ob = corner(n=4)
    report = bake(ob, rays=16, distance=0.5)
    assert report.objects == ["Floor"]
    assert report.patches == 4
    assert report.triangles == 10
    assert report.rays == 2 * 4 * 16
    assert set(report.seconds) == {"extract", "build", "trace", "write"}
    assert all(seconds >= 0.0 for seconds in report.seconds.values())
    assert report.d_max == 0.5
    assert "4 patches of 'Floor' with 128 rays" in report.summary()


def test_the_automatic_distance_is_a_fifth_of_what_is_baked():
    """And of what stands by it: 2 x 4 x 1 m. A ground of 2 km is left out, and named."""
    report = bake(corner(), distance=None)
    assert report.d_max == pytest.approx(0.2 * 21.0**0.5)
    assert "up to 0.917 m long (0.2 of the size of what is baked) in" in report.summary()
    sheet("Horizon", (-1000, -1000, -1), (2000, 0, 0), (0, 2000, 0))
    sheet("Astray", (300, 0, 0), (1, 0, 0), (0, 1, 0))
    again = bake(bpy.data.objects["Floor"], distance=None)
    assert again.d_max == report.d_max
    assert again.reach_from == (
        "0.2 of the size of what is baked; left out as far larger: 'Horizon'; left out as far away: 'Astray'"
    )
    assert bake(bpy.data.objects["Floor"], distance=0.5).reach_from == ""


# ------------------------------------------------------------------------------------------------- the same, or other


def test_the_same_seed_gives_the_same_bits():
    """Twice the same job, and with any number of threads."""
    ob = corner()
    first = baked(ob)
    assert np.array_equal(baked(ob), first)
    assert np.array_equal(baked(ob, threads=2), first)
    assert np.array_equal(baked(ob, threads=0), first)


@pytest.mark.parametrize("sampler", ["SOBOL", "RANDOM"])
def test_another_seed_gives_other_values(sampler):
    """Strips within reach of the wall differ."""
    ob = corner()
    one, other = (baked(ob, seed=seed, sampler=sampler)[:2] for seed in (0, 1))
    assert (one != other).all()


def test_an_object_bakes_the_same_alone_or_with_another():
    """Occluders are the same, whatever is selected or given: equal but for where float32 rays start.

    Rays start 1e-5 of the extent of all that is baked above their face, which is all that differs.
    """
    ob, wall = corner(), bpy.data.objects["Wall"]
    alone = baked(ob, rays=64)
    select(wall)
    assert np.array_equal(baked(ob, rays=64), alone)
    for together in ((ob, wall), (wall, ob)):
        bake(*together, rays=64)
        assert np.allclose(colors(ob), alone, atol=1e-4)


def test_the_order_of_objects_does_not_matter():
    """Given in either order, both get the same bits."""
    ob, wall = corner(), bpy.data.objects["Wall"]
    bake(ob, wall)
    first = colors(ob), colors(wall)
    bake(wall, ob)
    assert np.allclose(colors(ob), first[0], atol=1e-6)
    assert np.allclose(colors(wall), first[1], atol=1e-6)


def test_what_was_baked_before_does_not_count():
    """A second bake of the same scene gives the same bits although the first one left a colour on everything."""
    ob, wall = corner(), bpy.data.objects["Wall"]
    bake(ob, wall)
    first = colors(ob)
    bake(ob, wall)
    assert np.array_equal(colors(ob), first)


# ------------------------------------------------------------------------------------------------------------ cancel


def test_cancel_ends_the_threads_and_writes_nothing():
    """At once after the start, with rays left for minutes; a second cancel does no harm."""
    ob = corner()
    running = job(ob, rays=1 << 20, threads=2)
    running.cancel()
    assert bake_threads() == []
    with pytest.raises(BakeCancelledError):
        running.step(0.0)
    running.cancel()
    assert FACE_LAYER not in ob.data.attributes


def test_cancel_in_the_middle_of_tracing():
    """After the first rays are in."""
    ob = corner()
    running = job(ob, rays=1 << 20, threads=2)
    while running.remaining is None:
        assert not running.step(0.001)
    assert 0.0 < running.progress < 1.0
    running.cancel()
    assert bake_threads() == []
    with pytest.raises(BakeCancelledError):
        running.step(0.0)
    assert FACE_LAYER not in ob.data.attributes


def test_cancel_of_a_finished_job_is_harmless():
    """Its result can still be written."""
    running = finished(corner())
    running.cancel()
    assert running.commit().patches == 4


# --------------------------------------------------------------------------------------------- the scene goes on living


def deleted(ob):
    bpy.data.objects.remove(ob)


def more_faces(ob):
    mesh = ob.data
    mesh.clear_geometry()
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])


def turned_faces(ob):
    """As many vertices, corners and faces, but in another order."""
    mesh = ob.data
    points = [tuple(v.co) for v in mesh.vertices]
    faces = [tuple(p.vertices) for p in mesh.polygons]
    mesh.clear_geometry()
    mesh.from_pydata(points, [], faces[::-1])


def in_edit_mode(ob):
    select(ob)
    bpy.ops.object.mode_set(mode="EDIT")


def other_mesh(ob):
    ob.data = cube("Cube").data


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (deleted, "'Floor' was deleted"),
        (more_faces, "'Floor' was edited"),
        (turned_faces, "'Floor' was edited"),
        (other_mesh, "'Floor' was edited"),
        (in_edit_mode, "'Floor' is in Edit Mode"),
    ],
)
@pytest.mark.parametrize("target", ["FACE", "POINT"])
def test_results_without_a_place_are_not_written(edit, words, target):
    """The error names the object; the other object of the same bake gets nothing, either."""
    ob, wall = corner(), bpy.data.objects["Wall"]
    running = finished(wall, ob, target=target)
    edit(ob)
    with pytest.raises(SceneChangedError, match=words):
        running.commit()
    for mesh in bpy.data.meshes:
        assert {FACE_LAYER, CORNER_LAYER}.isdisjoint(mesh.attributes.keys())


@pytest.mark.parametrize("target", ["FACE", "CORNER"])
def test_objects_in_edit_mode_are_refused_by_name(target):
    """A script has to leave it; the operator and the command line do."""
    ob = corner()
    ob.modifiers.new("Triangulate", "TRIANGULATE")
    in_edit_mode(ob)
    with pytest.raises(ObscuranceError, match=r"in Edit Mode.*'Floor'"):
        job(bpy.data.objects["Wall"], ob, target=target)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert not [name for name in ob.data.attributes.keys() if name.startswith("obscurance")]  # noqa: SIM118


def renamed(ob):
    ob.name = "Another name"


def moved(ob):
    ob.location.x += 1.0
    ob.data.vertices[0].co.z += 0.5


def joined_by_others(_ob):
    cube("New")


def undone(_ob):
    bpy.ops.ed.undo_push(message="one")
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.ed.undo()


@pytest.mark.parametrize("change", [renamed, moved, joined_by_others, undone])
def test_results_find_their_place_when_faces_stay(change):
    """Renaming, moving, adding and undo in the meantime: the values are those of the scene at the start."""
    ob = corner()
    expected = baked(ob)
    for name in (FACE_LAYER, CORNER_LAYER):
        ob.data.attributes.remove(ob.data.attributes[name])
    uid = ob.session_uid
    running = finished(ob)
    change(ob)
    running.commit()
    again = next(o for o in bpy.data.objects if o.session_uid == uid)
    assert np.array_equal(colors(again), expected)


def test_a_name_taken_meanwhile_is_an_error():
    """A UV map made during the bake is as safe as one that was there before."""
    ob = corner()
    running = finished(ob)
    ob.data.uv_layers.new(name=FACE_LAYER)
    before = file_state()
    with pytest.raises(Exception, match="UV map named 'Obscurance'"):
        running.commit()
    assert file_state() == before


def multiplied_by_layer(name: str) -> bpy.types.Material:
    """A grey diffuse material times a colour attribute, as the README tells to use the result."""
    made = material("Multiplied", (0.5, 0.5, 0.5))
    tree = made.node_tree
    tree.nodes.clear()
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = name
    multiply = tree.nodes.new("ShaderNodeMixRGB")
    multiply.blend_type = "MULTIPLY"
    multiply.inputs[0].default_value = 1.0
    multiply.inputs[1].default_value = (0.5, 0.5, 0.5, 1.0)
    diffuse, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(attribute.outputs["Color"], multiply.inputs[2])
    tree.links.new(multiply.outputs[0], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return made


@pytest.mark.parametrize("layer", ["Obscurance", "Obscurance Color"])
def test_materials_that_use_the_result_do_not_darken_the_next_bake(layer):
    """Base colour times the layer that is being baked: the first, second and third bake give the same bits."""
    ob, wall = corner(), bpy.data.objects["Wall"]
    plain = bake(ob, wall).r_ave
    for each in (ob, wall):
        each.data.materials.clear()
        each.data.materials.append(multiplied_by_layer(layer))
    reports = [bake(ob, wall) for _ in range(3)]
    assert all(report.r_ave == pytest.approx((0.5, 0.5, 0.5), abs=1e-6) for report in reports)
    assert plain != reports[0].r_ave
    values = colors(ob)
    bake(ob, wall)
    assert np.array_equal(colors(ob), values)


def test_objects_hidden_inside_of_a_solid_are_named():
    """A cube most of which is in a larger one, though every face of it has a part outside."""
    block, inside = cube("Block", half=2.0), cube("Inside", half=0.5)
    inside.location.x = 1.6
    warnings = bake(block, inside).warnings
    (warning,) = [text for text in warnings if "closed solid" in text]
    assert ": 'Inside';" in warning
    assert "flip" in warning


def test_rooms_and_what_looks_the_wrong_way_are_named():
    """One note for each kind: a box around others, a prop inside out, faces that are flipped, a ground upside down."""
    room, inside = cube("Room", half=2.0), cube("Inside", half=0.5)
    (text,) = bake(room, inside).warnings
    assert "rooms" in text
    assert ": 'Room';" in text
    assert "flip" in text
    room.data.flip_normals()
    assert not bake(room, inside).warnings
    bpy.data.objects.remove(room)
    inside.data.flip_normals()
    ground = floor("Ground")
    ground.location.z = -0.6
    (text,) = bake(ground, inside).warnings
    assert "looking inwards" in text
    assert ": 'Inside';" in text
    assert "Recalculate Outside" in text
    inside.data.flip_normals()
    inside.data.polygons[0].flip()
    inside.data.update()
    (text,) = bake(ground, inside).warnings
    assert "as if turned" in text
    assert ": 'Inside';" in text
    assert "Recalculate Outside" in text
    ground.data.flip_normals()
    assert any("looking away" in text and ": 'Ground';" in text for text in bake(ground, inside).warnings)


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_a_flipped_face_has_the_value_of_the_side_that_is_seen(target):
    """The top of a box on a floor, whichever way it looks."""
    ground, box = floor("Ground"), cube("Box", half=0.3)
    box.location.z = 0.3
    bake(ground, box, target=target)
    before = colors(box).copy(), colors(ground).copy()
    box.data.polygons[int(np.argmax([p.normal.z for p in box.data.polygons]))].flip()
    box.data.update()
    bake(ground, box, target=target)
    np.testing.assert_allclose(np.sort(colors(box).mean(1)), np.sort(before[0].mean(1)), atol=0.06)
    np.testing.assert_allclose(colors(ground), before[1], atol=0.03)


def test_emission_reaches_the_patches():
    """Area means in W/m^2: radiance 3 of a lit floor is an exitance of 3 pi on each of its faces."""
    ob = floor(n=2)
    made = material("Lit", (0.5, 0.5, 0.5))
    made.node_tree.nodes.clear()
    emission, output = (made.node_tree.nodes.new(kind) for kind in ("ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    emission.inputs["Strength"].default_value = 3.0
    emission.inputs["Color"].default_value = (1.0, 0.5, 0.0, 1.0)
    made.node_tree.links.new(emission.outputs[0], output.inputs["Surface"])
    ob.data.materials.clear()
    ob.data.materials.append(made)
    made = prepare_arrays(snapshot(ob), Target.FACE, needs_light=True)
    np.testing.assert_allclose(made.materials.emission, np.tile([3 * np.pi, 1.5 * np.pi, 0.0], (4, 1)), rtol=1e-6)
    assert not made.materials.reflectance.any()


def test_an_object_without_extent_is_named():
    """Scaled to nothing: the message names it and the cure."""
    ob = floor("Flat Out")
    ob.scale = (0.0, 0.0, 0.0)
    with pytest.raises(GeometryError, match=r"'Flat Out'.*no extent.*scale"):
        bake(ob)


def test_what_the_distance_left_out_is_named_beside_what_modifiers_make():
    """An Array on what a lightmap is baked onto makes one object more than the scene has."""
    ground, block = floor("Floor"), cube("Block")
    block.modifiers.new("Array", "ARRAY").count = 3
    far = cube("Far")
    far.location.x = 500.0
    bpy.context.view_layer.update()
    settings, output = BakeSettings(rays=4), OutputSettings(target=Target.LIGHTMAP)
    report = BakeJob(bpy.context, [ground, block], settings, output, lightmap=LightmapSettings(size=256)).run()
    assert "'Far'" in report.reach_from
