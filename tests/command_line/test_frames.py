"""Ranges of frames from the command line: the frame cache, its playback, and animated colours in USD and Alembic."""

import json
import shutil

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation import ExportError, export_in_process
from obscurance_addon.blender.animation.live_preview import PREVIEW
from obscurance_addon.blender.frame_caches.frame_cache import FrameCache, FrameCacheError
from obscurance_addon.blender.writing import ExportFormat, copy_for_export
from obscurance_addon.command_line import batch
from obscurance_addon.core.order import OutputSettings
from tests.blender.helpers import FACE_LAYER, bake, colors, cube, floor, put, read

FRAMES = 6
NAMES = ("Floor", "Block")


@pytest.fixture
def scene(empty_scene, tmp_path):
    """A file with a block that passes over a floor, within its bounds, and a far floor that it never reaches."""
    floor(size=6.0, n=4)
    floor("Far", n=2).location = (30, 0, 0)
    block = cube("Block", 0.3)
    for frame, place in ((1, (-2, 0, 0.5)), (FRAMES, (1, 0.2, 0.5))):
        block.location = place
        block.keyframe_insert("location", frame=frame)
    group = empty_scene.obscurance
    group.rays, group.distance_mode, group.distance = 16, "METRES", 1.0
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    yield path
    PREVIEW.stop()


def run(*arguments):
    return batch.main(["bake", *map(str, arguments)])


def stored(folder):
    """The first and the last frame of a frame cache, and for each object the runs of frames that hold it."""
    index = json.loads((folder / "index.json").read_text())
    return index["frames"], index["objects"]


def files(folder):
    """What lies in a folder, by path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def open_file(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects


def test_every_frame_is_that_of_a_full_bake_and_plays_without_a_ray(scene, tmp_path, monkeypatch):
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", f"1-{FRAMES}", "--quiet") == 0
    objects = open_file(out)
    assert bpy.context.scene.obscurance.frame_cache == "//out_frames"
    with monkeypatch.context() as patch:
        patch.setattr("obscurance_addon.core.order.following._BAKES", {})
        played = {}
        for frame in (1, 4, 2, FRAMES, 3):
            bpy.context.scene.frame_set(frame)
            played[frame] = {name: colors(objects[name]).copy() for name in NAMES}
    assert len({values["Floor"].tobytes() for values in played.values()}) == len(played)
    bpy.context.scene.obscurance.live_preview = False
    targets = [objects[name] for name in ("Floor", "Far", "Block")]
    for frame, values in played.items():
        bpy.context.scene.frame_set(frame)
        bake(*targets, attribute_name="Full", corner_copy=False, rays=16, distance=1.0)
        assert all(np.array_equal(values[name], colors(objects[name], "Full")) for name in NAMES)


def test_the_report_tells_every_frame(scene, tmp_path):
    report = tmp_path / "report.json"
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "2-5", "--report", report, "--quiet") == 0
    (entry,) = json.loads(report.read_text())["files"]
    assert [one["frame"] for one in entry["frames"]] == [2, 3, 4, 5]
    first, *later = entry["frames"]
    assert first["full_bake"]
    assert first["patches"] == 16 + 4 + 6
    assert all(not one["full_bake"] and 0 < one["patches"] < 26 and one["milliseconds"] > 0 for one in later)
    assert sorted(entry["objects"]) == ["Block", "Far", "Floor"]
    assert entry["rays"] == sum(one["rays"] for one in entry["frames"])


def test_what_did_not_change_is_stored_once(scene, tmp_path):
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", f"1-{FRAMES}", "--quiet") == 0
    _, objects = stored(tmp_path / "o_frames")
    assert objects["Far"] == [[1, 1]]
    assert objects["Block"] == [[1, FRAMES]]


@pytest.mark.parametrize("suffix", [".usda", ".abc"])
def test_animated_colours_come_back_from_other_formats(scene, tmp_path, suffix):
    out, exported = tmp_path / "out.blend", tmp_path / f"out{suffix}"
    assert run(scene, "--output", out, "--frames", f"1-{FRAMES}", "--export", exported, "--quiet") == 0
    objects = open_file(out)
    expected = {}
    for frame in (1, 3, FRAMES):
        bpy.context.scene.frame_set(frame)
        expected[frame] = np.repeat(colors(objects["Floor"]), 4, axis=0)
        assert not objects["Floor"].modifiers
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if suffix == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(exported), as_background_job=False)
    else:
        bpy.ops.wm.usd_import(filepath=str(exported))
    ob = next(ob for ob in bpy.data.objects if ob.type == "MESH" and ob.name.startswith("Floor"))
    layer, tolerance = ("Cd", 0.01) if suffix == ".abc" else ("displayColor", 1e-6)
    for frame, values in expected.items():
        bpy.context.scene.frame_set(frame)
        mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        found = np.array([corner.color[:3] for corner in mesh.attributes[layer].data])
        np.testing.assert_allclose(found, np.clip(values, 0, 1), atol=tolerance)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frames", "5-1"], "end before they begin"),
        (["--frames", "all"], "no range of frames"),
        (["--frames", "1-2", "--target", "LIGHTMAP"], "another --target"),
        (["--frame-cache", "x"], "give --frames too"),
        (["--export", "x.usdc"], "give --frames too"),
    ],
)
def test_what_makes_no_sense_is_said_before_anything_is_baked(scene, capsys, options, words):
    with pytest.raises(SystemExit) as left:
        run(scene, *options)
    assert left.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("quantity", ["OBSCURANCE", "DIRECT"])
def test_a_file_that_asks_for_a_lightmap_is_refused(scene, tmp_path, capsys, quantity):
    bpy.context.scene.obscurance.target = "LIGHTMAP"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    out = tmp_path / "o.blend"
    assert run(scene, "--output", out, "--frames", "1-2", "--quantity", quantity) == 1
    assert "another target than LIGHTMAP" in capsys.readouterr().err
    assert not out.exists()


def test_an_unknown_format_is_named(scene, tmp_path, capsys):
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-2", "--export", tmp_path / "o.fbx") == 1
    assert "o.fbx" in capsys.readouterr().err
    assert not (tmp_path / "o_frames").exists()


def test_a_deforming_mesh_is_baked_at_every_frame(scene, tmp_path):
    block = bpy.data.objects["Block"]
    block.animation_data_clear()
    block.location = (0, 0, 0.6)
    block.shape_key_add(name="Basis")
    bulge = block.shape_key_add(name="Bulge")
    for point in bulge.data:
        point.co = point.co * 1.5
    for frame, value in ((1, 0.0), (FRAMES, 1.0)):
        bulge.value = value
        bulge.keyframe_insert("value", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", f"1-{FRAMES}", "--quiet") == 0
    _, objects = stored(tmp_path / "o_frames")
    assert objects["Block"] == objects["Floor"] == [[1, FRAMES]]


def test_nothing_need_be_visible_at_first(scene, tmp_path):
    for name in (*NAMES, "Far"):
        ob = bpy.data.objects[name]
        for frame, hidden in ((1, True), (3, False)):
            ob.hide_render = hidden
            ob.keyframe_insert("hide_render", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-4", "--quiet") == 0
    frames, objects = stored(tmp_path / "o_frames")
    assert frames == [1, 4]
    assert objects["Far"] == [[3, 3]]


def test_frames_before_0(scene, tmp_path):
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "-2-1", "--quiet") == 0
    assert stored(tmp_path / "o_frames")[0] == [-2, 1]


def test_leaving_and_entering_the_cached_frames(scene, tmp_path):
    """Neither what was computed stays within them, nor what was cached beyond."""
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-3", "--quiet") == 0
    objects = open_file(out)
    seen = {}
    for frame in (3, 5, 3, 1, 5, 1):
        bpy.context.scene.frame_set(frame)
        values = colors(objects["Floor"]).copy()
        assert np.array_equal(values, seen.setdefault(frame, values)), frame
    assert len({values.tobytes() for values in seen.values()}) == 3


@pytest.mark.parametrize("suffix", [".usdc", ".abc"])
def test_an_export_that_fails_leaves_the_former_one_and_what_was_baked(scene, tmp_path, capsys, monkeypatch, suffix):
    """With no room for its file; Alembic's exporter ends the process then, and USD's says nothing."""
    resource = pytest.importorskip("resource")

    def without_room(*arguments):
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
        try:
            export_in_process(*arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    monkeypatch.setattr("obscurance_addon.blender.animation.export_in_process", without_room)
    out, exported = tmp_path / "o.blend", tmp_path / f"o{suffix}"
    exported.write_bytes(b"the former one")
    assert run(scene, "--output", out, "--frames", "1-2", "--export", exported) == 1
    said = capsys.readouterr().err
    assert f"o{suffix}' could not be " in said
    assert "make room" in said
    assert "choose another folder" in said
    assert exported.read_bytes() == b"the former one"
    assert {path.name for path in tmp_path.iterdir()} == {"o.blend", f"o{suffix}", "o_frames", "scene.blend"}
    open_file(out)
    bpy.context.scene.frame_set(2)
    assert "from the cache" in PREVIEW.status


def test_frames_that_a_format_does_not_know_are_said_before_the_bake(scene, tmp_path, capsys):
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "-2-1", "--export", tmp_path / "o.usdc") == 1
    assert "frames before 0" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.blend"]


def test_what_the_exporting_process_refuses_is_said(scene, tmp_path):
    """It opens a file whose frame cache is of other faces."""
    out = tmp_path / "o.blend"
    assert run(scene, "--output", out, "--frames", "1-2", "--quiet") == 0
    objects = open_file(out)
    objects["Floor"].data = floor("Other", n=5).data
    bpy.ops.wm.save_as_mainfile(filepath=str(out))
    with pytest.raises(ExportError, match="'Floor' has other faces") as raised:
        export_in_process(out, tmp_path / "o_frames", tmp_path / "o.usda")
    assert "\n" not in str(raised.value)


def test_the_scene_that_is_baked_is_exported(scene, tmp_path):
    """Another one than opens with the file."""
    exported = tmp_path / "o.usda"
    other = bpy.data.scenes.new("Other")
    for name in ("Floor", "Block"):
        copy = bpy.data.objects[name].copy()
        copy.data, copy.name = copy.data.copy(), f"Other {name}"
        other.collection.objects.link(copy)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    options = ("--scene", "Other", "--frames", "1-2", "--export", exported, "--quiet")
    assert run(scene, "--output", tmp_path / "o.blend", *options) == 0
    text = exported.read_text()
    assert "Other_Floor" in text
    assert '"Floor"' not in text


def test_an_export_leaves_no_layer(scene, tmp_path):
    out, exported = tmp_path / "o.blend", tmp_path / "o.usda"
    assert run(scene, "--output", out, "--frames", "1-2", "--export", exported, "--quiet") == 0
    assert "displayColor" not in open_file(out)["Floor"].data.attributes


def test_an_export_leaves_the_copies_that_were_there(scene, tmp_path):
    """As they were made; they are still known as copies."""
    out, exported = tmp_path / "o.blend", tmp_path / "o.usda"
    bake(bpy.data.objects["Floor"], rays=16)
    copy_for_export([bpy.data.objects["Floor"]], OutputSettings(), ExportFormat.USD)
    before = colors(bpy.data.objects["Floor"], "displayColor").copy()
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert run(scene, "--output", out, "--frames", "1-2", "--export", exported, "--quiet") == 0
    objects = open_file(out)
    assert "displayColor" not in objects["Far"].data.attributes
    assert np.array_equal(colors(objects["Floor"], "displayColor"), before)
    copy_for_export([objects["Floor"]], OutputSettings(), ExportFormat.USD)


@pytest.mark.parametrize(
    ("layer", "data_type", "domain", "quantity"),
    [
        ("displayColor", "FLOAT_COLOR", "CORNER", "OBSCURANCE"),
        ("displayColor", "FLOAT", "FACE", "OBSCURANCE"),
        (FACE_LAYER, "FLOAT_COLOR", "FACE", "OBSCURANCE"),
        (FACE_LAYER, "FLOAT_COLOR", "FACE", "DIRECT"),
    ],
)
def test_layers_of_the_users_are_refused_before_any_frame(scene, tmp_path, capsys, layer, data_type, domain, quantity):
    """Those of the result's name, and those of the export's; nothing is written."""
    put(bpy.data.objects["Far"].data, layer, data_type, domain)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    options = "--frames", "1-2", "--export", tmp_path / "o.usda", "--quantity", quantity
    assert run(scene, *options) == 1
    said = capsys.readouterr().err
    assert "'Far' has a" in said
    assert f"named '{layer}'" in said
    assert "frame " not in said
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_playback_replaces_no_layer_of_the_users(scene, tmp_path):
    """Where one object has one, none gets values."""
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-3", "--quiet") == 0
    objects = open_file(out)
    objects["Far"].data = floor("Twin", n=2).data
    put(objects["Far"].data, FACE_LAYER, "FLOAT_COLOR", "FACE")
    before = read(objects["Far"].data, FACE_LAYER), read(objects["Floor"].data, FACE_LAYER)
    PREVIEW.distrust()
    bpy.context.scene.frame_set(2)
    assert "'Far' has a color attribute named 'Obscurance'" in PREVIEW.status
    assert np.array_equal(read(objects["Far"].data, FACE_LAYER), before[0])
    assert np.array_equal(read(objects["Floor"].data, FACE_LAYER), before[1])


def test_a_file_among_those_of_a_cache_is_kept(scene, tmp_path, capsys):
    """One that is named like them, but that the index does not know."""
    out, folder = tmp_path / "o.blend", tmp_path / "o_frames"
    assert run(scene, "--output", out, "--frames", "1-2", "--quiet") == 0
    (folder / "frame_000007.npz").write_text("mine")
    assert run(scene, "--output", out, "--frames", "1-2") == 1
    assert "'frame_000007.npz'" in capsys.readouterr().err
    assert (folder / "frame_000007.npz").read_text() == "mine"


@pytest.mark.parametrize("names", [["frame_0001.npz"], ["index.json"]])
def test_a_folder_that_looks_like_a_cache_is_not_replaced(scene, tmp_path, names):
    folder = tmp_path / "mine"
    folder.mkdir()
    for name in names:
        (folder / name).write_text("mine")
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-2", "--frame-cache", folder) == 1
    assert sorted(path.name for path in folder.iterdir()) == names


def test_a_folder_of_the_users_is_never_replaced(scene, tmp_path, capsys):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-2", "--frame-cache", folder) == 1
    assert "notes.txt" in capsys.readouterr().err
    assert (folder / "notes.txt").read_text() == "mine"


def test_an_older_cache_is_replaced_whole(scene, tmp_path):
    for last in (4, 2):
        assert run(scene, "--output", tmp_path / "o.blend", "--frames", f"1-{last}", "--quiet") == 0
    names = sorted(path.rpartition("/")[2] for path in files(tmp_path / "o_frames"))
    assert names == ["frame_000001.npz", "frame_000002.npz", "index.json", "obscurance.lock"]
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_failure_leaves_the_older_cache(scene, tmp_path, monkeypatch):
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-2", "--quiet") == 0
    before = files(tmp_path / "o_frames")

    def fail(*_args, **_kw):
        raise MemoryError("no room")

    monkeypatch.setattr("obscurance_addon.blender.animation.frame_update.FrameUpdater.update", fail)
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-4", "--quiet") == 1
    assert files(tmp_path / "o_frames") == before
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_cache_that_is_gone_or_broken_is_said(scene, tmp_path):
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-2", "--quiet") == 0
    open_file(out)
    next((tmp_path / "out_frames").glob("*/frame_000001.npz")).write_bytes(b"nothing")
    bpy.context.scene.frame_set(1)
    assert "bake the frames again" in PREVIEW.status
    shutil.rmtree(tmp_path / "out_frames")
    with pytest.raises(FrameCacheError, match="no frame cache"):
        FrameCache.open(tmp_path / "out_frames")


def test_other_faces_than_those_of_the_cache_are_said(scene, tmp_path):
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-3", "--quiet") == 0
    objects = open_file(out)
    objects["Floor"].data = floor("Other", n=5).data
    bpy.context.scene.frame_set(2)
    assert "'Floor' has other faces" in PREVIEW.status


def test_an_object_of_the_cache_that_is_gone_is_said(scene, tmp_path, caplog):
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-3", "--quiet") == 0
    objects = open_file(out)
    objects["Block"].name = "Renamed"
    with caplog.at_level("INFO"):
        bpy.context.scene.frame_set(2)
        bpy.context.scene.frame_set(3)
    assert len([r for r in caplog.records if "'Block'" in r.message]) == 1


def test_a_file_that_has_live_preview_on_is_baked_once_a_frame(scene, tmp_path, monkeypatch):
    bpy.context.scene.obscurance.live_preview = True
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    monkeypatch.setattr("obscurance_addon.blender.animation.live_preview.FrameUpdater", None)
    assert run(scene, "--output", tmp_path / "o.blend", "--frames", "1-3", "--quiet") == 0


def test_beyond_the_cache_frames_are_computed(scene, tmp_path):
    out = tmp_path / "out.blend"
    assert run(scene, "--output", out, "--frames", "1-3", "--quiet") == 0
    objects = open_file(out)
    bpy.context.scene.frame_set(5)
    before = colors(objects["Floor"], FACE_LAYER).copy()
    bpy.context.scene.obscurance.live_preview = False
    bake(*(objects[name] for name in (*NAMES, "Far")), attribute_name="Full", corner_copy=False, rays=16, distance=1.0)
    assert np.array_equal(before, colors(objects["Floor"], "Full"))


def test_light_is_baked_for_every_frame(scene, tmp_path):
    out = tmp_path / "out.blend"
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    lamp.location = (0, 0, 2)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    assert run(scene, "--output", out, "--frames", "1-3", "--quantity", "DIRECT", "--quiet") == 0
    objects = open_file(out)
    found = []
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        found.append(colors(objects["Floor"]).copy())
    assert not np.array_equal(found[0], found[2])
