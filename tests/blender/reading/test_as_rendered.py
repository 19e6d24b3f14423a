"""Modifiers, levels and hair as they render: read so when asked for, named when they differ, and left as they were."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs import BakeJob
from obscurance_addon.blender.reading.as_rendered import Modifiers
from obscurance_addon.core.order.output import OutputSettings
from obscurance_addon.core.settings import BakeSettings
from tests.blender.helpers import cube, file_state, floor, notes_about

pytestmark = pytest.mark.usefixtures("empty_scene")


def read(*objects, modifiers=Modifiers.RENDER):
    """What a bake reads."""
    bpy.context.view_layer.update()
    job = BakeJob(bpy.context, objects, BakeSettings(rays=4), OutputSettings(), modifiers=modifiers)
    job.cancel()
    return job.snapshot


def only_in_renders():
    roof = floor("Thing", z=5.0)
    modifier = roof.modifiers.new("Displace", "DISPLACE")
    modifier.direction, modifier.strength, modifier.mid_level, modifier.show_viewport = "Z", -4.5, 0.0, False


def only_in_the_viewport():
    only_in_renders()
    modifier = bpy.data.objects["Thing"].modifiers[0]
    modifier.show_viewport, modifier.show_render = True, False


def finer_in_renders():
    modifier = cube("Thing").modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2


def simplified():
    modifier = cube("Thing").modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 2
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision, render.simplify_subdivision_render = True, 0, 6


def curve():
    data = bpy.data.curves.new("Thing", "CURVE")
    data.dimensions, data.bevel_depth, data.resolution_u, data.render_resolution_u = "3D", 0.1, 1, 9
    data.splines.new("BEZIER").bezier_points.add(1)
    data.splines[0].bezier_points[1].co = (1.0, 0.0, 0.0)
    for point in data.splines[0].bezier_points:
        point.handle_left, point.handle_right = (-1.0, 1.0, 0.0), (1.0, 1.0, 0.0)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Thing", data))


def metaball():
    data = bpy.data.metaballs.new("Thing")
    data.elements.new()
    data.resolution, data.render_resolution = 1.0, 0.2
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Thing", data))


def fewer_particles():
    emitter = floor("Thing", z=2.0)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    system = emitter.particle_systems[0].settings
    system.type, system.count, system.render_type = "HAIR", 100, "OBJECT"
    system.instance_object, system.display_percentage = cube("Leaf", half=0.01), 10


KINDS = [only_in_renders, only_in_the_viewport, finer_in_renders, simplified, curve, metaball, fewer_particles]


def shapes(taken):
    """Number of faces and highest point of what occludes, sorted."""
    return sorted(
        (len(ob.mesh.face_start), round(float((ob.mesh.positions @ ob.matrix[:3, :3].T + ob.matrix[:3, 3]).max()), 5))
        for ob in taken.occluders
    )


def as_cycles_has_it():
    """The same as Blender's own depsgraph of a render: what a render engine is given."""
    found = []

    class Engine(bpy.types.RenderEngine):
        bl_idname, bl_label = "OBSCURANCE_TEST", "Test"

        def render(self, depsgraph):
            for instance in depsgraph.object_instances:
                ob = instance.object
                if instance.show_self and isinstance(ob.data, bpy.types.Mesh) and ob.original.name != "Floor":
                    points = np.array([instance.matrix_world @ vertex.co for vertex in ob.data.vertices])
                    found.append((len(ob.data.polygons) + 1, round(float(points.max()), 5)))

    bpy.utils.register_class(Engine)
    scene = bpy.context.scene
    former = scene.render.engine
    try:
        scene.render.engine = Engine.bl_idname
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)
        scene.render.resolution_x = scene.render.resolution_y = 8
        bpy.ops.render.render()
    finally:
        scene.render.engine = former
        bpy.utils.unregister_class(Engine)
    return sorted(found)


@pytest.mark.parametrize("build", KINDS)
def test_what_is_read_is_what_an_engine_renders(build):
    """Face by face, and nothing is left changed."""
    ob = floor()
    build()
    shown = shapes(read(ob, modifiers=Modifiers.VIEWPORT))
    before, simplify = file_state(), bpy.context.scene.render.simplify_subdivision
    rendered = read(ob)
    assert file_state() == before
    assert bpy.context.scene.render.simplify_subdivision == simplify
    assert shapes(read(ob, modifiers=Modifiers.VIEWPORT)) == shown != shapes(rendered)
    assert not notes_about(rendered.notes, "baked as the viewport")
    assert np.allclose(shapes(rendered), as_cycles_has_it(), atol=2e-5)


@pytest.mark.parametrize("build", [kind for kind in KINDS if kind is not metaball])
def test_what_renders_otherwise_is_named(build):
    ob = floor()
    build()
    taken = read(ob, modifiers=Modifiers.VIEWPORT)
    assert notes_about(taken.notes, "renders use other modifiers or levels", "'Thing'", "--modifiers RENDER")


def test_what_renders_alike_is_not_named():
    """Also where Simplify makes two levels one, and where an object does not render."""
    ob = floor()
    thing = cube("Thing")
    modifier = thing.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 3
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision, render.simplify_subdivision_render = True, 1, 1
    assert not notes_about(read(ob, modifiers=Modifiers.VIEWPORT).notes, "renders use other")
    render.use_simplify = False
    assert notes_about(read(ob, modifiers=Modifiers.VIEWPORT).notes, "renders use other")
    thing.hide_render = True
    assert not notes_about(read(ob, modifiers=Modifiers.VIEWPORT).notes, "renders use other")


def test_the_baked_object_itself_has_its_render_levels():
    """Values of 4^2 faces return to each of the six of a cube."""
    ob = cube()
    modifier = ob.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2
    (part,) = read(ob).baked
    assert len(part.snapshot.mesh.face_start) == 6 * 16 + 1
    assert np.bincount(part.snapshot.mesh.face_origin).tolist() == [0] + [16] * 6
