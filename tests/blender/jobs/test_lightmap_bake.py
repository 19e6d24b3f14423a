"""Lightmaps: what texels hold, where faces look them up, and what a bake that fails or is cancelled leaves."""

import dataclasses
import os
import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.blender.writing import uv_layer
from obscurance_addon.blender.writing.image import StagedImage
from obscurance_addon.blender.writing.image_files import ImageFileError
from obscurance_addon.core.errors import BakeCancelledError
from obscurance_addon.core.light.settings import LightSettings, Quantity
from obscurance_addon.core.lightmap.settings import LightmapSettings
from obscurance_addon.core.lightmap.texels import covered_texels
from obscurance_addon.core.order import JobMonitor, OutputSettings, Target
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.scene.patches import Normalisation
from obscurance_addon.core.settings import BakeSettings
from tests.blender.helpers import (
    FACE_LAYER,
    bake,
    colors,
    cube,
    file_state,
    floor,
    mean_over_seeds,
    new_object,
    read,
    select,
    sheet,
)
from tests.blender.reading.light_helpers import diffuse, lamp

pytestmark = pytest.mark.usefixtures("empty_scene")

SIZE = 256
HALF_STEP = 2.0**-11  # relative rounding of EXR_HALF
_OF = [{field.name for field in dataclasses.fields(kind)} for kind in (BakeSettings, LightSettings, LightmapSettings)]


def lightmap_job(*objects, **changes):
    """A bake of 8 rays into a page of 256; settings of estimator, light, lightmap and output by name."""
    bpy.context.view_layer.update()
    changes = {"rays": 8, "distance": 1.0, "threads": 1, "size": SIZE} | changes
    settings, light, lightmap = ({k: v for k, v in changes.items() if k in names} for names in _OF)
    output = {k: v for k, v in changes.items() if k not in set().union(*_OF)}
    return BakeJob(
        bpy.context,
        objects,
        BakeSettings(**settings),
        OutputSettings(**{"target": "LIGHTMAP"} | output),
        LightSettings(**light),
        LightmapSettings(**lightmap),
    )


def bake_map(*objects, **changes):
    return lightmap_job(*objects, **changes).run()


def finished(*objects, **changes):
    running = lightmap_job(*objects, **changes)
    while not running.step(1.0):
        pass
    return running


def arrays_of(running):
    """What a job hands to the core."""
    return prepare_arrays(running.order.snapshot, Target.FACE, running.order.light.needs_light)


def layout_of(running):
    """Where the faces of a job lie, which is the same whenever they are laid out."""
    return running.order._laid_out(arrays_of(running), JobMonitor(running.order.light.quantity, True)).layout


def result_of(running):
    """What a finished job is about to write."""
    return running._run.result


def texels_of(running):
    """(texels, colours (n, 3)) of each page of a finished job."""
    triangles = layout_of(running).triangles(SIZE, Normalisation.of(arrays_of(running).patches.corners))
    found = []
    for number, page in enumerate(result_of(running).pages):
        texels = covered_texels(triangles, SIZE, number, (0, SIZE))
        found.append((texels, page.reshape(-1, 4)[texels.index, :3].astype(np.float64)))
    return found


def means_on_faces(running):
    """Mean over the texels of each face, (f, 3)."""
    n = len(arrays_of(running).patches)
    total, area = np.zeros((n, 3)), np.zeros(n)
    for texels, values in texels_of(running):
        area += np.bincount(texels.face, texels.area, n)
        total += np.stack([np.bincount(texels.face, texels.area * column, n) for column in values.T], -1)
    return total / area[:, None]


def pixels_of(image):
    """(size, size, 4), bottom row first."""
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], 4)


def uv_of(ob, name=FACE_LAYER):
    """(c, 2) UVs of an object."""
    return read(ob.data, name)


def panels():
    """Two squares of a floor that share no edge, so that texels end where faces do, and a red wall beside them."""
    points = [(x, y, 0.0) for a in (0.0, 1.0) for x, y in ((a, 0), (a + 1, 0), (a + 1, 2), (a, 2))]
    ground = new_object("Floor", points, [(0, 1, 2, 3), (4, 5, 6, 7)])
    wall = sheet("Wall", (0, 0, 0), (0, 2, 0), (0, 0, 1))
    ground.data.materials.append(diffuse("Grey", (0.6, 0.5, 0.4)))
    wall.data.materials.append(diffuse("Red", (0.8, 0.1, 0.1), emission=(0.3, 0.2, 0.1)))
    return ground, wall


def lit_panels():
    lamp("POINT", (1.2, 0.8, 1.0), energy=40.0)
    return panels()


def put_on_map(ob, first, side=(12.7, 25.1)):
    """A UV map 'Own' with each quad of an object on a rectangle of its own, in texels, beginning at the first."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * side
    places = [corners + first + (20.0 * i, 0.0) for i in range(len(ob.data.polygons))]
    ob.data.uv_layers.new(name="Own").uv.foreach_set("vector", (np.ravel(places) / SIZE).astype(np.float32))


# ---------------------------------------------------------------------------------------------------------- the values


@pytest.mark.parametrize(
    ("quantity", "changes"),
    [
        ("OBSCURANCE", {}),
        ("OBSCURANCE", {"scale": "PAPER"}),
        ("OBSCURANCE", {"use_bleeding": False}),
        ("AMBIENT", {"exposure": 1.0}),
        ("DIRECT", {}),
        ("COMBINED", {"exposure": -2.0}),
        ("RADIOSITY", {}),
        ("RADIOSITY", {"indirect_only": True}),
    ],
)
def test_the_mean_over_texels_is_the_value_of_the_face(quantity, changes):
    """Of the same scene baked to faces, over independent seeds."""
    objects = lit_panels()
    for ob, first in zip(objects, [(3.3, 4.6), (50.2, 7.9)], strict=True):
        put_on_map(ob, first)
    changes = changes | {"quantity": quantity}
    kept = {"uv_mode": "KEEP", "uv_map": "Own", "adaptive": False, "rays": 64}

    def difference(seed):
        texels = means_on_faces(finished(*objects, **changes, **kept, seed=seed))
        bake(*objects, rays=2048, seed=seed + 100, attribute_name="Faces", corner_copy=False, **changes)
        return texels - np.concatenate([colors(ob, "Faces") for ob in objects])

    mean, tolerance = mean_over_seeds(difference)
    brightest = max(colors(ob, "Faces").max() for ob in objects)
    assert tolerance.max() < 0.15 * brightest  # else the comparison says nothing
    assert (abs(mean) <= tolerance).all(), (mean, tolerance)


def test_exposure_brightens_by_stops():
    """Two stops are a factor of four, texel by texel; obscurances have none."""
    objects = lit_panels()
    for ob, first in zip(objects, [(3.3, 4.6), (50.2, 7.9)], strict=True):
        put_on_map(ob, first)
    for quantity, factor in (("COMBINED", 4.0), ("OBSCURANCE", 1.0)):
        plain, bright = (
            result_of(finished(*objects, quantity=quantity, exposure=stops, uv_mode="KEEP")).pages[0]
            for stops in (0.0, 2.0)
        )
        np.testing.assert_allclose(bright[..., :3], factor * plain[..., :3], rtol=1e-6)
        np.testing.assert_array_equal(bright[..., 3], plain[..., 3])


def test_white_is_paper_over_the_mean_reflectance():
    """In every texel, where all is of one grey."""
    objects = panels()
    for ob in objects:
        ob.data.materials.clear()
        ob.data.materials.append(diffuse("One", (0.4, 0.4, 0.4)))
    white, paper = (result_of(finished(*objects, scale=scale)) for scale in ("WHITE", "PAPER"))
    np.testing.assert_allclose(
        white.pages[0][..., :3] * white.report.r_ave, paper.pages[0][..., :3], rtol=1e-5, atol=1e-6
    )


def test_adaptive_texels_stay_within_the_error_bound():
    """The root mean square difference from every texel's own rays is below bound and noise; rays are saved."""
    objects = floor(size=4.0), sheet("Wall", (-2, -2, 0), (0, 4, 0), (0, 0, 1))
    bound = 0.02
    full, adaptive = (finished(*objects, rays=128, adaptive=on, error_bound=bound) for on in (False, True))
    ((_, expected),), ((_, found),) = texels_of(full), texels_of(adaptive)
    rms = np.sqrt(((found - expected) ** 2).mean())
    noise = 2**0.5 * max(result_of(full).report.rmse)
    assert rms <= bound + noise
    assert result_of(adaptive).report.lightmap.traced_texels < 0.6 * result_of(full).report.lightmap.traced_texels
    assert result_of(adaptive).report.rays < result_of(full).report.rays


# ------------------------------------------------------------------------------------------------------------- lookup


def asymmetric():
    """A floor with a wall along x = -1 and a pillar at y = +0.6: no mirroring or turning maps it onto itself."""
    ground = floor(n=8)
    sheet("Wall", (-1, -1, 0), (0, 2, 0), (0, 0, 1))
    pillar = cube("Pillar", half=0.2)
    pillar.location = (0.4, 0.6, 0.21)
    return ground


def looked_up(ob, image, n=6):
    """Mean over n x n places of each quad of what the image has at their UV, nearest texel; (f, 3)."""
    uv, pixels = uv_of(ob).reshape(-1, 4, 2).astype(float), pixels_of(image)
    at = (np.arange(n) + 0.5) / n
    s, t = (a.ravel()[:, None] for a in np.meshgrid(at, at))
    weights = np.concatenate([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], 1)
    places = np.einsum("pk,fkc->fpc", weights, uv)
    x, y = np.floor(places * pixels.shape[0]).astype(int).transpose(2, 0, 1)
    assert (pixels[y, x, 3] == 1.0).all()
    return pixels[y, x, :3].mean(1)


def test_places_are_looked_up_where_their_light_is():
    """The image at a face's UVs has the face's value, dark beside the wall; no flipped or turned image has."""
    ob = asymmetric()
    report = bake_map(ob, rays=64, adaptive=False)
    bake(ob, rays=1024, attribute_name="Faces", corner_copy=False)
    expected, image = colors(ob, "Faces"), bpy.data.images[report.lightmap.image]
    found = looked_up(ob, image)
    rms = np.sqrt(((found - expected) ** 2).mean())
    assert rms < max(report.rmse)
    for orders in [(-1, 1), (1, -1), (-1, -1)]:
        turned = expected.reshape(8, 8, 3)[:: orders[0], :: orders[1]].reshape(-1, 3)
        assert np.sqrt(((found - turned) ** 2).mean()) > 10.0 * rms
    rows = found.reshape(8, 8, 3)
    assert (rows[:4, 0] < rows[:4, 3]).all()


# -------------------------------------------------------------------------------------------------- the same each time


def scene_again():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ob = asymmetric()
    return ob, bpy.data.objects["Pillar"]


@pytest.mark.parametrize("quantity", Quantity)
def test_the_same_scene_gives_the_same_bits(quantity):
    """Pixels, UVs and the number of rays, with any number of threads."""
    found = []
    for threads in (1, 2, 5):
        objects = scene_again()
        lamp("POINT", (0.2, 0.1, 1.0), energy=40.0)
        report = bake_map(*objects, rays=2, threads=threads, quantity=quantity, image_format="EXR_FULL")
        image = pixels_of(bpy.data.images[report.lightmap.image])
        found.append((report.rays, image.tobytes(), *(uv_of(ob).tobytes() for ob in objects)))
    assert image.any()
    assert found[0] == found[1] == found[2]


def test_another_bake_updates_image_and_map_in_place():
    """No second image or map is made, and no note tells of anything replaced."""
    ob = asymmetric()
    image = bpy.data.images[bake_map(ob).lightmap.image]
    first = pixels_of(image).copy()
    report = bake_map(ob, seed=1)
    assert bpy.data.images[:] == [image]
    assert ob.data.uv_layers.keys() == [FACE_LAYER]
    assert not np.array_equal(pixels_of(image), first)
    assert report.warnings == []


# -------------------------------------------------------------------------------------------------------------- pages


def test_a_density_takes_as_many_pages_as_it_needs(tmp_path):
    """4 x 4 m at 100 texels a metre: tiles of 256 from 1001 on, each face in the tile of its page, with its light."""
    ob = asymmetric()
    ob.scale = (2.0, 2.0, 1.0)
    running = finished(ob, texels_per_metre=100.0, image_path=str(tmp_path / "map.exr"))
    layout = layout_of(running)
    report = running.commit()
    told, image = report.lightmap, bpy.data.images["Obscurance"]
    assert told.pages >= 400**2 / SIZE**2
    assert told.texels_per_metre == pytest.approx(100.0, rel=1e-6)
    tiles = [1001 + i for i in range(told.pages)]
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == tiles
    assert told.files == [str(tmp_path / f"map.{tile}.exr") for tile in tiles]
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"map.{tile}.exr" for tile in tiles]
    page = np.full(len(ob.data.polygons), -1)
    page[layout.face] = layout.page
    uv = uv_of(ob).reshape(-1, 4, 2)
    assert set(page) == set(range(told.pages))
    inside = uv - np.stack([page % 10, page // 10], -1)[:, None]
    assert (inside >= 0.0).all()
    assert (inside <= 1.0).all()
    size = np.linalg.norm(uv[:, 1] - uv[:, 0], axis=1) * SIZE
    np.testing.assert_allclose(size, 0.5 * 100.0, rtol=0.02)
    for number, path in enumerate(told.files):
        pixels = pixels_of(bpy.data.images.load(path))
        x, y = (inside[page == number].mean(1) * SIZE).astype(int).T
        expected = result_of(running).pages[number][y, x, :3]
        assert (expected > 0.0).all()
        np.testing.assert_allclose(pixels[y, x, :3], expected, rtol=HALF_STEP)


# ------------------------------------------------------------------------------------------------------ half way, stop


def records():
    """What each mesh remembers of bakes."""
    return {
        mesh.name: [(of.name, of.quantity, of.exposure, of.uv_map, of.image) for of in mesh.obscurance_layers]
        for mesh in bpy.data.meshes
    }


def everything(folder):
    """The file, its records, images and what lies in a folder."""
    images = {image.name: pixels_of(image).tobytes() for image in bpy.data.images}
    return file_state(), records(), images, {path.name: path.read_bytes() for path in folder.iterdir()}


def failing(owner, name, nth, error, monkeypatch):
    """Let the n-th call of a function raise; returns the list that grows with each call."""
    original, calls = getattr(owner, name), []

    def fails(*arguments, **keywords):
        calls.append(name)
        if len(calls) == nth:
            raise error
        return original(*arguments, **keywords)

    monkeypatch.setattr(owner, name, fails)
    return calls


@pytest.mark.parametrize("baked_before", [False, True])
@pytest.mark.parametrize(
    ("owner", "name", "nth"),
    [
        (StagedImage, "write_page", 1),
        (StagedImage, "land", 1),
        (StagedImage, "_into_blend", 1),
        (uv_layer, "prepare", 1),
        (uv_layer, "prepare", 3),
    ],
)
def test_a_failure_half_way_leaves_all_as_it_was(owner, name, nth, baked_before, tmp_path, monkeypatch):
    """Meshes, shared ones too, UV maps, records, images and files."""
    ob, other = asymmetric(), bpy.data.objects["Pillar"]
    twin = bpy.data.objects.new("Twin", other.data)
    twin.location = (-0.5, -0.5, 0.5)
    bpy.context.scene.collection.objects.link(twin)
    path = str(tmp_path / "map.exr")
    other.data.uv_layers.new(name="Mine")
    if baked_before:
        bake_map(ob, other, image_path=path)
    before = everything(tmp_path)
    running = finished(ob, other, twin, seed=1, image_path=path)
    calls = failing(owner, name, nth, ImageFileError("no room"), monkeypatch)
    with pytest.raises(ImageFileError, match="no room"):
        running.commit()
    assert len(calls) == nth
    assert everything(tmp_path) == before


def children():
    """Processes that this one has started, by their ids."""
    found = set()
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and f"PPid:\t{os.getpid()}\n" in (entry / "status").read_text():
                found.add(int(entry.name))
        except OSError:  # gone meanwhile
            continue
    return found


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_cancel_while_unwrapping_ends_the_child_process(tmp_path):
    """xatlas, which cannot be asked to stop, is gone when `cancel` returns, and nothing has changed."""
    ob = floor(n=150)
    before, others = everything(tmp_path), children()
    running = lightmap_job(ob, image_path=str(tmp_path / "map.exr"))
    until = time.monotonic() + 30.0
    while not (started := children() - others) and time.monotonic() < until:
        assert not running.step(0.002)
    assert started
    assert not running.step(0.1)
    running.cancel()
    assert not started & children()
    with pytest.raises(BakeCancelledError):
        running.step(0.0)
    assert everything(tmp_path) == before


@pytest.mark.parametrize("quantity", Quantity)
def test_progress_rises_to_the_end_and_cancel_stops_at_any_time(quantity, tmp_path):
    """Within 0 .. 1; cancelled in the middle, nothing has changed."""
    objects = lit_panels()
    running, seen = lightmap_job(*objects, rays=16, quantity=quantity, threads=3), [0.0]
    while not running.step(0.005):
        seen.append(running.progress)
    assert [*seen, running.progress, 1.0] == sorted([*seen, running.progress, 1.0])
    assert running.progress == 1.0
    before = everything(tmp_path)
    running = lightmap_job(*objects, rays=1 << 12, quantity=quantity, adaptive=False, threads=3)
    until = time.monotonic() + 0.5
    while not running.step(0.01) and time.monotonic() < until:
        pass
    cancelled = time.monotonic()
    running.cancel()
    assert time.monotonic() - cancelled < 2.0
    with pytest.raises(BakeCancelledError):
        running.step(0.0)
    assert everything(tmp_path) == before


# ---------------------------------------------------------------------------------------------- operator, report, undo


def as_settings(**changes):
    """Settings of the scene for a small bake of a lightmap."""
    group = bpy.context.scene.obscurance
    values = {"target": "LIGHTMAP", "lightmap_size": SIZE, "rays": 8, "threads": 1} | changes
    for name, value in values.items():
        setattr(group, name, value)
    return group


def test_the_operator_bakes_what_a_job_bakes():
    """Bit for bit; one undo takes image and map back."""
    ob = asymmetric()
    as_settings(image_format="EXR_FULL")
    select(ob)
    before = file_state()
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.obscurance.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    found = pixels_of(bpy.data.images[FACE_LAYER]), uv_of(ob)
    bpy.ops.ed.undo()
    assert file_state() == before
    ob, group = bpy.data.objects["Floor"], bpy.context.scene.obscurance  # undo has made both anew
    settings = group.to_settings(), group.to_output(), group.to_light(), group.to_lightmap()
    BakeJob(bpy.context, [ob], *settings).run()
    assert found[0].tobytes() == pixels_of(bpy.data.images[FACE_LAYER]).tobytes()
    assert found[1].tobytes() == uv_of(ob).tobytes()


def test_the_report_tells_of_the_lightmap():
    """Texels, rays, use and density are those of the pages; the summary has them in words."""
    ob = asymmetric()
    running = finished(ob, rays=8, adaptive=False)
    ((texels, _),) = texels_of(running)
    report = running.commit()
    told = report.lightmap
    assert (told.image, told.files, told.size, told.pages) == (FACE_LAYER, [], SIZE, 1)
    assert report.patches == told.traced_texels == len(texels)
    assert told.use == len(texels) / SIZE**2
    assert report.rays >= 8 * len(texels)
    uv = uv_of(ob).reshape(-1, 4, 2)
    side = np.linalg.norm(uv[:, 1] - uv[:, 0], axis=1) * SIZE / 0.25
    np.testing.assert_allclose(side, told.texels_per_metre, rtol=0.02)
    assert set(report.seconds) == {"extract", "unwrap", "build", "trace", "margin", "write"}
    assert report.objects == ["Floor"]
    assert f"{len(texels):,} texels on a page of 256 ({told.use:.0%} used) of 'Floor'" in report.summary()
    assert bpy.data.images[FACE_LAYER].packed_files
