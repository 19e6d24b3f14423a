"""What lightmaps take: all kinds of faces, modifiers, shared and broken meshes, many objects, and UV maps to keep."""

import bpy
import numpy as np
import pytest

from obscurance_addon.core.errors import GeometryError, ObscuranceError
from obscurance_addon.core.lightmap.triangles import AtlasTriangles
from obscurance_addon.core.scene.patches import Normalisation
from tests.blender.helpers import (
    CUBE_FACES,
    CUBE_VERTICES,
    FACE_LAYER,
    bake,
    colors,
    cube,
    file_state,
    floor,
    new_object,
    notes_about,
    read,
    select,
)
from tests.blender.jobs.test_lightmap_bake import (
    SIZE,
    arrays_of,
    bake_map,
    finished,
    layout_of,
    lightmap_job,
    means_on_faces,
    pixels_of,
    texels_of,
    uv_of,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def triangles_of(running) -> AtlasTriangles:
    """The triangles of a finished job, in texels."""
    return layout_of(running).triangles(SIZE, Normalisation.of(arrays_of(running).patches.corners))


def overlaps(running):
    """Texels whose centre lies in more than one face."""
    found = np.full(SIZE * SIZE, -1)
    crowded, triangles = 0, triangles_of(running)
    for corners, face in zip(triangles.uv, triangles.face, strict=True):
        low, high = np.floor(corners.min(0)).astype(int), np.ceil(corners.max(0)).astype(int)
        x, y = (a.ravel() for a in np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True))))
        centre = np.stack([x, y], -1) + 0.5
        edge, to = np.roll(corners, -1, 0) - corners, centre[:, None] - corners
        inside = (edge[:, 0] * to[..., 1] - edge[:, 1] * to[..., 0] > 1e-6).all(1)
        texel = (y * SIZE + x)[inside]
        crowded += np.count_nonzero((found[texel] >= 0) & (found[texel] != face))
        found[texel] = face
    return crowded


def density(running, index=0):
    """Area in the atlas over area in the world, in texels per square metre, of one object."""
    part, triangles = arrays_of(running).ranges[index], triangles_of(running)
    own = (triangles.face >= part.first) & (triangles.face < part.end)
    one, other = (triangles.uv[own, k] - triangles.uv[own, 0] for k in (1, 2))
    texels = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    scale = Normalisation.of(arrays_of(running).patches.corners).scale
    return texels.sum() / (texels * triangles.texel_area[own]).sum() / scale**2


def page_of(report):
    return pixels_of(bpy.data.images[report.lightmap.image])


# -------------------------------------------------------------------------------------------------- polygons, modifiers


def star():
    """A star of ten corners whose notches a convex polygon would fill."""
    angle = np.arange(10) * np.pi / 5.0
    radius = np.where(np.arange(10) % 2, 0.3, 1.0)
    return new_object("Star", np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], -1), [range(10)])


def test_concave_polygons_cover_their_own_area():
    """One face and one chart; its area, seen in UVs, is that of the star and not of its hull."""
    ob = star()
    running = finished(ob)
    assert len(set(layout_of(running).chart)) == 1
    running.commit()
    x, y = uv_of(ob).astype(float).T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    radius = np.linalg.norm(uv_of(ob) - uv_of(ob).mean(0), axis=1)
    assert area == pytest.approx(5 * 0.3 * np.sin(np.pi / 5) * radius.max() ** 2, rel=0.02)
    assert overlaps(running) == 0


def test_deformed_faces_are_baked_as_they_are_seen():
    """A twisted sheet has the values of its face bake, which is shaded by itself; its map is that of its own mesh."""
    ob = floor(n=8)
    modifier = ob.modifiers.new("Twist", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.angle, modifier.deform_axis = "TWIST", 1.5 * np.pi, "Y"
    running = finished(ob, rays=64, adaptive=False)
    report = running.commit()
    assert report.warnings == []
    bake(ob, rays=1024, attribute_name="Faces", corner_copy=False)
    expected, found = colors(ob, "Faces"), means_on_faces(running)
    assert expected.min() < 0.95
    assert np.sqrt(((found - expected) ** 2).mean()) < max(report.rmse)
    assert len(uv_of(ob)) == len(ob.data.loops)


def subdivide(ob):
    ob.modifiers.new("Subdivision", "SUBSURF").levels = 1


def repeat(ob):
    ob.modifiers.new("Array", "ARRAY").count = 3


def mirror(ob):
    ob.modifiers.new("Mirror", "MIRROR").use_axis = (False, False, True)


def test_what_modifiers_make_elsewhere_occludes():
    """Copies by an Array: the images are those of the object itself with an object of nothing but the copies."""
    ob = cube("Thing", half=0.5)
    ob.location.z = 1.0
    ground = floor(size=6.0, n=2)
    vertices = np.array(CUBE_VERTICES) * 0.5
    copies = new_object(
        "Copies",
        np.concatenate([vertices + np.array([x, 0.0, 0.0]) for x in (1.5, 3.0)]),
        [np.array(face) + first for first in (0, 8) for face in CUBE_FACES],
    )
    copies.location.z = 1.0
    expected = page_of(bake_map(ob, ground)).copy()
    bpy.data.objects.remove(copies)
    alone = page_of(bake_map(ob, ground)).copy()
    modifier = ob.modifiers.new("Array", "ARRAY")
    modifier.count, modifier.relative_offset_displace = 3, (1.5, 0.0, 0.0)
    report = bake_map(ob, ground)
    assert len(notes_about(report.warnings, "'Thing'", "unmodified mesh was baked", "beside what they make")) == 1
    np.testing.assert_allclose(page_of(report), expected, atol=2e-6)
    assert np.abs(alone - expected).max() > 0.1


@pytest.mark.parametrize("modify", [subdivide, mirror])
def test_more_faces_by_modifiers_are_baked_without_them_and_said_so(modify):
    """The image is that of the unmodified mesh, bit for bit; the note names object and cure."""
    ob = cube("Thing", half=0.5)
    ob.location.z = 1.0
    floor()
    plain = page_of(bake_map(ob))
    modify(ob)
    report = bake_map(ob)
    assert len(notes_about(report.warnings, "'Thing'", "unmodified mesh was baked", "apply the modifiers")) == 1
    assert len(uv_of(ob)) == 24
    assert ob.modifiers
    np.testing.assert_array_equal(page_of(report), plain)


@pytest.mark.parametrize("modify", [subdivide, repeat, mirror])
def test_a_kept_map_takes_the_faces_that_modifiers_make(modify):
    """No note, no new map; of a subdivided cube the texels have the area of the subdivided surface."""
    ob = cube("Thing", half=0.5)
    bake_map(ob)
    before = uv_of(ob).copy()
    modify(ob)
    running = finished(ob, uv_mode="KEEP")
    evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(arrays_of(running).patches) == len(evaluated.polygons) > 6
    report = running.commit()
    assert not notes_about(report.warnings, "unmodified")
    assert np.array_equal(uv_of(ob), before)
    assert ob.data.uv_layers.keys() == [FACE_LAYER]
    copied = modify is not subdivide  # and copies lie on each other in the map
    assert bool(notes_about(report.warnings, "'Thing' with itself", "overlap")) == copied
    if modify is subdivide:
        scale = Normalisation.of(arrays_of(running).patches.corners).scale
        area = sum(texels.area.sum() for texels, _ in texels_of(running)) * scale**2
        evaluated.calc_loop_triangles()
        assert area == pytest.approx(sum(triangle.area for triangle in evaluated.loop_triangles), rel=1e-4)


# ------------------------------------------------------------------------------------------------ shared, scaled, many


def test_shared_meshes_get_copies_and_places_of_their_own():
    """Each its own UVs, the dark one dark texels; the note names who got a copy."""
    covered = floor("Covered", n=2)
    other = bpy.data.objects.new("Open", covered.data)
    other.location.x = 20.0
    bpy.context.scene.collection.objects.link(other)
    floor("Ceiling", size=3.0, z=0.2)
    running = finished(covered, other)
    report = running.commit()
    assert covered.data != other.data
    assert notes_about(report.warnings, "mesh was shared", "'Open'")
    assert overlaps(running) == 0
    assert not np.array_equal(uv_of(covered), uv_of(other))
    means = means_on_faces(running)
    assert means[:4].max() < 0.6 < 0.99 < means[4:].min()


def test_density_is_the_same_on_mirrored_and_stretched_objects():
    """Within 10 %, whatever the scale of the object, and as reported."""
    objects = [cube(f"Cube {i}", half=0.3) for i in range(4)]
    scales = [(1, 1, 1), (-1, 1, 1), (4.0, 0.5, 1.0), (-2.0, -1.0, -3.0)]
    for i, (ob, scale) in enumerate(zip(objects, scales, strict=True)):
        ob.scale, ob.location = scale, (0.0, 4.0 * i, 0.0)
    running = finished(*objects)
    found = [density(running, i) for i in range(4)]
    report = running.commit()
    np.testing.assert_allclose(found, report.lightmap.texels_per_metre**2, rtol=0.1)
    means = means_on_faces(running)
    assert np.allclose(means, 1.0, atol=1e-6)  # none is inside out


def test_hundreds_of_objects_share_an_atlas():
    """300 cubes: no two faces in one texel, and every one of them has light."""
    rng = np.random.default_rng(0)
    objects = []
    for i in range(300):
        ob = cube(f"Cube {i}", half=0.2)
        ob.location, ob.rotation_euler = rng.uniform(-8, 8, 3), rng.uniform(0, 3, 3)
        objects.append(ob)
    running = finished(*objects, rays=1)
    assert overlaps(running) == 0
    report = running.commit()
    assert len(report.objects) == 300
    assert not notes_about(report.warnings, "overlap")
    pixels = page_of(report)
    for ob in objects:
        x, y = (uv_of(ob).reshape(-1, 4, 2).mean(1) * SIZE).astype(int).T
        assert (pixels[y, x, 3] == 1.0).all()
        assert (pixels[y, x, :3] > 0.0).all()


# -------------------------------------------------------------------------------------------------------- broken meshes


def needle(ob):
    """A face without area."""
    ob.data.vertices[1].co = ob.data.vertices[0].co
    ob.data.vertices[3].co = ob.data.vertices[2].co = (1.0, 1.0, 0.0)


def spoilt(ob, value):
    """Let the first vertex be there; not by its property, which ends at the largest float."""
    points = read(ob.data, "position")
    points[0, 2] = value
    ob.data.attributes["position"].data.foreach_set("vector", points.ravel())
    ob.data.update()


@pytest.mark.parametrize("mode", ["UNWRAP", "KEEP"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_broken_vertices_leave_out_their_faces_by_name(value, mode):
    """The others have light, finite everywhere."""
    ob = floor("Broken", n=3)
    bake_map(ob)
    spoilt(ob, value)
    running = finished(ob, uv_mode=mode)
    report = running.commit()
    assert notes_about(report.warnings, "'Broken'", "no finite position")
    pixels = page_of(report)
    assert np.isfinite(pixels).all()
    assert np.isfinite(uv_of(ob)).all()
    x, y = (uv_of(ob).reshape(-1, 4, 2).mean(1)[1:] * SIZE).astype(int).T
    assert np.allclose(pixels[y, x], 1.0, atol=1e-3)


@pytest.mark.parametrize("mode", ["UNWRAP", "KEEP"])
def test_a_vertex_far_astray_is_an_error_that_names_the_object(mode):
    """Next to it all other faces are too small to have light; nothing changes."""
    ob = floor("Broken", n=3)
    bake_map(ob)
    spoilt(ob, 1e30)
    before = file_state()
    with pytest.raises(GeometryError, match="'Broken'"):
        bake_map(ob, uv_mode=mode)
    assert file_state() == before


def test_faces_without_area_are_named_and_get_nothing():
    """Beside faces that are baked as ever; alone they are an error by name."""
    ob, other = floor("Flat", n=1), floor("Whole", n=2, z=1.0)
    needle(ob)
    report = bake_map(ob, other)
    assert notes_about(report.warnings, "'Flat'", "without area")
    before = file_state()
    with pytest.raises(GeometryError, match=r"'Flat'"):
        bake_map(ob)
    assert file_state() == before


def test_objects_that_cannot_be_baked_get_the_messages_of_attributes():
    """Without faces, not a mesh, or in Edit Mode; word for word what a bake to faces says."""
    ob, empty = floor(), new_object("Empty", [(0, 0, 0)], [])
    curve = bpy.data.objects.new("Curve", bpy.data.curves.new("Curve", "CURVE"))
    bpy.context.scene.collection.objects.link(curve)
    assert bake_map(ob, empty, curve).warnings == bake(ob, empty, curve, attribute_name="Faces").warnings
    with pytest.raises(ObscuranceError, match=r"nothing to bake.*'Empty'"):
        lightmap_job(empty)
    select(ob)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(ObscuranceError, match=r"in Edit Mode.*'Floor'"):
        lightmap_job(ob)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_linked_meshes_are_named_and_skipped(tmp_path):
    """The object beside it is baked; the linked mesh gets no map."""
    cube("Thing")
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, found):
        found.objects = ["Thing"]
    bpy.context.scene.collection.objects.link(found.objects[0])
    report = bake_map(found.objects[0], floor())
    assert report.objects == ["Floor"]
    assert notes_about(report.warnings, "'Thing'", "linked from a library", "local")
    assert not found.objects[0].data.uv_layers


# ------------------------------------------------------------------------------------------------------------ kept maps


def with_map(ob, name, low=(0.1, 0.1), side=0.3):
    """A UV map of this name that puts each quad of an object on the same square."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * side + low
    uv = np.tile(corners, (len(ob.data.polygons), 1)).astype(np.float32)
    ob.data.uv_layers.new(name=name, do_init=False).uv.foreach_set("vector", uv.ravel())
    return ob


@pytest.mark.parametrize(("asked", "low"), [("Second", 0.6), ("", 0.1)])
def test_the_named_map_is_kept_or_the_one_that_renders(asked, low):
    """Covered are the texels of that map and its margin; maps stay as they are."""
    ob = with_map(with_map(floor(), "First", (0.1, 0.1)), "Second", (0.6, 0.6))
    ob.data.uv_layers["First"].active_render = True
    before = file_state()["meshes"]
    running = finished(ob, uv_mode="KEEP", uv_map=asked, margin=0)
    report = running.commit()
    assert file_state()["meshes"] == before
    y, x = np.nonzero(page_of(report)[..., 3])
    for at in (x, y):
        assert abs(at.min() - low * SIZE) <= 1.0
        assert abs(at.max() + 1 - (low + 0.3) * SIZE) <= 1.0
    assert report.lightmap.texels_per_metre is None


@pytest.mark.parametrize(("asked", "words"), [("Other", "no UV map named 'Other'"), ("", "no UV map to keep")])
def test_a_map_that_is_not_there_is_named_with_the_object(asked, words):
    """And the cure, before anything changes."""
    ob, bare = with_map(floor("Mapped"), "Other"), floor("Bare", z=1.0)
    before = file_state()
    with pytest.raises(GeometryError, match=rf"'Bare' has {words}.*let the bake unwrap"):
        lightmap_job(ob, bare, uv_mode="KEEP", uv_map=asked)
    assert file_state() == before


def test_overlapping_objects_are_both_named():
    """With the number of texels that they share, and only those that do."""
    one, other = with_map(floor("One"), "Map"), with_map(floor("Other", z=1.0), "Map", (0.3, 0.1))
    apart = with_map(floor("Apart", z=2.0), "Map", (0.65, 0.65))
    report = bake_map(one, other, apart, uv_mode="KEEP")
    (note,) = notes_about(report.warnings, "overlap")
    assert "'One' with 'Other' in" in note
    assert "Apart" not in note
    texels = int(note.split("'Other' in ")[1].split(";")[0].replace(",", ""))
    assert texels == pytest.approx(0.1 * 0.3 * SIZE**2, abs=0.4 * SIZE)  # half a texel along the border


def test_maps_in_other_tiles_make_tiles(tmp_path):
    """One unit to the right is tile 1002, one up 1011; below zero and across borders is told by object."""
    up = with_map(floor("Up", z=20.0), "Map", (0.1, 1.1))
    bake_map(up, uv_mode="KEEP", attribute_name="Up")
    assert max(tile.number for tile in bpy.data.images["Up"].tiles) == 1011
    objects = [
        with_map(floor(name, z=float(z)), "Map", low)
        for z, (name, low) in enumerate([("First", (0.1, 0.1)), ("Right", (1.1, 0.1)), ("Below", (0.1, -0.9))])
    ]
    across = with_map(floor("Across", z=9.0), "Map", (0.9, 0.5))
    report = bake_map(*objects, across, uv_mode="KEEP", image_path=str(tmp_path / "map.exr"))
    assert [tile.number for tile in bpy.data.images[FACE_LAYER].tiles] == [1001, 1002]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.1001.exr", "map.1002.exr"]
    for name in ("Below", "Across"):
        assert notes_about(report.warnings, f"'{name}'", "outside of the image tiles", "'Map'")
    for name in ("First", "Right"):
        assert not notes_about(report.warnings, f"'{name}'", "outside")
    with pytest.raises(GeometryError, match="UV map 'Map'"):
        bake_map(objects[2], uv_mode="KEEP")
