"""Hair, hair curves and points occlude as Cycles renders them."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.reading import strands
from tests.blender.helpers import areas, bake, baked, colors, cube, floor, material, notes_about, occluders, snapshot
from tests.blender.reading.light_helpers import cycles_ao_on_faces

pytestmark = pytest.mark.usefixtures("empty_scene")


def emitter(count=2000, **values):
    """Strands on a floor that does not render itself."""
    ob = floor("Hairy", size=4.0, n=4)
    ob.modifiers.new("Hair", "PARTICLE_SYSTEM")
    settings = ob.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length = "HAIR", count, 0.5
    settings.root_radius = settings.tip_radius = 5.0
    for name, value in values.items():
        setattr(settings, name, value)
    ob.show_instancer_for_render = ob.show_instancer_for_viewport = False
    return ob


def hair_curves(count=1500):
    data = bpy.data.hair_curves.new("Hairy")
    data.add_curves([2] * count)
    roots = np.random.default_rng(0).random((count, 2)) * 4.0 - 2.0
    points = np.zeros((count, 2, 3), np.float32)
    points[:, :, :2], points[:, 1, 2] = roots[:, None], 0.5
    data.attributes["position"].data.foreach_set("vector", points.ravel())
    radius = data.attributes.get("radius") or data.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(2 * count, 0.03, np.float32))
    ob = bpy.data.objects.new("Hairy", data)
    bpy.context.scene.collection.objects.link(ob)
    return ob


def point_cloud(radius=0.2):
    """A point on each of the 36 vertices of a grid."""
    ob = floor("Hairy", size=2.0, n=5, z=0.4)
    tree = bpy.data.node_groups.new("Points", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    source, made, end = (
        tree.nodes.new(kind) for kind in ("NodeGroupInput", "GeometryNodeMeshToPoints", "NodeGroupOutput")
    )
    made.inputs["Radius"].default_value = radius
    tree.links.new(source.outputs[0], made.inputs[0])
    tree.links.new(made.outputs[0], end.inputs[0])
    ob.modifiers.new("Points", "NODES").node_group = tree
    return ob


@pytest.mark.parametrize("build", [emitter, hair_curves, point_cloud])
def test_they_occlude_as_in_cycles(build):
    """Classical ambient occlusion, face by face; Cycles' is of corners, and one unlucky hair covers much of one."""
    ob = floor(size=2.0, n=6)
    build()
    report = bake(ob, falloff="STEP", use_bleeding=False, rays=256, target="CORNER", attribute_name="Ours")
    assert report.warnings == []
    ours = np.add.reduceat(colors(ob, "Ours")[:, 0], np.arange(0, 144, 4)) / 4.0
    cycles = cycles_ao_on_faces(ob, distance=1.0, samples=512)
    assert cycles.mean() < 0.9
    assert abs(ours.mean() - cycles.mean()) < 0.04


def test_strands_are_where_they_grow():
    """Also of an emitter that is moved, turned and scaled: roots on it, and as many as there are."""
    ob, hairy = floor(), emitter(count=50)
    hairy.location, hairy.rotation_euler, hairy.scale = (5.0, 1.0, 2.0), (0.5, 0.2, 0.1), (2.0, 2.0, 2.0)
    (tubes,) = occluders(ob)["Hairy"]
    keys = 2 ** hairy.particle_systems[0].settings.display_step
    assert len(tubes) == 50 * keys * 6
    inverse = np.array(hairy.matrix_world.inverted())
    height = (tubes.reshape(-1, 3) @ inverse[:3, :3].T + inverse[:3, 3])[:, 2].reshape(50, -1)
    assert np.abs(height.min(1)).max() < 0.05
    assert height.max(1).min() > 0.2


def test_children_take_the_place_of_their_parents():
    ob = floor()
    emitter(count=10, child_type="SIMPLE", child_percent=7)
    (tubes,) = occluders(ob)["Hairy"]
    keys = 2 ** bpy.data.particles[0].display_step
    assert len(tubes) == 70 * keys * 6


def test_thickness_is_that_of_the_settings():
    """A cone of radius .5 x radius_scale x root_radius at its root, and closed at its tip: its surface is told."""
    ob = floor()
    emitter(count=1, root_radius=2.0, tip_radius=0.0, radius_scale=0.1, hair_length=4.0)
    (tubes,) = occluders(ob)["Hairy"]
    length = tubes[..., 2].max() - tubes[..., 2].min()
    assert areas(tubes).sum() == pytest.approx(np.pi * 0.1 * length, rel=0.02)


def test_particles_that_show_objects_are_no_strands():
    ob = floor()
    emitter(count=3, render_type="OBJECT", instance_object=cube("Leaf", half=0.1))
    assert "Hairy" not in occluders(ob)


def test_hair_that_does_not_render_does_not_occlude():
    ob, hairy = floor(), emitter(count=20)
    assert len(occluders(ob)["Hairy"]) == 1
    hairy.hide_render = True
    assert "Hairy" not in occluders(ob)
    hairy.hide_render = False
    hairy.modifiers[0].show_viewport = False
    assert "Hairy" not in occluders(ob)


@pytest.mark.parametrize("build", [emitter, hair_curves, point_cloud])
def test_too_many_are_thinned_and_said_so(build, monkeypatch):
    """No more triangles than the most, and about as dark as before."""
    ob = floor(size=2.0, n=2)
    build()
    expected = baked(ob, use_bleeding=False, rays=256).mean()
    n_triangles = sum(len(part.mesh.triangle_corners) for part in snapshot(ob).occluders)
    monkeypatch.setattr(strands, "MAX_TRIANGLES", n_triangles // 3)
    taken = snapshot(ob)
    assert sum(len(part.mesh.triangle_corners) for part in taken.occluders) <= n_triangles // 3 + 60
    assert notes_about(taken.notes, "fewer and thicker", "'Hairy'")
    assert baked(ob, use_bleeding=False, rays=256).mean() == pytest.approx(expected, abs=0.08)


def test_their_material_tints():
    """The color of the first slot, or of the one that the system names."""
    ob, hairy = floor(n=2), emitter(count=500)
    for name, color in (("Grey", (0.5, 0.5, 0.5)), ("Red", (0.9, 0.0, 0.0))):
        hairy.data.materials.append(material(name, color))
    hairy.particle_systems[0].settings.material = 2
    part = next(part for part in snapshot(ob).occluders if part.name == "Hairy")
    assert np.allclose(part.shadings[0].reflectance.at(None)[0, 0], (0.9, 0.0, 0.0), atol=1e-6)
