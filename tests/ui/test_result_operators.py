"""What artists do with a result: look at it, copy it for export; and the presets, tooltips and ids around the bake."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.properties.scene_settings import setting_names
from tests.blender.helpers import CORNER_LAYER, FACE_LAYER, colors, file_state, floor, put, read, select, sheet

pytestmark = pytest.mark.usefixtures("empty_scene")
BRIGHT = 1.25
COPIES = [("GLTF", "COLOR_0", "FLOAT_COLOR"), ("USD", "displayColor", "FLOAT_COLOR"), ("ALEMBIC", "Cd", "BYTE_COLOR")]


@pytest.fixture
def baked():
    """A floor beside a red wall, baked; some of its corners are brighter than 1."""
    ob = floor(n=3)
    sheet("Wall", (-1, -1, 0), (0, 2, 0), (0, 0, 1), color=(0.9, 0.1, 0.1))
    select(ob)
    bpy.context.scene.obscurance.rays = 16
    bpy.ops.obscurance.bake()
    for name in (FACE_LAYER, CORNER_LAYER):
        layer = ob.data.attributes[name].data
        layer[0].color = (BRIGHT, 0.5, 0.25, 1.0)
    return ob


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_every_target_can_be_copied(baked, target):
    """To one colour for each corner."""
    settings = bpy.context.scene.obscurance
    settings.target = target
    bpy.ops.obscurance.bake()
    bpy.ops.obscurance.copy_for_export(format="USD")
    copy = baked.data.attributes["displayColor"]
    assert (copy.domain, len(copy.data)) == ("CORNER", len(baked.data.loops))
    source = baked.data.attributes[FACE_LAYER]
    for polygon in baked.data.polygons:
        for corner in polygon.loop_indices:
            index = {"FACE": polygon.index, "CORNER": corner, "POINT": baked.data.loops[corner].vertex_index}[target]
            assert copy.data[corner].color[:3] == source.data[index].color[:3]


def test_nothing_to_copy_is_an_error_that_says_what_to_do():
    """An object that was never baked gets no layer."""
    ob = floor()
    select(ob)
    with pytest.raises(RuntimeError, match=r"No selected object has a baked attribute 'Obscurance'.*bake first"):
        bpy.ops.obscurance.copy_for_export(format="USD")
    assert not len(ob.data.color_attributes)


def test_a_vertex_group_of_the_same_name_is_not_replaced(baked):
    """The object is named, and no layer is made."""
    baked.vertex_groups.new(name="Cd")
    with pytest.raises(RuntimeError, match="'Floor' has a vertex group named 'Cd'"):
        bpy.ops.obscurance.copy_for_export(format="ALEMBIC")
    assert "Cd" not in baked.data.attributes


def test_the_result_is_not_replaced_by_its_copy(baked):
    """When it has the name that the format wants."""
    bpy.context.scene.obscurance.attribute_name = "Cd"
    bpy.ops.obscurance.bake()
    with pytest.raises(RuntimeError, match="would replace the result itself, 'Cd'"):
        bpy.ops.obscurance.copy_for_export(format="ALEMBIC")
    assert (baked.data.attributes["Cd"].domain, baked.data.attributes["Cd"].data_type) == ("FACE", "FLOAT_COLOR")


@pytest.mark.parametrize(("export_format", "name", "data_type"), COPIES)
@pytest.mark.parametrize("imported", [True, False])
def test_a_layer_of_the_users_is_not_replaced_by_a_copy(baked, export_format, name, data_type, imported):
    """As importers make it or of another kind: object, layer and cure are named, and nothing is copied."""
    other = floor("Other", z=2.0)
    select(baked, other)
    bpy.ops.obscurance.bake()
    put(other.data, name, *((data_type, "CORNER") if imported else ("FLOAT", "POINT")))
    before = file_state()
    kind = "color attribute" if imported else "attribute"
    message = (
        f"'Other' has a {kind} named '{name}', which a copy for export must not replace: rename or remove the {kind}"
    )
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.obscurance.copy_for_export(format=export_format)
    assert file_state() == before


@pytest.mark.parametrize(("export_format", "name", "data_type"), COPIES)
def test_a_copy_is_made_anew_after_another_bake(baked, export_format, name, data_type):
    """What the first copy made, the second one may fill, painted over or not; a changed type makes it the user's."""
    bpy.ops.obscurance.copy_for_export(format=export_format)
    first = read(baked.data, name)
    baked.data.attributes[name].data[0].color = (0.5, 0.5, 0.5, 0.5)
    bpy.ops.obscurance.copy_for_export(format=export_format)
    assert np.array_equal(read(baked.data, name), first)
    baked.data.attributes.remove(baked.data.attributes[name])
    put(baked.data, name, "BYTE_COLOR" if data_type == "FLOAT_COLOR" else "FLOAT_COLOR", "CORNER")
    with pytest.raises(RuntimeError, match=f"has a color attribute named '{name}'"):
        bpy.ops.obscurance.copy_for_export(format=export_format)


# -------------------------------------------------------------------------------------------------------------- showing


@pytest.fixture
def view():
    """A 3D view of a window that nobody sees."""
    bpy.ops.wm.read_factory_settings()
    area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
    return area


def test_showing_the_result_and_going_back(view):
    """To exactly the shading that was there before."""
    space = view.spaces.active
    space.shading.type, space.shading.light, space.shading.color_type = "SOLID", "MATCAP", "OBJECT"
    space.shading.type = "WIREFRAME"
    select(bpy.data.objects["Cube"])
    bpy.ops.obscurance.bake()
    bpy.data.meshes["Cube"].color_attributes.new("Mine", "BYTE_COLOR", "CORNER")
    bpy.data.meshes["Cube"].attributes.active_color_name = "Mine"
    shading = ("type", "light", "color_type")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=view, space_data=space):
        bpy.ops.obscurance.show_result()
        assert [getattr(space.shading, name) for name in shading] == ["SOLID", "FLAT", "VERTEX"]
        assert bpy.data.meshes["Cube"].attributes.active_color_name == CORNER_LAYER
        bpy.ops.obscurance.show_result()
    assert space.shading.type == "WIREFRAME"
    space.shading.type = "SOLID"
    assert [getattr(space.shading, name) for name in shading] == ["SOLID", "MATCAP", "OBJECT"]


def test_there_must_be_something_to_show(view):
    """The message says how to get it, and the shading stays."""
    space = view.spaces.active
    before = space.shading.color_type
    with (
        bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=view, space_data=space),
        pytest.raises(RuntimeError, match=r"No object in this view layer has a color 'Obscurance Color'.*bake first"),
    ):
        bpy.ops.obscurance.show_result()
    assert space.shading.color_type == before


# ------------------------------------------------------------------------------------------------------------- settings


def test_a_call_may_replace_settings_for_once(baked):
    """The scene keeps its own, and the next call starts from them again."""
    bpy.ops.obscurance.bake(use_bleeding=False)
    grey = colors(baked)
    assert np.array_equal(grey[:, 0], grey[:, 1])
    assert bpy.context.scene.obscurance.use_bleeding
    bpy.ops.obscurance.bake()
    assert not np.array_equal(colors(baked)[:, 0], colors(baked)[:, 1])


def test_a_distance_given_to_a_call_is_used(baked):
    """Although the scene says automatic."""
    bpy.ops.obscurance.bake()
    automatic = colors(baked)
    bpy.ops.obscurance.bake(distance=0.05)
    assert not np.array_equal(colors(baked), automatic)
    bpy.ops.obscurance.bake(distance=0.05, distance_mode="AUTO")
    assert np.array_equal(colors(baked), automatic)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Draft", {"rays": 16}),
        ("Standard", {"rays": 64}),
        ("Final", {"rays": 1024}),
        ("Classic_Ambient_Occlusion", {"use_bleeding": False, "falloff": "STEP", "scale": "WHITE"}),
        (
            "Paper_2003",
            {
                "use_bleeding": True,
                "falloff": "SQRT",
                "scale": "PAPER",
                "distance_mode": "AUTO",
                "ambient": "EMISSION",
                "reflector_mode": "NUMBER",
                "reflectors": 0,
            },
        ),
    ],
)
def test_presets_that_come_with_the_addon(name, expected):
    """Each sets what its name says, and where the result goes stays."""
    settings = bpy.context.scene.obscurance
    settings.attribute_name = "Mine"
    (folder,) = bpy.utils.preset_paths("obscurance_addon/bake")
    bpy.ops.script.execute_preset(filepath=f"{folder}/{name}.py", menu_idname="OBSCURANCE_PT_presets")
    assert {key: getattr(settings, key) for key in expected} == expected
    assert settings.attribute_name == "Mine"


def test_every_tooltip_is_a_sentence():
    """With a capital letter and several words, and without the full stop that Blender adds."""
    operators = set(dir(bpy.ops.obscurance)) - {"add_preset"}  # whose properties are Blender's own
    types = [getattr(bpy.ops.obscurance, name).get_rna_type() for name in operators]
    assert len(types) >= 5
    texts = [kind.description for kind in types]
    properties = [p for kind in types for p in kind.properties if not p.is_hidden and p.identifier != "rna_type"]
    group = bpy.context.scene.obscurance.bl_rna.properties
    properties += [group[name] for name in setting_names()]
    texts += [p.description for p in properties]
    texts += [item.description for p in properties if p.type == "ENUM" for item in p.enum_items]
    for text in texts:
        assert text[0].isupper(), text
        assert len(text.split()) >= 4, text
        assert not text.endswith("."), text
        assert "\n" not in text


def test_only_harmless_settings_can_be_keyed():
    """Where results go cannot change over time."""
    group = bpy.context.scene.obscurance.bl_rna.properties
    keyable = {name for name in setting_names() if group[name].is_animatable}
    assert keyable == {
        "use_bleeding",
        "distance_mode",
        "distance",
        "falloff",
        "rays",
        "scale",
        "seed",
        "ambient",
        "reflector_mode",
        "reflectors",
        "exposure",
    }
    bpy.context.scene.obscurance.keyframe_insert("distance", frame=1)
    with pytest.raises(TypeError):
        bpy.context.scene.obscurance.keyframe_insert("target", frame=1)
