"""CORNER and POINT: the patch is the part of the surface around the corner, and shading decides who shares a value."""

import itertools

import bpy
import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from tests.blender.helpers import baked, colors, floor, mean_over_seeds, new_object, sheet
from tests.core.closed_forms import planes, strip

pytestmark = pytest.mark.usefixtures("empty_scene")

# A floor (looking up) and a wall (looking along +x) that meet in the edge 0-1.
FOLD = [(0, 0, 0), (0, 2, 0), (2, 0, 0), (2, 2, 0), (0, 0, 2), (0, 2, 2)]
FOLD_FACES = [(0, 2, 3, 1), (0, 1, 5, 4)]
SPLIT = [*FOLD, (0, 0, 0), (0, 2, 0)]
SPLIT_FACES = [(0, 2, 3, 1), (6, 7, 5, 4)]


@pytest.mark.parametrize(("target", "away"), [("CORNER", [1, 2]), ("POINT", [1, 3])])
def test_one_large_face_darkens_where_a_wall_stands(target, away):
    """The half of a floor beside a wall on its edge has the strip's closed form, the half beyond reach is 1."""
    ob = sheet("Floor", (0, -2, 0), (4, 0, 0), (0, 4, 0))
    sheet("Wall", (0, -4, 0), (0, 8, 0), (0, 0, 2))
    near = [i for i in range(4) if i not in away]
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, target=target, rays=64, use_bleeding=False, seed=seed))
    assert np.allclose(mean[away], 1.0, atol=1e-6)
    assert (abs(mean[near] - strip(Falloff.SQRT, 0.0, 2.0)) <= tolerance[near]).all()


def shade(ob, how):
    mesh = ob.data
    mesh.polygons.foreach_set("use_smooth", [how != "flat"] * len(mesh.polygons))
    if how == "sharp edge":
        for edge in mesh.edges:
            edge.use_edge_sharp = set(edge.vertices) == {0, 1}
    elif how == "smooth by angle":
        smooth_by_angle(ob)
    mesh.update()


def smooth_by_angle(ob):
    """The modifier as Blender ships it: edges steeper than 30 degrees become sharp."""
    tree = bpy.data.node_groups.new("Smooth by Angle", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    source, result = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    shading = tree.nodes.new("GeometryNodeSetShadeSmooth")
    shading.domain = "EDGE"
    steep = tree.nodes.new("GeometryNodeInputMeshEdgeAngle")
    compare = tree.nodes.new("FunctionNodeCompare")
    compare.data_type, compare.operation = "FLOAT", "LESS_EQUAL"
    compare.inputs[1].default_value = np.radians(30.0)
    tree.links.new(source.outputs[0], shading.inputs["Geometry"])
    tree.links.new(steep.outputs[0], compare.inputs[0])
    smooth = next(s for s in shading.inputs if s.name == "Shade Smooth")
    tree.links.new(compare.outputs[0], smooth)
    tree.links.new(shading.outputs[0], result.inputs[0])
    ob.modifiers.new("Smooth by Angle", "NODES").node_group = tree


def fold(how, vertices=FOLD, faces=FOLD_FACES):
    """The fold below a ceiling that covers its floor, so that floor and wall differ."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ob = new_object("Fold", vertices, faces)
    sheet("Ceiling", (0.1, -2, 0.3), (4, 0, 0), (0, 6, 0))
    shade(ob, how)
    return ob


@pytest.mark.parametrize("how", ["flat", "sharp edge", "smooth by angle"])
def test_values_are_never_mixed_across_sharp_edges(how):
    """Where shading breaks, all corners have bit for bit the values of a mesh whose faces are not connected at all."""
    found = baked(fold(how), target="CORNER")
    apart = baked(fold("smooth", SPLIT, SPLIT_FACES), target="CORNER")
    assert np.array_equal(found, apart)
    assert abs(found[0] - found[4]).max() > 0.1  # the two corners at vertex 0


def test_values_are_smooth_within_a_smoothing_group():
    """Corners of one vertex share one value, which lies between those that its faces have apart."""
    ob = fold("smooth")
    found = baked(ob, target="CORNER")
    vertex = np.array([loop.vertex_index for loop in ob.data.loops])
    for v in range(6):
        assert len(np.unique(found[vertex == v], axis=0)) == 1
    apart = baked(fold("flat"), target="CORNER")
    for a, b in ((0, 4), (3, 5)):
        low, high = sorted((apart[a, 0], apart[b, 0]))
        assert low < found[a, 0] < high


def test_points_are_what_smooth_corners_share():
    """On a smooth mesh without marks, POINT has the values of CORNER at each vertex, bit for bit up to the samples."""
    ob = fold("smooth")
    mean_point, tolerance = mean_over_seeds(lambda seed: baked(ob, target="POINT", seed=seed)[:, 0])
    mean_corner, other = mean_over_seeds(lambda seed: baked(ob, target="CORNER", seed=seed)[:, 0])
    vertex = [loop.vertex_index for loop in ob.data.loops]
    assert (abs(mean_point[vertex] - mean_corner) <= tolerance[vertex] + other).all()


def test_flat_shaded_planes_are_smooth():
    """A grid of flat faces in one plane has one value at each vertex: there is no crease to see."""
    ob = floor(n=4)
    floor("Ceiling", size=0.7, z=0.2)
    found = baked(ob, target="CORNER")
    vertex = np.array([loop.vertex_index for loop in ob.data.loops])
    assert all(len(np.unique(found[vertex == v], axis=0)) == 1 for v in range(25))
    assert len(np.unique(found[:, 0])) > 5


@pytest.mark.parametrize("target", ["CORNER", "POINT"])
def test_concave_faces_are_sampled_on_themselves_only(target):
    """Below the notch of an L-shaped face hangs a ceiling; below it is no part of the face, so all stays open.

    A ceiling as wide as everything gives the closed form at every corner.
    """
    outline = [(0, 0, 0), (3, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]
    ob = new_object("L", outline, [range(6)])
    sheet("Post", (1.5, 1.5, 0.0001), (1.5, 0, 0), (0, 1.5, 0))
    assert np.allclose(baked(ob, target=target), 1.0, atol=1e-6)
    sheet("Ceiling", (-2, -2, 0.25), (7, 0, 0), (0, 7, 0))
    mean, tolerance = mean_over_seeds(lambda seed: baked(ob, target=target, rays=64, use_bleeding=False, seed=seed))
    assert (abs(mean - planes(Falloff.SQRT, 0.25)) <= tolerance).all()


@pytest.mark.parametrize("target", ["FACE", "CORNER", "POINT"])
def test_faces_that_are_not_planar_do_not_shade_themselves_wrongly(target):
    """A quad folded upwards along its diagonal is convex from above: no ray from its own triangles meets it."""
    ob = new_object("Bent", [(0, 0, 0), (2, 0, -0.8), (2, 2, 0), (0, 2, -0.8)], [range(4)])
    ob.data.calc_loop_triangles()
    diagonal = set(ob.data.loop_triangles[0].vertices) & set(ob.data.loop_triangles[1].vertices)
    if diagonal != {0, 2}:  # turned so that the ridge is on Blender's diagonal
        ob.data.vertices.foreach_set("co", [0, 0, -0.8, 2, 0, 0, 2, 2, -0.8, 0, 2, 0])
        ob.data.update()
    assert np.allclose(baked(ob, target=target), 1.0, atol=1e-6)


@pytest.mark.parametrize("target", ["CORNER", "POINT"])
def test_loose_vertices_and_edges_do_no_harm(target):
    """Vertices without faces are open; the others are as without them."""
    outline = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    sheet("Ceiling", (0, 0, 0.2), (1, 0, 0), (0, 1, 0))
    ob = new_object("Floor", outline, [range(4)])
    plain = baked(ob, target=target)
    bpy.data.objects.remove(ob)
    loose = bpy.data.meshes.new("Loose")
    loose.from_pydata([*outline, (5, 5, 5), (6, 5, 5)], [(4, 5)], [range(4)])
    ob = bpy.data.objects.new("Floor", loose)
    bpy.context.scene.collection.objects.link(ob)
    found = baked(ob, target=target)
    assert np.array_equal(found[:4], plain)
    assert (found[4:] == 1.0).all()
    assert len(colors(ob)) == (6 if target == "POINT" else 4)


@pytest.mark.parametrize("target", ["CORNER", "POINT"])
def test_modifiers_that_change_faces_keep_the_wall_where_it_is(target):
    """Subdivided, the near corners of a floor have the same closed form as without the modifier."""
    ob = sheet("Floor", (0, -2, 0), (4, 0, 0), (0, 4, 0))
    sheet("Wall", (0, -4, 0), (0, 8, 0), (0, 0, 2))
    modifier = ob.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels = "SIMPLE", 2
    mean, tolerance = mean_over_seeds(
        lambda seed: baked(ob, target=target, rays=64, use_bleeding=False, seed=seed)[:, 0]
    )
    x = [(v.co.x if target == "POINT" else 0.0) for v in ob.data.vertices]
    if target == "CORNER":
        x = [ob.data.vertices[loop.vertex_index].co.x for loop in ob.data.loops]
    near = np.array(x) == 0.0
    assert np.allclose(mean[~near], 1.0, atol=1e-6)
    assert (abs(mean[near] - strip(Falloff.SQRT, 0.0, 2.0)) <= tolerance[near]).all()


def test_sharp_edges_of_the_mesh_survive_modifiers():
    """A fold marked sharp and subdivided still parts its two sides; without the mark they share values."""
    for mark, parted in itertools.product(("sharp edge", "smooth"), (0,)):
        ob = fold(mark)
        modifier = ob.modifiers.new("Subdivision", "SUBSURF")
        modifier.subdivision_type, modifier.levels = "SIMPLE", 2
        found = baked(ob, target="CORNER")
        assert (abs(found[parted] - found[4]).max() > 0.1) == (mark == "sharp edge")
