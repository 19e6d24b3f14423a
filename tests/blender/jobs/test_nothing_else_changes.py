"""A bake changes its attributes and the active colour, and nothing else of a file."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.writing import color_attribute
from obscurance_addon.blender.writing.layers import AttributeNameError
from obscurance_addon.core.errors import BakeCancelledError, ObscuranceError
from obscurance_addon.core.order import bake_order
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    cube,
    file_state,
    floor,
    job,
    material,
    mesh_state,
    new_collection,
    put,
    select,
)

pytestmark = pytest.mark.usefixtures("empty_scene")
WRITTEN = (FACE_LAYER, CORNER_LAYER)
TARGETS = ["FACE", "CORNER", "POINT"]


def rich_scene():
    """Two objects to bake, and everything around them that could be spoilt."""
    ob, other = floor(n=3, color=(0.5, 0.2, 0.1)), cube("Other")
    other.location = (0.0, 0.0, 1.2)
    mesh = ob.data
    for name in ("First map", "Second map", "Third map"):
        mesh.uv_layers.new(name=name)
    mesh.uv_layers.active = mesh.uv_layers["Second map"]
    mesh.uv_layers["Third map"].active_render = True
    put(mesh, "Weight", "FLOAT", "POINT")
    put(mesh, "Corner vector", "FLOAT_VECTOR", "CORNER")
    put(mesh, "Face number", "INT", "FACE")
    put(mesh, "Edge number", "INT", "EDGE")
    for name in ("Mine", "Yours"):
        put(mesh, name, "BYTE_COLOR", "CORNER")
    mesh.attributes.default_color_name = "Yours"
    mesh.attributes.active_color_name = "Mine"
    mesh["note"], ob["note"] = "mine", 7
    mesh.materials.append(material("Second", (0.1, 0.9, 0.1)))
    mesh.polygons[4].material_index = 1
    mesh.edges[3].use_edge_sharp = mesh.edges[5].use_seam = True
    ob.vertex_groups.new(name="Group").add([0, 1, 2], 0.5, "REPLACE")
    ob.shape_key_add(name="Basis")
    ob.shape_key_add(name="Key").value = 0.25
    ob.modifiers.new("Subdivision", "SUBSURF").levels = 1
    ob.modifiers.new("Wave", "WAVE").show_viewport = False
    hidden = cube("Hidden", collection=new_collection("Off"))
    hidden.hide_render = True
    bpy.context.scene.frame_set(7)
    select(other, hidden)
    mesh.attributes.active = mesh.attributes["Corner vector"]  # last in the list, so that new layers come before it
    return ob, other


def unlike(before, after):
    """Keys under which two states differ, as paths."""
    if isinstance(before, dict) and isinstance(after, dict):
        found = [f"{key}" for key in before.keys() ^ after.keys()]
        for key in before.keys() & after.keys():
            found += [f"{key}/{path}" if path else key for path in unlike(before[key], after[key])]
        return sorted(found)
    return [] if before == after else [""]


@pytest.mark.parametrize("target", TARGETS)
def test_a_bake_changes_its_attributes_and_the_active_colour(target):
    """On a mesh with a default colour only the active one changes; on one without colours the default is set, too."""
    ob, other = rich_scene()
    before = file_state()
    bake(ob, other, target=target)
    changed = unlike(before, file_state(without=WRITTEN))
    assert changed == ["meshes/Floor/active color", "meshes/Other/active color", "meshes/Other/default color"]


def test_a_bake_without_a_visible_layer_changes_its_attribute_only():
    """A face attribute without its copy leaves the active colour alone."""
    ob, other = rich_scene()
    before = file_state()
    bake(ob, other, corner_copy=False)
    assert unlike(before, file_state(without=WRITTEN)) == []


@pytest.mark.parametrize("target", TARGETS)
def test_nothing_changes_while_a_bake_runs_or_when_it_is_cancelled(target):
    """Before the commit, and after a cancel instead of it."""
    ob, other = rich_scene()
    before = file_state()
    running = job(ob, other, target=target)
    assert unlike(before, file_state()) == []
    running.cancel()
    assert unlike(before, file_state()) == []


def test_nothing_changes_when_tracing_fails(monkeypatch):
    """An error in the job's thread comes out of `step` and leaves the file alone."""
    ob, other = rich_scene()
    before = file_state()

    def fails(*_arguments, **_keywords):
        raise ObscuranceError("no")

    monkeypatch.setattr(bake_order, "bake_obscurances", fails)
    with pytest.raises(ObscuranceError, match="no"):
        job(ob, other).run()
    assert unlike(before, file_state()) == []


@pytest.mark.parametrize("nth", [1, 2, 3, 4])
def test_nothing_changes_when_an_attribute_cannot_be_made(monkeypatch, nth):
    """Whichever of the four layers of two meshes fails, none is left, and a result in another domain is not lost."""
    ob, other = rich_scene()
    bake(other, target="POINT")
    before = file_state()
    running = job(ob, other)
    while not running.step(1.0):
        pass
    prepare, calls = color_attribute.prepare, []

    def fails_at_nth(*arguments):
        calls.append(arguments)
        if len(calls) == nth:
            raise AttributeNameError("no room")
        return prepare(*arguments)

    monkeypatch.setattr(color_attribute, "prepare", fails_at_nth)
    with pytest.raises(AttributeNameError):
        running.commit()
    assert len(calls) == nth
    assert unlike(before, file_state()) == []


def test_run_cancels_when_its_caller_breaks_off():
    """Ctrl-C in a script: the error goes on, threads end, the file is as it was."""
    ob, other = rich_scene()
    before = file_state()

    def interrupt(_job):
        raise KeyboardInterrupt

    running = job(ob, other, rays=1 << 20)
    with pytest.raises(KeyboardInterrupt):
        running.run(on_step=interrupt)
    with pytest.raises(BakeCancelledError):
        running.step(0.0)
    assert unlike(before, file_state()) == []


def test_the_state_that_these_tests_compare_sees_changes():
    """One flipped bit of an attribute, a moved active attribute, a renamed map: each is told."""
    ob, _ = rich_scene()
    for change, path in (
        (lambda m: m.attributes["Weight"].data.foreach_set("value", np.ones(16, np.float32)), "attributes/Weight"),
        (lambda m: setattr(m.attributes, "active", m.attributes["Weight"]), "active attribute"),
        (lambda m: setattr(m.uv_layers["First map"], "active_render", True), "uv"),
        (lambda m: setattr(m.edges[0], "use_edge_sharp", True), "attributes/sharp_edge"),
    ):
        before = mesh_state(ob.data)
        change(ob.data)
        assert unlike(before, mesh_state(ob.data)) == [path]
