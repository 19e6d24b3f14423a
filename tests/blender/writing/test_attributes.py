"""Which attributes a bake writes, and what happens to names that are taken."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.writing.layers import MAX_NAME_BYTES, AttributeNameError
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    colors,
    cube,
    file_state,
    floor,
    job,
    notes_about,
    put,
    read,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def kinds(ob):
    """(type, domain) of the attributes that hold colours."""
    found = {name: (a.data_type, a.domain) for name, a in ob.data.attributes.items()}
    return {name: kind for name, kind in found.items() if "COLOR" in kind[0]}


def scene():
    """A floor of 3 x 3 faces that a ceiling darkens."""
    floor("Ceiling", size=1.0, z=0.2)
    return floor(n=3)


def test_faces_get_a_face_attribute_and_a_flat_copy_on_their_corners():
    """Both FLOAT_COLOR; each corner has exactly its face's colour, alpha is 1, and the faces do differ."""
    ob = scene()
    bake(ob)
    assert kinds(ob) == {FACE_LAYER: ("FLOAT_COLOR", "FACE"), CORNER_LAYER: ("FLOAT_COLOR", "CORNER")}
    face, corner = read(ob.data, FACE_LAYER), read(ob.data, CORNER_LAYER)
    assert np.array_equal(corner, np.repeat(face, 4, axis=0))
    assert (face[:, 3] == 1.0).all()
    assert len(np.unique(face[:, 0])) > 1


def test_the_flat_copy_follows_faces_of_any_size():
    """A triangle, a quad and a pentagon: the corners of each repeat its colour, by Blender's own corner ranges."""
    vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0.5, 0), (0, 2, 0), (1, 2, 0), (0.5, 3, 0)]
    mesh = bpy.data.meshes.new("Mixed")
    mesh.from_pydata(vertices, [], [(1, 4, 2), (0, 1, 2, 3), (3, 2, 6, 7, 5)])
    ob = bpy.data.objects.new("Mixed", mesh)
    bpy.context.scene.collection.objects.link(ob)
    floor("Ceiling", size=2.6, z=0.2)
    bake(ob)
    face, corner = read(mesh, FACE_LAYER), read(mesh, CORNER_LAYER)
    for polygon in mesh.polygons:
        assert (corner[list(polygon.loop_indices)] == face[polygon.index]).all()
    assert len(np.unique(face[:, 0])) == 3


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("FACE", {"Shade": ("FLOAT_COLOR", "FACE")}),
        ("CORNER", {"Shade": ("FLOAT_COLOR", "CORNER")}),
        ("POINT", {"Shade": ("FLOAT_COLOR", "POINT")}),
    ],
)
def test_name_and_target_are_settings(target, expected):
    """One attribute of the name given, without a copy when that is switched off or not called for."""
    ob = scene()
    bake(ob, target=target, attribute_name="Shade", corner_copy=False)
    assert kinds(ob) == expected


@pytest.mark.parametrize(("target", "shown"), [("FACE", CORNER_LAYER), ("CORNER", FACE_LAYER), ("POINT", FACE_LAYER)])
def test_the_result_is_the_active_colour(target, shown):
    """What the viewport shows is the new layer; with no other colour it is what renders by default, too."""
    ob = scene()
    bake(ob, target=target)
    assert ob.data.color_attributes.active_color.name == shown
    assert ob.data.attributes.active_color_name == shown
    assert ob.data.attributes.default_color_name == shown


def test_a_face_attribute_alone_does_not_become_the_active_colour():
    """The viewport could not show it, and Vertex Paint would add a layer of its own."""
    ob = scene()
    bake(ob, corner_copy=False)
    assert not ob.data.attributes.active_color_name
    assert not ob.data.attributes.default_color_name
    ob.data.color_attributes.new("Mine", "BYTE_COLOR", "CORNER")
    before = ob.data.attributes.active_color_name, ob.data.attributes.default_color_name
    bake(ob, corner_copy=False)
    assert (ob.data.attributes.active_color_name, ob.data.attributes.default_color_name) == before


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_the_users_default_render_colour_stays(target):
    """Active is the result, default for renders is what the user chose."""
    ob = scene()
    for name in ("Mine", "Yours"):
        ob.data.color_attributes.new(name, "BYTE_COLOR", "CORNER")
    ob.data.attributes.default_color_name = "Yours"
    ob.data.attributes.active_color_name = "Mine"
    bake(ob, target=target)
    bake(ob, target=target)
    assert ob.data.attributes.default_color_name == "Yours"
    assert ob.data.attributes.active_color_name == (CORNER_LAYER if target == "FACE" else FACE_LAYER)


def test_baking_again_overwrites_in_place():
    """The same attributes with new values, no copies under other names, and nothing to report."""
    ob = scene()
    bake(ob)
    names, first = ob.data.attributes.keys(), colors(ob)
    report = bake(ob, seed=1)
    assert ob.data.attributes.keys() == names
    assert not np.array_equal(colors(ob), first)
    assert report.warnings == []
    bake(ob)
    assert np.array_equal(colors(ob), first)


@pytest.mark.parametrize(("before", "after"), [("FACE", "CORNER"), ("CORNER", "POINT"), ("POINT", "FACE")])
def test_a_result_of_another_target_is_replaced_and_said_so(before, after):
    """The new one has the right domain and the values of a bake onto a clean mesh; the note names mesh and old kind."""
    ob = scene()
    bake(ob, target=after)
    clean = colors(ob)
    bake(ob, target=before)
    report = bake(ob, target=after)
    assert kinds(ob)[FACE_LAYER] == ("FLOAT_COLOR", after)
    assert np.array_equal(colors(ob), clean)
    assert notes_about(report.warnings, "'Obscurance'", "mesh 'Floor'", "FLOAT_COLOR", before, "replaced")
    assert [name for name in ob.data.attributes.keys() if "." in name.lstrip(".")] == []  # noqa: SIM118


def refuses(*words, **changes):
    """The bake fails with all of these words, before it starts, and the file is as it was."""
    ob = bpy.data.objects["Floor"]
    before = file_state()
    with pytest.raises(AttributeNameError) as caught:
        job(bpy.data.objects["Ceiling"], ob, **changes)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert file_state() == before


@pytest.mark.parametrize(
    ("name", "data_type", "domain", "target"),
    [
        (FACE_LAYER, "FLOAT_COLOR", "FACE", "FACE"),
        (CORNER_LAYER, "FLOAT_COLOR", "CORNER", "FACE"),
        (FACE_LAYER, "FLOAT_COLOR", "CORNER", "CORNER"),
        (FACE_LAYER, "FLOAT_COLOR", "POINT", "POINT"),
        (FACE_LAYER, "FLOAT_COLOR", "CORNER", "FACE"),
        (FACE_LAYER, "BYTE_COLOR", "POINT", "POINT"),
        (CORNER_LAYER, "BYTE_COLOR", "CORNER", "FACE"),
        (FACE_LAYER, "FLOAT_VECTOR", "FACE", "FACE"),
        (FACE_LAYER, "FLOAT", "POINT", "CORNER"),
        (FACE_LAYER, "INT", "EDGE", "POINT"),
        (FACE_LAYER, "FLOAT2", "CORNER", "LIGHTMAP"),
    ],
)
def test_an_attribute_of_the_users_is_not_touched(name, data_type, domain, target):
    """Of another kind or of the very kind of a result, alpha and all; the error names object, layer and cure."""
    put(scene().data, name, data_type, domain)
    kind = "UV map" if target == "LIGHTMAP" else "color attribute" if "COLOR" in data_type else "attribute"
    refuses("object 'Floor'", f"has a {kind} named '{name}'", "choose another", f"remove the {kind}", target=target)


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_an_attribute_made_during_the_bake_is_not_touched(target):
    """The bake fails as it would have at its beginning, and writes nothing, onto other objects neither."""
    ob = scene()
    running = job(bpy.data.objects["Ceiling"], ob, target=target)
    while not running.step(1.0):
        pass
    put(ob.data, FACE_LAYER, "FLOAT_COLOR", target)
    before = file_state()
    with pytest.raises(AttributeNameError, match="'Floor' has a color attribute named 'Obscurance'"):
        running.commit()
    assert file_state() == before


@pytest.mark.parametrize("name", [FACE_LAYER, CORNER_LAYER])
def test_a_uv_map_of_that_name_is_not_touched(name):
    """The error names the object, the map, and the cure."""
    scene().data.uv_layers.new(name=name)
    refuses("object 'Floor'", f"UV map named '{name}'", "choose another attribute name", "remove the UV map")


@pytest.mark.parametrize("name", [FACE_LAYER, CORNER_LAYER])
def test_a_vertex_group_of_that_name_is_not_touched(name):
    """The error names the object, the group, and the cure."""
    scene().vertex_groups.new(name=name)
    refuses(
        "object 'Floor'", f"vertex group named '{name}'", "choose another attribute name", "remove the vertex group"
    )


@pytest.mark.parametrize(
    "name", ["position", "material_index", "sharp_face", "sharp_edge", ".corner_vert", ".edge_verts", ".mine"]
)
def test_names_that_blender_uses_are_refused(name):
    """The error names the name and says to choose another one."""
    scene()
    refuses(f"'{name}'", "reserved by Blender", "choose another one", attribute_name=name, corner_copy=False)


@pytest.mark.parametrize("name", ["", "   "])
def test_an_empty_name_is_refused(name):
    """With an example of a good one."""
    scene()
    refuses("needs a name", "'Obscurance'", attribute_name=name)


def test_names_up_to_the_limit_work_and_longer_ones_are_refused():
    """Limits count bytes, not letters, and include the suffix of the copy."""
    ob = scene()
    longest = "ä" * (MAX_NAME_BYTES // 2)
    bake(ob, attribute_name=longest, corner_copy=False)
    assert kinds(ob) == {longest: ("FLOAT_COLOR", "FACE")}
    refuses("1 bytes too long", attribute_name=longest + "a", corner_copy=False)
    refuses("6 bytes too long", attribute_name=longest, corner_copy=True)


def test_a_layer_called_like_the_one_in_the_making_is_not_touched():
    """A user's attribute of the temporary name keeps its values."""
    ob = scene()
    mine = ob.data.attributes.new(FACE_LAYER + ".baking", "FLOAT_COLOR", "FACE")
    mine.data.foreach_set("color", np.full(9 * 4, 0.25, np.float32))
    bake(ob)
    assert (read(ob.data, FACE_LAYER + ".baking") == 0.25).all()
    assert kinds(ob)[FACE_LAYER] == ("FLOAT_COLOR", "FACE")


def test_values_reach_the_evaluated_mesh():
    """Renders see the values at once, on every version."""
    ob = cube()
    floor("Ground", z=-1.5, size=6.0)
    bake(ob, distance=3.0)
    evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert np.array_equal(read(evaluated, FACE_LAYER), read(ob.data, FACE_LAYER))
    assert read(evaluated, FACE_LAYER)[:, 0].min() < 0.9
