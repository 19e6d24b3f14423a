"""Settings on the scene: what they mean to the core, and that they live in the file."""

import math

import bpy
import pytest

from obscurance_addon.blender.reading.as_rendered import Modifiers
from obscurance_addon.core.errors import SettingsError
from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.light.settings import Ambient, LightSettings, Quantity
from obscurance_addon.core.lightmap.settings import LightmapSettings, Unwrapper, UvMode
from obscurance_addon.core.order.output import ImageFormat, OutputSettings, Scale, SharedMeshes, Target
from obscurance_addon.core.settings import MAX_RAYS_PER_PATCH, BakeSettings, Sampler

OTHER = {
    "rays": 128,
    "distance_mode": "METRES",
    "distance": 2.5,
    "falloff": "LINEAR",
    "use_bleeding": False,
    "scale": "PAPER",
    "modifiers": "RENDER",
    "sampler": "RANDOM",
    "seed": 7,
    "threads": 3,
    "target": "POINT",
    "attribute_name": "Shade",
    "shared_meshes": "AVERAGE",
    "ray_budget": 5000,
    "corner_copy": False,
    "quantity": "RADIOSITY",
    "ambient": "EMISSION",
    "reflector_mode": "NUMBER",
    "reflectors": 16,
    "indirect_only": True,
    "exposure": -1.5,
    "lightmap_size": 2048,
    "resolution_mode": "DENSITY",
    "texels_per_metre": 32.0,
    "uv_mode": "KEEP",
    "unwrapper": "XATLAS",
    "uv_map": "UVMap",
    "margin": 8,
    "adaptive": False,
    "error_bound": 0.125,
    "image_path": "//map.png",
    "image_format": "PNG_16",
}
PREVIEW = {"live_preview", "preview_mode", "preview_memory", "frame_cache"}  # of a scene, in no preset


@pytest.fixture
def group(empty_scene):
    return empty_scene.obscurance


def change_all(group):
    for name, value in OTHER.items():
        setattr(group, name, value)


def values(group):
    return {name: getattr(group, name) for name in OTHER}


def test_there_are_these_settings_and_no_others(group):
    """What a script or a saved file may rely on."""
    own = {p.identifier for p in group.bl_rna.properties} - {"rna_type", "name", "bl_system_idprops"}
    assert own == set(OTHER) | PREVIEW


def test_defaults_are_those_of_the_core(group):
    """An untouched scene asks for what the core does by itself."""
    assert group.to_settings() == BakeSettings()
    assert group.to_output() == OutputSettings()
    assert group.to_light() == LightSettings()
    assert group.to_lightmap() == LightmapSettings()
    assert group.distance_mode == "AUTO"


def test_every_setting_reaches_the_core(group):
    """Each of them in another state than its default."""
    assert all(getattr(group, name) != value for name, value in OTHER.items())
    change_all(group)
    assert group.to_settings() == BakeSettings(
        rays=128,
        ray_budget=5000,
        distance=2.5,
        falloff=Falloff.LINEAR,
        use_bleeding=False,
        sampler=Sampler.RANDOM,
        seed=7,
        threads=3,
    )
    assert group.to_output() == OutputSettings(
        target=Target.POINT,
        attribute_name="Shade",
        scale=Scale.PAPER,
        shared_meshes=SharedMeshes.AVERAGE,
        corner_copy=False,
        exposure=-1.5,
        image_path="//map.png",
        image_format=ImageFormat.PNG_16,
    )
    assert group.to_lightmap() == LightmapSettings(
        size=2048,
        texels_per_metre=32.0,
        uv_mode=UvMode.KEEP,
        unwrapper=Unwrapper.XATLAS,
        uv_map="UVMap",
        margin=8,
        adaptive=False,
        error_bound=0.125,
    )
    assert group.to_light() == LightSettings(
        quantity=Quantity.RADIOSITY, ambient=Ambient.EMISSION, reflectors=16, indirect_only=True
    )
    assert group.to_modifiers() is Modifiers.RENDER


def test_every_choice_of_the_core_can_be_made(group):
    """Menus list exactly what the core knows."""
    for name, kind in (
        ("falloff", Falloff),
        ("sampler", Sampler),
        ("target", Target),
        ("scale", Scale),
        ("shared_meshes", SharedMeshes),
        ("quantity", Quantity),
        ("ambient", Ambient),
        ("uv_mode", UvMode),
        ("unwrapper", Unwrapper),
        ("modifiers", Modifiers),
        ("image_format", ImageFormat),
    ):
        items = group.bl_rna.properties[name].enum_items
        assert {item.identifier for item in items} == {member.value for member in kind}
        assert all(item.name and item.description for item in items)


def test_settings_survive_saving_and_loading(group, tmp_path):
    """All of them, in their other state."""
    change_all(group)
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert values(bpy.context.scene.obscurance) != OTHER
    bpy.ops.wm.open_mainfile(filepath=path)
    assert values(bpy.context.scene.obscurance) == OTHER


def test_scenes_have_settings_of_their_own(group):
    """Changing one leaves another as it was."""
    other = bpy.data.scenes.new("Other")
    change_all(group)
    assert values(other.obscurance) != OTHER
    assert other.obscurance.to_settings() == BakeSettings()


def test_changes_given_to_a_call_leave_the_scene_alone(group):
    """As the command line does with its options."""
    assert group.to_settings(rays=8, distance=3.0) == BakeSettings(rays=8, distance=3.0)
    assert group.to_output(target="POINT").target is Target.POINT
    assert group.to_settings() == BakeSettings()


def test_a_distance_of_0_says_what_to_do(group):
    """Only when metres are asked for."""
    group.distance = 0.0
    assert group.to_settings().distance is None
    group.distance_mode = "METRES"
    with pytest.raises(SettingsError, match=r"distance is 0 m.*give a distance above 0, or use the automatic distance"):
        group.to_settings()


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("rays", 0, 1),
        ("rays", 1 << 30, MAX_RAYS_PER_PATCH),
        ("seed", -1, 0),
        ("threads", -1, 0),
        ("threads", 5000, 1024),
        ("distance", -1.0, 0.0),
        ("ray_budget", -1, 0),
        ("lightmap_size", 100, 256),
        ("lightmap_size", 10000, 8192),
        ("margin", 100, 64),
    ],
)
def test_values_out_of_range_are_clamped(group, name, value, kept):
    """So that the core never sees them."""
    setattr(group, name, value)
    assert getattr(group, name) == kept
    assert isinstance(group.to_settings(), BakeSettings)
    assert isinstance(group.to_lightmap(), LightmapSettings)


def test_a_budget_of_0_means_none(group):
    """Rays per patch count then."""
    assert group.ray_budget == 0
    assert group.to_settings().ray_budget is None
    group.ray_budget = 1000
    assert group.to_settings().ray_budget == 1000


def test_distances_follow_the_scenes_units(group):
    """The value is in Blender's own units, shown as a length; infinity cannot be typed, so it stays finite."""
    prop = group.bl_rna.properties["distance"]
    assert (prop.unit, prop.subtype) == ("LENGTH", "DISTANCE")
    group.distance = math.inf
    assert math.isfinite(group.distance)
