"""Blender's lights and world in Blender's own units: what we bake is what Cycles' direct diffuse bake says."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.core.errors import SettingsError
from obscurance_addon.core.light.settings import Quantity
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import Target
from tests.blender.helpers import bake, colors, cube, floor, material, new_collection, notes_about, sheet
from tests.blender.reading.light_helpers import (
    cycles_on_faces,
    diffuse,
    direct_on_faces,
    lamp,
    probes,
    relative_rmse,
    set_world,
)

pytestmark = pytest.mark.usefixtures("empty_scene")

SINCE_4_5 = bpy.app.version >= (4, 5, 0)
PLACE = (0.2, 0.1, 1.0)
LAMPS = {
    "point": ("POINT", {"energy": 50, "shadow_soft_size": 0.1}),
    "soft point": ("POINT", {"energy": 50, "shadow_soft_size": 0.5}),
    "ball": ("POINT", {"energy": 50, "shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "hard point": ("POINT", {"energy": 50, "shadow_soft_size": 0.0}),
    "point in colour": ("POINT", {"energy": 50, "color": (1.0, 0.5, 0.1)}),
    "spot": ("SPOT", {"energy": 50, "spot_size": 1.2, "spot_blend": 0.4, "rotation": (0.3, 0.2, 0.0)}),
    "sharp spot": ("SPOT", {"energy": 50, "spot_size": 1.2, "spot_blend": 0.0, "rotation": (0.3, 0.2, 0.0)}),
    "stretched spot": ("SPOT", {"energy": 50, "spot_size": 1.2, "spot_blend": 0.5, "scale": (3.0, 2.0, 1.5)}),
    "sun": ("SUN", {"energy": 3, "angle": 0.5, "rotation": (0.5, 0.0, 0.0)}),
    "hard sun": ("SUN", {"energy": 3, "angle": 0.0, "rotation": (0.5, 0.0, 0.0)}),
    "square": ("AREA", {"energy": 50, "shape": "SQUARE", "size": 0.7}),
    "rectangle": ("AREA", {"energy": 50, "shape": "RECTANGLE", "size": 1.0, "size_y": 0.5, "rotation": (0.3, 0, 0)}),
    "disk": ("AREA", {"energy": 50, "shape": "DISK", "size": 0.6}),
    "ellipse": ("AREA", {"energy": 50, "shape": "ELLIPSE", "size": 1.0, "size_y": 0.5, "rotation": (0.3, 0.3, 0)}),
    "stretched area": (
        "AREA",
        {"energy": 50, "shape": "RECTANGLE", "size": 1, "size_y": 0.5, "scale": (2.0, 1.0, 1.0)},
    ),
    "beam": ("AREA", {"energy": 50, "shape": "SQUARE", "size": 0.6, "spread": 1.0}),
}
NEW_LAMPS = {
    "exposure": ("POINT", {"energy": 50, "exposure": 1.5}),
    "temperature": ("POINT", {"energy": 50, "use_temperature": True, "temperature": 3000}),
    "point by area": ("POINT", {"energy": 50, "normalize": False, "shadow_soft_size": 0.2}),
    "hard point by area": ("POINT", {"energy": 50, "normalize": False, "shadow_soft_size": 0.0}),
    "sun by area": ("SUN", {"energy": 3, "normalize": False, "angle": 0.5}),
    "ellipse by area": ("AREA", {"energy": 50, "normalize": False, "shape": "ELLIPSE", "size": 1.0, "size_y": 0.5}),
}


def white_probes():
    made = probes()
    made.data.materials.append(diffuse("Probe", (0.8, 0.6, 0.4)))
    return made


def add(kind, values, **kw):
    values = dict(values)
    place = {key: values.pop(key) for key in ("rotation", "scale") if key in values}
    return lamp(kind, PLACE, **place, **kw, **values)


@pytest.mark.parametrize("name", [*LAMPS, *(NEW_LAMPS if SINCE_4_5 else [])])
def test_each_light_is_as_bright_as_in_cycles(name):
    """Tiny faces, where a face's mean is its value: half a percent, far above our noise and what Cycles has left."""
    ob = white_probes()
    add(*(LAMPS | NEW_LAMPS)[name])
    assert relative_rmse(direct_on_faces(ob), cycles_on_faces(ob, 256)) < 0.005


def test_shining_faces_and_world_are_as_bright_as_in_cycles():
    """An open sheet that shines to both sides, a closed box that casts a shadow, and a blue sky."""
    ob = white_probes()
    set_world((0.5, 0.7, 1.0), 0.5)
    shining = sheet("Sheet", (0.0, 0.0, 0.5), (0.5, 0, 0), (0, 0.5, 0))
    shining.data.materials.append(diffuse("Glow", (0.0, 0.0, 0.0), (5.0, 4.0, 3.0)))
    cube("Box", half=0.3).location = (-0.8, -0.5, 0.4)
    assert relative_rmse(direct_on_faces(ob), cycles_on_faces(ob)) < 0.01


def one_of_each():
    """A room without ceiling with blocks, and a light of every kind; its floor of 24 x 24 faces."""
    ob = floor(n=24, size=4.0)
    ob.data.materials.append(diffuse("Floor", (0.8, 0.6, 0.4)))
    sheet("Wall", (2.0, -2.0, 0.0), (0, 4, 0), (0, 0, 1.5)).data.materials.append(diffuse("Wall", (0.7, 0.7, 0.7)))
    cube("Block", half=0.3).location = (-0.5, 0.4, 0.301)
    cube("Floating", half=0.2).location = (0.7, -0.6, 0.6)
    for place, name in zip(
        [(-1.5, -1.5, 0.8), (1.2, 1.2, 1.5), (0, 0, 2), (-1.2, 1.2, 1.2), (0, -1.5, 1), (1.5, 0, 1.8), (0, 1.5, 1.5)],
        ["point", "spot", "sun", "square", "rectangle", "disk", "ellipse"],
        strict=True,
    ):
        kind, values = LAMPS[name]
        values = {**values, "energy": 0.3 if kind == "SUN" else 10.0}
        turned = values.pop("rotation", (0.0, 0.0, 0.0))
        lamp(kind, place, turned, **values)
    glow = cube("Glow", half=0.1)
    glow.location = (-1.5, 0.0, 0.4)
    glow.data.materials.append(diffuse("Glow", (0.0, 0.0, 0.0), (8.0, 4.0, 2.0)))
    set_world((0.1, 0.15, 0.2))
    return ob


def subdivided(ob, parts):
    """A copy whose faces are cut into parts x parts, without anything else changed."""
    copy = floor("Fine", n=24 * parts, size=4.0)
    copy.data.materials.append(ob.data.materials[0])
    ob.hide_render = True
    return copy


def test_one_light_of_each_kind():
    """Relative RMSE at most 2 % on ordinary faces of 17 cm, whose mean Cycles gives on a floor of 36 times as many."""
    ob = one_of_each()
    found = direct_on_faces(ob, 256)
    fine = cycles_on_faces(subdivided(ob, 6), 64)
    exact = fine.reshape(24, 6, 24, 6, 3).mean((1, 3)).reshape(-1, 3)
    assert relative_rmse(found, exact) < 0.02
    assert found.mean() / exact.mean() == pytest.approx(1.0, abs=2e-3)


def test_lights_of_instances_and_other_frames():
    """A light in an instanced collection stands where its instance stands."""
    ob = white_probes()
    collection = new_collection("Lamps", linked=False)
    made = lamp("POINT", (0.0, 0.0, 1.0), energy=50)
    bpy.context.scene.collection.objects.unlink(made)
    collection.objects.link(made)
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(instance)
    instance.location = (0.7, 0.0, 0.0)
    brightest = direct_on_faces(ob, 64).sum(1).argmax()
    x, y, _ = ob.data.polygons[brightest].center
    assert abs(x - 0.7) < 0.1
    assert abs(y) < 0.1


def test_lights_without_shadow():
    ob = white_probes()
    lamp("POINT", energy=50, shadow_soft_size=0.0, use_shadow=False)
    open_floor = direct_on_faces(ob, 64)
    cube("Box", half=0.2).location = (0.0, 0.0, 0.5)
    np.testing.assert_array_equal(direct_on_faces(ob, 64), open_floor)


def test_nodes_of_a_light():
    """Strength 2 and a colour multiply what the light is."""
    ob = white_probes()
    made = lamp("POINT", energy=50)
    plain = direct_on_faces(ob, 64)
    if bpy.app.version < (5, 3, 0):  # newer lights always use nodes
        made.data.use_nodes = True
    node = next(n for n in made.data.node_tree.nodes if n.bl_idname == "ShaderNodeEmission")
    node.inputs["Strength"].default_value, node.inputs["Color"].default_value = 2.0, (1.0, 0.5, 0.0, 1.0)
    np.testing.assert_allclose(direct_on_faces(ob, 64), plain * [2.0, 1.0, 0.0], rtol=1e-5)


def notes_of(*objects):
    bpy.context.view_layer.update()
    return snapshot_scene(bpy.context, objects, needs_light=True).notes


def test_lights_that_light_nothing_are_named():
    """No power, no size, invisible to diffuse rays: named in one line; portals are none of them."""
    ob = floor()
    lamp("POINT", name="Dead", energy=0.0)
    lamp("AREA", name="Flat", size=0.0)
    lamp("AREA", name="Needle", shape="RECTANGLE", size=1.0, scale=(1.0, 0.0, 1.0))
    lamp("POINT", name="Blind").visible_diffuse = False
    portal = lamp("AREA", name="Portal")
    portal.data.cycles.is_portal = True
    (note,) = notes_about(notes_of(ob), "light nothing")
    assert all(name in note for name in ("'Dead'", "'Flat'", "'Needle'", "'Blind'"))
    assert "Portal" not in note
    lamp("POINT", name="Void", energy=-5.0)
    assert notes_about(notes_of(ob), "'Void'", "negative power")


@pytest.mark.parametrize(
    ("values", "place"),
    [
        ({"energy": float("inf")}, (0.0, 0.0, 1.0)),
        ({"energy": float("nan")}, (0.0, 0.0, 1.0)),
        ({"energy": 50.0}, (float("nan"), 0.0, 1.0)),
    ],
)
def test_lights_that_are_not_finite_are_left_out_and_named(values, place):
    ob = floor()
    lamp("POINT", place, name="Astray", **values)
    report = bake(ob, quantity="COMBINED")
    assert notes_about(report.warnings, "'Astray'", "no finite number")
    assert not colors(ob).any()


def test_a_world_beyond_all_bounds_stays_finite():
    ob = floor()
    set_world((1.0, 1.0, 1.0), float("inf"))
    bake(ob, quantity="COMBINED")
    assert np.isfinite(colors(ob)).all()


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_inside_of_a_ball_of_light():
    """No number is divided by zero, and light comes from all sides."""
    ob = floor(n=2)
    lamp("POINT", (0.0, 0.0, 1.0), energy=50.0, shadow_soft_size=5.0, use_soft_falloff=False)
    bake(ob, quantity="DIRECT")
    assert colors(ob).min() > 0.0


@pytest.mark.parametrize("radius", [0.0, 1e-20])
def test_lights_without_radius_are_points(radius):
    ob = white_probes()
    made = lamp("POINT", energy=50, shadow_soft_size=radius)
    found = direct_on_faces(ob, 16)
    made.data.shadow_soft_size = 1e-3
    np.testing.assert_allclose(found, direct_on_faces(ob, 16), rtol=1e-4)


def test_a_light_inside_a_wall_is_named():
    ob = floor()
    cube("Wall", half=0.2).location = (0.0, 0.0, 0.5)
    lamp("POINT", (0.0, 0.0, 0.5), name="Buried")
    report = bake(ob, quantity="DIRECT")
    assert notes_about(report.warnings, "reach no surface", "'Buried'", "move it out")
    assert not colors(ob).any()


@pytest.mark.parametrize("world", ["none", "black", "plain"])
def test_a_scene_without_light_is_black_and_said(world):
    ob = floor()
    bpy.context.scene.world = None
    if world == "black":
        set_world((0.0, 0.0, 0.0))
    elif world == "plain" and bpy.app.version < (5, 0, 0):
        bpy.context.scene.world = bpy.data.worlds.new("Plain")
        bpy.context.scene.world.color = (0.0, 0.0, 0.0)
    for quantity in ("DIRECT", "AMBIENT", "COMBINED"):
        report = bake(ob, quantity=quantity)
        assert notes_about(report.warnings, "nothing shines", "add a light")
        assert np.isfinite(colors(ob)).all()
        assert not colors(ob).any()


def test_white_surfaces_stay_finite():
    """R = 1 is clamped, so that the ambient light has a value."""
    ob = floor(n=4, color=(1.0, 1.0, 1.0))
    cube("Cube", half=0.3, color=(1.0, 1.0, 1.0)).location = (0, 0, 0.3)
    lamp("POINT", energy=50)
    report = bake(ob, quantity="COMBINED")
    assert np.isfinite(colors(ob)).all()
    assert all(0.0 < x < np.inf for x in report.ambient_light)


def test_animated_lights_are_baked_at_the_current_frame():
    ob = white_probes()
    made = lamp("POINT", name="Moving", energy=50)
    for frame, x in ((1, -1.0), (11, 1.0)):
        made.location.x = x
        made.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(11)
    report = bake(ob, quantity="DIRECT", rays=64)
    assert notes_about(report.warnings, "animated", "--frames", "'Moving'")
    assert ob.data.polygons[int(colors(ob).sum(1).argmax())].center.x > 0.8


def test_linked_lights_light(tmp_path):
    """A light from a library counts as any other."""
    path = str(tmp_path / "library.blend")
    made = lamp("POINT", name="Theirs", energy=50)
    ob = white_probes()
    own = direct_on_faces(ob, 64)
    bpy.data.libraries.write(path, {made})
    bpy.data.objects.remove(made)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Theirs"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    np.testing.assert_array_equal(direct_on_faces(ob, 64), own)


def test_light_linking_and_volumes_are_named():
    ob = floor()
    made = lamp("POINT", name="Picky", energy=50)
    made.light_linking.receiver_collection = new_collection("Chosen")
    fog = cube("Fog")
    fog.data.materials.append(material("Fog", (1, 1, 1)))
    tree = fog.data.materials[0].node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    end = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(scatter.outputs[0], end.inputs["Volume"])
    notes = notes_of(ob)
    assert notes_about(notes, "light linking is not supported", "'Picky'")
    assert notes_about(notes, "volumes are not supported", "'Fog'")
    assert not notes_about(snapshot_scene(bpy.context, [ob]).notes, "light linking")


def test_worlds_that_are_not_constant_are_named():
    set_world((0.2, 0.2, 0.2))
    tree = bpy.context.scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    assert notes_about(notes_of(floor()), "in the world: 'World'; give its Background node a plain color")


def test_worlds_whose_background_is_muted_or_missing_are_black():
    set_world((1.0, 1.0, 1.0))
    ob = floor()
    tree = bpy.context.scene.world.node_tree
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.mute = True
    bake(ob, quantity="DIRECT")
    assert not colors(ob).any()
    tree.nodes.remove(background)
    bake(ob, quantity="DIRECT")
    assert not colors(ob).any()


def test_faces_that_modifiers_bring_in_scatter_light_too():
    """A Boolean's cut faces belong to no face of the mesh, but they are patches of the scene."""
    ob, cutter = cube("Block", color=(0.5, 0.5, 0.5)), cube("Cutter", half=0.5, color=(0.9, 0.1, 0.1))
    cutter.location = (0.0, 0.0, 1.0)
    cutter.hide_render = True
    modifier = ob.modifiers.new("Cut", "BOOLEAN")
    modifier.object = cutter
    modifier.solver = "EXACT"
    bpy.context.view_layer.update()
    made = prepare_arrays(snapshot_scene(bpy.context, [ob], needs_light=True), Target.FACE, needs_light=True)
    assert len(made.patches) == 6
    assert len(made.others) > 0
    assert made.surfaces.patch.min() >= 0
    assert len(made.materials.reflectance) == 6 + len(made.others)


def test_lights_hidden_in_the_viewport_are_named():
    ob = floor()
    lamp("POINT", name="Asleep").hide_set(True)
    assert notes_about(notes_of(ob), "hidden in the viewport", "do not light", "'Asleep'")


def test_hidden_lights_do_not_light():
    ob = white_probes()
    made = lamp("POINT", energy=50)
    made.hide_render = True
    assert not direct_on_faces(ob, 16).any()


def test_combined_has_what_faces_emit():
    ob = floor(n=2)
    ob.data.materials.append(diffuse("Glow", (0.5, 0.5, 0.5), (3.0, 2.0, 1.0)))
    bake(ob, quantity="COMBINED")
    np.testing.assert_allclose(colors(ob), np.tile([3.0, 2.0, 1.0], (4, 1)), rtol=1e-5)
    bake(ob, quantity="DIRECT")
    assert not colors(ob).any()


def test_exposure_brightens_light_and_leaves_obscurances_alone():
    ob = floor(n=2, color=(0.5, 0.5, 0.5))
    lamp("POINT", energy=50)
    bake(ob, quantity="DIRECT")
    plain = colors(ob).copy()
    report = bake(ob, quantity="DIRECT", exposure=-3.0)
    np.testing.assert_allclose(colors(ob), plain / 8.0, rtol=1e-6)
    bake(ob, exposure=5.0)
    np.testing.assert_allclose(colors(ob), 1.0, rtol=1e-6)
    assert max(report.rmse) < 0.1
    with pytest.raises(SettingsError, match="exposure is 33 stops"):
        bake(ob, quantity="DIRECT", exposure=33.0)


def test_radiosity_needs_whole_faces():
    ob = floor()
    with pytest.raises(SettingsError, match="use target FACE, or bake COMBINED"):
        bake(ob, quantity="RADIOSITY", target="CORNER")


@pytest.mark.parametrize("quantity", Quantity)
@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_every_quantity_on_every_target(quantity, target):
    """A floor beside a red wall: finite, bright where there is light, red where light is bled."""
    if quantity is Quantity.RADIOSITY and target != "FACE":
        return
    ob = floor(n=4, size=2.0, color=(0.8, 0.8, 0.8))
    sheet("Wall", (1.0, 1.0, 0.0), (0, -2, 0), (0, 0, 2), 4, 4, color=(0.8, 0.05, 0.05))
    lamp("POINT", (0.0, 0.0, 0.8), energy=50)
    report = bake(ob, quantity=quantity, target=target, rays=64, distance=2.0, threads=0)
    found = colors(ob)
    assert np.isfinite(found).all()
    assert found.min() >= 0.0
    if quantity is not Quantity.DIRECT:
        last = found[-1] if target == "FACE" else found.reshape(-1, 3)[found[:, 1].argmin()]
        assert last[0] > 1.02 * last[1]
    assert report.quantity is quantity
    assert (report.ambient_light is not None) == (quantity in (Quantity.AMBIENT, Quantity.COMBINED))
    assert str(quantity.value.lower()) in report.summary() or quantity is Quantity.OBSCURANCE


def test_modifiers_and_shared_meshes_take_light_too():
    """A subdivided floor and its twin: values per base face, a mesh each."""
    ob = floor(n=2, color=(0.5, 0.5, 0.5))
    ob.modifiers.new("Subdivision", "SUBSURF").subdivision_type = "SIMPLE"
    twin = bpy.data.objects.new("Twin", ob.data)
    bpy.context.scene.collection.objects.link(twin)
    twin.location.x = 2.0
    lamp("POINT", (-0.5, 0.0, 0.5), energy=50)
    bake(ob, twin, quantity="RADIOSITY", rays=256)
    assert ob.data != twin.data
    assert colors(ob).min() > 5.0 * colors(twin).max()
