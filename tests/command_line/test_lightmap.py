"""Files and names of lightmaps, what a refusal leaves, and the command line, killed too."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.writing.image_files import ImageFileError
from obscurance_addon.blender.writing.values import SceneChangedError
from obscurance_addon.command_line import batch
from obscurance_addon.core.errors import ObscuranceError
from obscurance_addon.core.order.output import ImageFormat
from tests.blender.helpers import (
    CORNER_LAYER,
    FACE_LAYER,
    bake,
    floor,
    mesh_state,
    notes_about,
    select,
    subset,
)
from tests.blender.jobs.test_lightmap_bake import (
    SIZE,
    as_settings,
    asymmetric,
    bake_map,
    everything,
    finished,
    lightmap_job,
    pixels_of,
    uv_of,
)
from tests.blender.writing.test_image import check_values, linear

pytestmark = pytest.mark.usefixtures("empty_scene")
ROOT = Path(__file__).parents[2]
FORMATS = {"EXR_HALF": ".exr", "EXR_FULL": ".exr", "PNG_8": ".png", "PNG_16": ".png", "HDR": ".hdr"}
# -------------------------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("image_format", FORMATS)
def test_the_image_and_its_file_hold_the_result(image_format, packed, tmp_path):
    """As precisely as the format can; the extension is added; beside the file lies nothing else."""
    ob = asymmetric()
    path = "" if packed else str(tmp_path / "map")
    running = finished(ob, image_path=path, image_format=image_format)
    expected, report = running._run.result.pages[0], running.commit()
    image = bpy.data.images[report.lightmap.image]
    assert bool(image.packed_files) == packed
    check_values(linear(image), expected, ImageFormat(image_format))
    files = [] if packed else [str(tmp_path / "map") + FORMATS[image_format]]
    assert report.lightmap.files == files
    assert [str(found) for found in tmp_path.iterdir()] == files


@pytest.mark.parametrize("path", ["maps/map.exr", "//maps/map.exr"])
def test_relative_paths_start_where_they_should(path, tmp_path, monkeypatch):
    """At the folder of the .blend with //, else at the working folder."""
    for name in ("here", "there"):
        (tmp_path / name / "maps").mkdir(parents=True)
    ob = asymmetric()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "there" / "scene.blend"))
    monkeypatch.chdir(tmp_path / "here")
    report = bake_map(ob, image_path=path)
    folder = "there" if path.startswith("//") else "here"
    assert report.lightmap.files == [str(tmp_path / folder / "maps" / "map.exr")]
    assert Path(report.lightmap.files[0]).is_file()
    assert Path(bpy.path.abspath(bpy.data.images[FACE_LAYER].filepath)).resolve() == Path(report.lightmap.files[0])


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("{}/map.png", r"ends in \.png.*end in \.exr"),
        ("{}/missing/map.exr", r"missing' does not exist: create it first"),
        ("//map.exr", "has not been saved: save it first"),
        ("{}", "is a folder"),
    ],
)
def test_a_path_that_cannot_be_used_is_told_before_anything_is_computed(path, words, tmp_path):
    """By the constructor of the job; the file and the folder stay."""
    ob = asymmetric()
    before = everything(tmp_path)
    with pytest.raises(ImageFileError, match=words):
        lightmap_job(ob, image_path=path.format(tmp_path))
    assert everything(tmp_path) == before


def test_a_folder_that_goes_away_meanwhile_is_an_error(tmp_path):
    """Nothing of the scene changes."""
    ob = asymmetric()
    (tmp_path / "maps").mkdir()
    running = finished(ob, image_path=str(tmp_path / "maps" / "map.exr"))
    (tmp_path / "maps").rmdir()
    before = everything(tmp_path)
    with pytest.raises(ImageFileError, match="maps"):
        running.commit()
    assert everything(tmp_path) == before


# -------------------------------------------------------------------------------------------------------------- names


def own_uv_map(ob):
    ob.data.uv_layers.new(name=FACE_LAYER)


def own_attribute(ob):
    ob.data.attributes.new(FACE_LAYER, "FLOAT", "POINT")


def own_color(ob):
    ob.data.color_attributes.new(FACE_LAYER, "FLOAT_COLOR", "CORNER")


def own_group(ob):
    ob.vertex_groups.new(name=FACE_LAYER)


def eight_maps(ob):
    for i in range(8):
        ob.data.uv_layers.new(name=f"Map {i}")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (own_uv_map, "UV map named 'Obscurance'"),
        (own_attribute, "attribute named 'Obscurance'"),
        (own_color, "attribute named 'Obscurance'"),
        (own_group, "vertex group named 'Obscurance'"),
        (eight_maps, "has 8 UV maps"),
    ],
)
@pytest.mark.parametrize("meanwhile", [False, True])
def test_what_the_user_has_is_not_replaced(make, words, meanwhile, tmp_path):
    """Named with the object, also when it came during the bake; nothing changes on any object, no file is made."""
    ob, other = floor("Floor"), floor("Other", z=1.0)
    if meanwhile:
        running = finished(ob, other, image_path=str(tmp_path / "map.exr"))
    make(other)
    before = everything(tmp_path)
    with pytest.raises(ObscuranceError, match=f"'Other'.*{words}"):
        running.commit() if meanwhile else lightmap_job(ob, other, image_path=str(tmp_path / "map.exr"))
    assert everything(tmp_path) == before


def test_a_mesh_edited_meanwhile_gets_nothing(tmp_path):
    """The error names the object; no image, file or map is made."""
    ob, other = floor("Floor"), floor("Other", z=1.0)
    running = finished(ob, other, image_path=str(tmp_path / "map.exr"))
    other.data.clear_geometry()
    other.data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    before = everything(tmp_path)
    with pytest.raises(SceneChangedError, match="'Other'"):
        running.commit()
    assert everything(tmp_path) == before


def test_maps_that_render_stay_and_the_rest_too():
    """The new map is active in editors only; all else of the mesh is bit for bit the same."""
    ob = asymmetric()
    for name in ("First", "Second"):
        ob.data.uv_layers.new(name=name)
    ob.data.uv_layers.active = ob.data.uv_layers["First"]
    ob.data.uv_layers["Second"].active_render = True
    ob.data.color_attributes.new("Mine", "BYTE_COLOR", "CORNER")
    before = subset(mesh_state(ob.data))
    bake_map(ob)
    assert [uv.name for uv in ob.data.uv_layers if uv.active_render] == ["Second"]
    assert ob.data.uv_layers.active.name == FACE_LAYER
    after = subset(mesh_state(ob.data, without=[FACE_LAYER]))
    assert after.pop("uv") == [*before.pop("uv"), (FACE_LAYER, False)]
    assert (before.pop("active uv"), after.pop("active uv")) == ("First", FACE_LAYER)
    assert after == before


def test_colours_and_lightmaps_take_each_others_place():
    """With a note each time, and the active colour of the user stays."""
    ob = asymmetric()
    ob.data.color_attributes.new("Mine", "BYTE_COLOR", "CORNER")
    bake(ob, corner_copy=False)
    ob.data.attributes.active_color_name = "Mine"
    report = bake_map(ob)
    assert notes_about(report.warnings, "colors 'Obscurance' of mesh 'Floor' were replaced")
    assert FACE_LAYER in ob.data.uv_layers
    assert ob.data.attributes.active_color_name == "Mine"
    report = bake(ob)
    assert notes_about(report.warnings, "UV map 'Obscurance' of mesh 'Floor'", "was replaced")
    assert FACE_LAYER not in ob.data.uv_layers
    assert ob.data.attributes[FACE_LAYER].domain == "FACE"
    report = bake_map(ob)
    assert ob.data.uv_layers.keys() == [FACE_LAYER]
    assert bpy.data.images.keys() == [FACE_LAYER]
    assert CORNER_LAYER in ob.data.attributes


def test_another_name_makes_another_lightmap():
    """Both stay, and a user's image of that name is left alone."""
    ob = asymmetric()
    mine = bpy.data.images.new("Second", 4, 4)
    before = pixels_of(mine).copy()
    bake_map(ob)
    report = bake_map(ob, attribute_name="Second")
    assert ob.data.uv_layers.keys() == [FACE_LAYER, "Second"]
    assert bpy.data.images[report.lightmap.image] != mine
    assert np.array_equal(pixels_of(mine), before)


# ------------------------------------------------------------------------------------------------------- command line


@pytest.fixture
def scene(tmp_path):
    """A small scene on disk."""
    asymmetric()
    group = bpy.context.scene.obscurance
    group.rays, group.threads = 4, 1
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def options(*more):
    return ["--target", "LIGHTMAP", "--size", str(SIZE), "--objects", "Floor", *map(str, more)]


def run(scene, *arguments):
    return batch.main(["bake", str(scene), *map(str, arguments)])


def load(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects


@pytest.mark.parametrize("image", ["//map.exr", ""])
def test_the_command_line_bakes_what_the_operator_bakes(scene, tmp_path, image):
    """Bit for bit, into the image beside the scene or packed; the report and the terminal tell of it."""
    load(scene)
    select(bpy.data.objects["Floor"])
    as_settings(rays=4, image_format="EXR_FULL")
    bpy.ops.obscurance.bake()
    expected = pixels_of(bpy.data.images[FACE_LAYER]), uv_of(bpy.data.objects["Floor"])
    where = ["--image", image] if image else []
    arguments = options("--image-format", "EXR_FULL", "--report", tmp_path / "report.json", *where)
    done = subprocess.run(
        [sys.executable, "-m", "obscurance_addon", "bake", str(scene), *arguments],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert f"texels on a page of {SIZE}" in done.stdout
    ob = load(scene)["Floor"]
    found = bpy.data.images[FACE_LAYER]
    assert bool(found.packed_files) == (not image)
    assert pixels_of(found).tobytes() == expected[0].tobytes()
    assert uv_of(ob).tobytes() == expected[1].tobytes()
    assert FACE_LAYER not in bpy.data.objects["Pillar"].data.uv_layers
    (entry,) = json.loads((tmp_path / "report.json").read_text())["files"]
    told = entry["lightmap"]
    assert (told["image"], told["size"], told["pages"]) == (FACE_LAYER, SIZE, 1)
    assert told["files"] == ([str(tmp_path / "map.exr")] if image else [])
    assert 0 < told["traced_texels"] <= entry["patches"] == round(told["use"] * SIZE**2)
    assert told["texels_per_metre"] > 0.0
    assert entry["settings"]["target"] == "LIGHTMAP"
    assert entry["settings"]["lightmap_size"] == SIZE
    assert {"unwrap", "margin"} <= set(entry["seconds"])


def test_a_lightmap_that_cannot_go_anywhere_fails_the_file(scene, tmp_path, capsys):
    """Status 1, the error names scene and folder, nothing is written."""
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(scene, *options("--image", tmp_path / "missing" / "map.exr")) == 1
    told = capsys.readouterr().err
    assert f"{scene}: " in told
    assert "missing' does not exist" in told
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "100"], "lightmap size is 100"),
        (["--texels-per-metre", "0"], "texels per metre is 0"),
        (["--error-bound", "0"], "error bound is 0"),
        (["--margin", "-1"], "margin is -1"),
        (["--shared-meshes", "AVERAGE"], "use shared meshes SEPARATE"),
        (["other.blend", "--image", "map.exr", "--output-dir", "."], "--image would be written by several"),
    ],
)
def test_wrong_usage_is_status_2(scene, arguments, words, capsys):
    """Before any file is touched."""
    before = scene.read_bytes()
    with pytest.raises(SystemExit) as stop:
        run(scene, *arguments, "--target", "LIGHTMAP")
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert scene.read_bytes() == before


# Runs the command line and dies before or after the n-th renaming of a file.
DRIVER = """
import os, signal, sys
import bpy
import obscurance_addon
from obscurance_addon.command_line import batch

obscurance_addon.register()
when, nth = sys.argv[1], int(sys.argv[2])
replace, calls = os.replace, []

def last(*arguments, **keywords):
    calls.append(arguments)
    if when == "before" and len(calls) == nth:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*arguments, **keywords)
    if when == "after" and len(calls) == nth:
        os.kill(os.getpid(), signal.SIGKILL)

os.replace = last
os._exit(batch.main(["bake", *sys.argv[3:], "--quiet"]))
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(("when", "new"), [("before", False), ("after", True)])
def test_a_kill_leaves_the_old_image_or_the_new_one(scene, tmp_path, when, new):
    """Whole, and the scene that opens finds it; a later run succeeds."""
    arguments = options("--image", "//map.exr")
    assert run(scene, *arguments, "--quiet") == 0
    image, old_scene = tmp_path / "map.exr", scene.read_bytes()
    old = image.read_bytes()
    command = [sys.executable, "-c", DRIVER, when, "1", str(scene), *arguments, "--seed", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert scene.read_bytes() == old_scene
    assert (image.read_bytes() == old) == (not new)
    load(scene)
    pixels = pixels_of(bpy.data.images[FACE_LAYER])
    assert pixels.shape == (SIZE, SIZE, 4)
    assert pixels[..., 3].any()
    assert run(scene, *arguments, "--quiet", "--seed", "1") == 0
    assert image.read_bytes() != old
