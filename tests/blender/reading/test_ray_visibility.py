"""Ray Visibility as in Cycles: what throws no shadow does not occlude, what diffuse rays do not see gives no colour."""

import bpy
import numpy as np
import pytest

from obscurance_addon.core.order.output import Scale
from tests.blender.helpers import bake, baked, colors, floor, new_collection, snapshot
from tests.blender.reading.light_helpers import cycles_ao_on_faces, lamp

pytestmark = pytest.mark.usefixtures("empty_scene")

FLAGS = {
    "plain": {},
    "no shadow": {"visible_shadow": False},
    "no camera": {"visible_camera": False},
    "no diffuse": {"visible_diffuse": False},
    "no glossy": {"visible_glossy": False},
    "no diffuse, no shadow": {"visible_diffuse": False, "visible_shadow": False},
    "holdout": {"is_holdout": True},
    "shadow catcher": {"is_shadow_catcher": True},
}


def with_card(**flags):
    ob = floor(n=2, color=(0.5, 0.5, 0.5))
    card = floor("Card", size=8.0, z=0.05, color=(0.9, 0.1, 0.1))
    for name, value in flags.items():
        setattr(card, name, value)
    return ob, card


@pytest.mark.parametrize("name", FLAGS)
def test_what_occludes_is_what_occludes_in_cycles(name):
    """Classical ambient occlusion below a card: 0 or 1, as Cycles' own bake has it."""
    ob, _card = with_card(**FLAGS[name])
    ours = baked(ob, falloff="STEP", use_bleeding=False, rays=64)[:, 0]
    cycles = cycles_ao_on_faces(ob, distance=1.0)
    assert set(np.round(cycles, 2)) in ({0.0}, {1.0})
    assert np.allclose(ours, cycles, atol=0.01)


@pytest.mark.parametrize("flag", ["visible_shadow", "visible_diffuse"])
def test_it_is_baked_all_the_same(flag):
    """An object that is not seen by others sees them, and so does one that is beside itself."""
    ob, card = with_card(**{flag: False})
    ob.location.z = 0.1
    values = baked(card, falloff="STEP", use_bleeding=False, rays=64)
    assert values[0, 0] < 0.98
    ob.hide_render = True
    assert np.allclose(baked(card), 1.0, atol=1e-6)


def test_a_colour_that_diffuse_rays_do_not_see_tints_nothing():
    """Below a red card the floor is red; where Diffuse is off it is dark and grey."""
    ob, card = with_card()
    card.location.z = 0.4
    red, _green, blue = baked(ob, rays=64, scale=Scale.PAPER).mean(0)
    assert red > 3.0 * blue
    card.visible_diffuse = False
    found = baked(ob, rays=64, scale=Scale.PAPER)
    assert np.ptp(found, axis=1).max() < 1e-6
    assert found.mean() < red


@pytest.mark.parametrize("flag", ["visible_shadow", "visible_diffuse"])
@pytest.mark.parametrize("owner", ["Thing", "Instance"])
def test_instances_take_the_flags_of_what_they_show_and_of_who_shows_it(owner, flag):
    """As in Cycles, which renders an instance with the flags that both have."""
    ob = floor(n=2)
    assets = new_collection("Assets", linked=False)
    floor("Thing", size=8.0, z=0.05, collection=assets)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", assets
    bpy.context.scene.collection.objects.link(empty)
    setattr(bpy.data.objects[owner], flag, False)
    (part,) = snapshot(ob).occluders
    assert (part.occludes, part.gives_color) == (flag != "visible_shadow", flag != "visible_diffuse")
    ours = baked(ob, falloff="STEP", use_bleeding=False, rays=64)[:, 0]
    assert np.allclose(ours, cycles_ao_on_faces(ob, distance=1.0), atol=0.01)


@pytest.mark.parametrize("throws", [True, False])
def test_the_sun_shines_through_what_throws_no_shadow(throws):
    """Strength pi on a floor of reflectance .5 is a radiance of .5."""
    ob, _card = with_card(visible_shadow=throws)
    lamp("SUN", location=(0.0, 0.0, 5.0), energy=np.pi)
    bake(ob, quantity="DIRECT", rays=64)
    assert np.allclose(colors(ob), 0.0 if throws else 0.5, atol=1e-5)
