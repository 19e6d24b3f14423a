"""A work order that a child process carries out gives the bytes that this process gives."""

import sys

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.frame_update import FrameUpdater
from obscurance_addon.blender.jobs.job import CHILD, BakeJob
from obscurance_addon.core.errors import BackendError, GeometryError
from obscurance_addon.core.light import LightSettings, Quantity
from obscurance_addon.core.lightmap import LightmapSettings
from obscurance_addon.core.order import OutputSettings, make_follower
from obscurance_addon.core.settings import BakeSettings
from tests.blender.helpers import colors, cube, floor, new_object
from tests.blender.jobs.test_lightmap_bake import lit_panels
from tests.blender.materials.material_helpers import Tree

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.fixture(autouse=True, scope="module")
def no_child_is_left():
    yield
    CHILD.end()


def result(objects, in_child, target, **light):
    bpy.context.view_layer.update()
    running = BakeJob(
        bpy.context,
        objects,
        BakeSettings(rays=16),
        OutputSettings(target=target),
        LightSettings(**light),
        LightmapSettings(size=256),
        in_child,
    )
    while not running.step(0.5):
        assert 0.0 <= running.progress <= 1.0
    running.is_open = False
    return running._run.result


@pytest.mark.parametrize("quantity", Quantity)
@pytest.mark.parametrize("target", ["FACE", "POINT", "LIGHTMAP"])
def test_results_are_equal_to_the_bit(target, quantity):
    """Values, pages, UVs and what the report says, but for seconds."""
    if target == "POINT" and quantity is Quantity.RADIOSITY:
        pytest.skip("radiosity is for whole faces")
    objects = lit_panels()
    here, there = (result(objects, in_child, target, quantity=quantity) for in_child in (False, True))
    assert len(there.values) == len(here.values)
    assert len(there.pages) == len(here.pages)
    arrays = [[*of.values, *of.pages, *(of.uv or [])] for of in (here, there)]
    for one, other in zip(*arrays, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
    for name in ("patches", "rays", "r_ave", "rmse", "d_max", "ambient_light", "openness", "reflectors", "warnings"):
        assert getattr(here.report, name) == getattr(there.report, name)


def test_every_function_of_materials_can_be_sent():
    """Math of every kind on a texture that varies, which the child evaluates."""
    from obscurance_addon.core.shading import arithmetic

    ob = floor(n=4)
    ob.data.color_attributes.new("Paint", "FLOAT_COLOR", "CORNER").data.foreach_set(
        "color", np.random.default_rng(1).random(4 * 64).astype(np.float32)
    )
    for operation in arithmetic.MATH:
        tree = Tree()
        node = tree.node("ShaderNodeMath", operation=operation)
        tree.link(tree.node("ShaderNodeVertexColor", layer_name="Paint").outputs["Color"], node.inputs[0])
        tree.diffuse(node.outputs[0])
        ob.data.materials.append(tree.material)
    ob.data.polygons.foreach_set("material_index", np.arange(16, dtype=np.int32) % len(arithmetic.MATH))
    here, there = (result([ob], in_child, "FACE") for in_child in (False, True))
    np.testing.assert_array_equal(here.values[0], there.values[0])
    assert not np.array_equal(here.report.r_ave, [0.8] * 3)


def test_an_error_of_the_core_is_that_error():
    ob = new_object("Point", np.zeros((4, 3)), [(0, 1, 2, 3)])
    for in_child in (False, True):
        with pytest.raises(GeometryError, match=r"'Point'.*no extent"):
            result([ob], in_child, "FACE")


def test_a_child_follows_as_this_process_does():
    """A block moves, turns into another, and goes; values and counts agree after each change."""
    ground, block = floor(n=8, size=4.0), cube(half=0.5)
    found = []
    for in_child in (False, True):
        block.location, block.hide_render = (0, 0, 1), False
        block.data.vertices[0].co.x = -0.5
        bpy.context.view_layer.update()
        updater = FrameUpdater(
            bpy.context, [ground], BakeSettings(rays=32, distance=1.0), OutputSettings(), 1 << 20, in_child=in_child
        )
        seen = [(updater.start().patches, colors(ground).copy())]
        for change in (
            lambda: setattr(block, "location", (1, 0, 1)),
            lambda: setattr(block, "location", (1, 1, 1)),
            lambda: setattr(block.data.vertices[0].co, "x", -0.9) or block.data.update(),
            lambda: setattr(block, "hide_render", True),
            lambda: None,
        ):
            change()
            bpy.context.view_layer.update()
            updater.distrust()
            report = updater.update(bpy.context, bpy.context.evaluated_depsgraph_get())
            seen.append((report.patches, colors(ground).copy()))
        updater.end()
        found.append(seen)
    assert [patches for patches, _ in found[0]] == [patches for patches, _ in found[1]]
    for (_, here), (_, there) in zip(*found, strict=True):
        np.testing.assert_array_equal(here, there)
    assert found[0][-1][0] == 0


@pytest.mark.parametrize("first", ["send", "end"])
def test_a_follower_that_does_not_start_is_this_process(first, monkeypatch):
    """Whether the process ends before it was sent the scene or after; the values are there all the same."""
    ground = floor(n=2)
    bpy.context.view_layer.update()
    monkeypatch.setattr(sys, "executable", "/bin/false")
    updater = FrameUpdater(bpy.context, [ground], BakeSettings(rays=8), OutputSettings(), 1 << 20, in_child=True)
    updater._follower = make_follower(True)
    if first == "end":
        updater._follower._child._process.wait()
    assert updater.start().patches == 4
    assert "own process" in " ".join(updater.notes)
    assert (colors(ground)[:, 0] == 1.0).all()
    updater.end()


def test_a_killed_follower_is_an_error_that_says_so():
    ground = floor(n=2)
    bpy.context.view_layer.update()
    updater = FrameUpdater(bpy.context, [ground], BakeSettings(rays=8), OutputSettings(), 1 << 20, in_child=True)
    updater.start()
    updater._follower._child._process.kill()
    other = cube()
    other.location.z = 1.5
    bpy.context.view_layer.update()
    updater.distrust()
    with pytest.raises(BackendError, match="signal 9"):
        updater.update(bpy.context, bpy.context.evaluated_depsgraph_get())
    updater.end()
