"""The command line: what it bakes, where it writes, what it reports, and how it fails."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.command_line import batch
from obscurance_addon.version import version
from tests.blender.helpers import CORNER_LAYER, FACE_LAYER, colors, cube, floor, put, select, sheet

pytestmark = pytest.mark.usefixtures("empty_scene")
ROOT = Path(__file__).parents[2]


def build():
    """A floor with a red wall on its edge, 16 rays, nothing selected."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=(0.8, 0.1, 0.1))
    bpy.context.scene.obscurance.rays = 16
    bpy.context.scene.obscurance.threads = 1


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def load(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects


@pytest.fixture
def scene(tmp_path):
    build()
    return save(tmp_path / "scene.blend")


def run(*arguments):
    return batch.main(["bake", *map(str, arguments)])


def command(*arguments, **kw):
    return subprocess.run(
        [sys.executable, "-m", "obscurance_addon", *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        **kw,
    )


def usage_error(capsys, *arguments):
    """What is said when these arguments make no sense; leaves with status 2."""
    with pytest.raises(SystemExit) as stop:
        run(*arguments)
    assert stop.value.code == 2
    return capsys.readouterr().err


def folder_state(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# ------------------------------------------------------------------------------------------------------------- writes


def test_output_gets_the_result_and_the_scene_stays(scene, tmp_path):
    """The scene's bytes are the same; everything that renders is baked; nothing else lies in the folder."""
    before, out = scene.read_bytes(), tmp_path / "out.blend"
    assert run(scene, "--output", out) == 0
    assert scene.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"scene.blend", "out.blend"}
    objects = load(out)
    assert [ob.name for ob in objects if FACE_LAYER in ob.data.attributes] == ["Floor", "Wall"]


def test_a_scene_is_chosen_by_name(tmp_path, capsys):
    """The other scene is baked, the file opens at the first one; an unknown name lists those there are."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.name = "Menu"
    game = bpy.data.scenes.new("Game")
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4)
    bpy.context.scene.collection.objects.unlink(ob)
    game.collection.objects.link(ob)
    source, out = save(tmp_path / "scene.blend"), tmp_path / "out.blend"
    assert run(source, "--output", out, "--rays", 4) == batch.FAILED
    assert "meshes in other scenes: 'Game'" in capsys.readouterr().err
    assert run(source, "--output", out, "--rays", 4, "--scene", "Gmae") == batch.FAILED
    assert "no scene 'Gmae': choose one of 'Game', 'Menu'" in capsys.readouterr().err
    assert run(source, "--output", out, "--rays", 4, "--scene", "Game") == batch.DONE
    assert FACE_LAYER in load(out)["Floor"].data.attributes
    assert bpy.context.scene.name == "Menu"


def test_without_output_the_scene_is_saved_in_place(scene, tmp_path):
    """No backup, no rest."""
    assert run(scene) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["scene.blend"]
    assert FACE_LAYER in load(scene)["Floor"].data.attributes


@pytest.mark.parametrize(
    ("data_type", "domain", "options"),
    [
        ("FLOAT_COLOR", "FACE", ()),
        ("BYTE_COLOR", "CORNER", ("--target", "CORNER")),
        ("FLOAT_VECTOR", "POINT", ("--target", "POINT")),
        ("FLOAT_COLOR", "CORNER", ("--target", "LIGHTMAP")),
        ("FLOAT2", "CORNER", ()),
    ],
)
def test_a_file_with_a_layer_of_the_results_name_is_not_touched(
    tmp_path, monkeypatch, capsys, data_type, domain, options
):
    """It is refused before anything is computed, and the message names object, layer and cure."""
    build()
    put(bpy.data.objects["Wall"].data, FACE_LAYER, data_type, domain)
    scene = save(tmp_path / "scene.blend")
    before = folder_state(tmp_path)
    monkeypatch.setattr(BakeJob, "step", None)
    assert run(scene, *options) == 1
    assert re.search(r"'Wall' has a .*named 'Obscurance', .*choose another .*name", capsys.readouterr().err)
    assert folder_state(tmp_path) == before


def test_several_scenes_go_to_a_folder(scene, tmp_path):
    """Under their own names."""
    floor("Third")
    other, out = save(tmp_path / "other.blend"), tmp_path / "out"
    out.mkdir()
    assert run(scene, other, "--output-dir", out) == 0
    assert {path.name for path in out.iterdir()} == {"scene.blend", "other.blend"}
    assert "Third" not in load(out / "scene.blend")
    assert FACE_LAYER in load(out / "other.blend")["Third"].data.attributes


def test_paths_to_other_files_still_lead_there(tmp_path):
    """A relative path to an image beside the scene is right from the output's folder, too."""
    build()
    image = bpy.data.images.new("Paint", 2, 2)
    image.filepath_raw, image.file_format = str(tmp_path / "paint.png"), "PNG"
    image.save()
    image.source = "FILE"
    image.use_fake_user = True
    scene = save(tmp_path / "scene.blend")
    bpy.ops.file.make_paths_relative()
    save(scene)
    assert bpy.data.images["Paint"].filepath.startswith("//")
    out = tmp_path / "deep" / "er"
    out.mkdir(parents=True)
    assert run(scene, "--output-dir", out) == 0
    load(out / "scene.blend")
    assert Path(bpy.path.abspath(bpy.data.images["Paint"].filepath)).resolve() == tmp_path / "paint.png"


@pytest.mark.parametrize("compressed", [False, True])
def test_files_stay_compressed_or_plain(tmp_path, compressed):
    """As they were."""
    build()
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=compressed)
    assert run(path) == 0
    assert (path.read_bytes()[:7] != b"BLENDER") == compressed


def test_permissions_of_a_replaced_file_stay(scene):
    """A file that only its owner may read is not opened to others."""
    scene.chmod(0o600)
    assert run(scene) == 0
    assert scene.stat().st_mode & 0o777 == 0o600


def test_a_link_to_a_scene_stays_a_link(scene, tmp_path):
    """The file behind it is written."""
    link = tmp_path / "link.blend"
    link.symlink_to(scene)
    assert run(link) == 0
    assert link.is_symlink()
    assert FACE_LAYER in load(scene)["Floor"].data.attributes


def test_the_file_keeps_mode_scene_and_selection(tmp_path):
    """Saved in Edit Mode on its second scene, it opens there again, baked."""
    build()
    second = bpy.data.scenes.new("Second")
    bpy.context.window.scene = second
    ob = cube("Cube")
    second.obscurance.rays = 16
    select(ob)
    bpy.ops.object.mode_set(mode="EDIT")
    path = save(tmp_path / "scene.blend")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert run(path) == 0
    objects = load(path)
    assert bpy.context.scene.name == "Second"
    assert objects["Cube"].mode == "EDIT"
    assert objects["Cube"].select_get()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert FACE_LAYER in objects["Cube"].data.attributes
    assert FACE_LAYER not in objects["Floor"].data.attributes


# ------------------------------------------------------------------------------------------------------------ options


def test_named_objects_only(scene):
    """The others occlude."""
    assert run(scene, "--objects", "Floor") == 0
    objects = load(scene)
    assert FACE_LAYER in objects["Floor"].data.attributes
    assert FACE_LAYER not in objects["Wall"].data.attributes
    assert colors(objects["Floor"])[0, 1] < 0.95


def test_options_win_over_the_settings_of_the_file(scene, tmp_path):
    """Each option shows up in the report's settings and the file keeps its own."""
    report = tmp_path / "report.json"
    arguments = "--target POINT --attribute Shade --rays 8 --distance 0.5 --falloff LINEAR --no-bleeding --scale PAPER"
    arguments += " --sampler RANDOM --seed 3 --threads 2 --shared-meshes AVERAGE"
    arguments += " --quantity AMBIENT --ambient EMISSION --reflectors 7 --indirect-only --exposure -2"
    arguments += " --size 512 --texels-per-metre 20 --uv-mode KEEP --unwrapper XATLAS --uv-map Own"
    arguments += " --margin 4 --no-adaptive --error-bound 0.25 --image a.png --image-format PNG_8 --modifiers RENDER"
    assert run(scene, *arguments.split(), "--report", report) == 0
    settings = json.loads(report.read_text())["files"][0]["settings"]
    assert settings == {
        "target": "POINT",
        "attribute_name": "Shade",
        "rays": 8,
        "ray_budget": None,
        "distance": 0.5,
        "falloff": "LINEAR",
        "use_bleeding": False,
        "scale": "PAPER",
        "sampler": "RANDOM",
        "seed": 3,
        "threads": 2,
        "shared_meshes": "AVERAGE",
        "corner_copy": True,
        "quantity": "AMBIENT",
        "ambient": "EMISSION",
        "reflectors": 7,
        "indirect_only": True,
        "exposure": -2.0,
        "lightmap_size": 512,
        "texels_per_metre": 20.0,
        "uv_mode": "KEEP",
        "unwrapper": "XATLAS",
        "uv_map": "Own",
        "margin": 4,
        "adaptive": False,
        "error_bound": 0.25,
        "image_path": "a.png",
        "image_format": "PNG_8",
        "modifiers": "RENDER",
    }
    attribute = load(scene)["Floor"].data.attributes["Shade"]
    assert (attribute.data_type, attribute.domain) == ("FLOAT_COLOR", "POINT")
    assert bpy.context.scene.obscurance.rays == 16
    assert bpy.context.scene.obscurance.attribute_name == "Obscurance"


def test_the_files_own_settings_count_without_options(tmp_path):
    """Saved in the scene, used by the command line."""
    build()
    group = bpy.context.scene.obscurance
    group.rays, group.target, group.attribute_name = 4, "CORNER", "Mine"
    group.distance_mode, group.distance = "METRES", 0.25
    scene, report = save(tmp_path / "scene.blend"), tmp_path / "report.json"
    assert run(scene, "--report", report) == 0
    settings = json.loads(report.read_text())["files"][0]["settings"]
    assert (settings["rays"], settings["target"], settings["distance"]) == (4, "CORNER", 0.25)
    assert load(scene)["Floor"].data.attributes["Mine"].domain == "CORNER"
    assert run(scene, "--distance", "auto", "--report", report) == 0
    assert json.loads(report.read_text())["files"][0]["settings"]["distance"] == pytest.approx(0.2 * 21**0.5)


def test_without_corner_copy(scene):
    """The face attribute only."""
    assert run(scene, "--no-corner-copy") == 0
    assert CORNER_LAYER not in load(scene)["Floor"].data.attributes


def test_a_ray_budget_is_shared_out_by_area(scene, tmp_path):
    """Five patches of 2, 2, 2, 2 and 4 m2 share 192 rays in powers of two: 32 each and 64 for the wall, twice."""
    report = tmp_path / "report.json"
    assert run(scene, "--ray-budget", 192, "--report", report) == 0
    entry = json.loads(report.read_text())["files"][0]
    assert entry["rays"] == 2 * (4 * 32 + 64)


def test_operator_job_and_command_line_agree(scene):
    """Bit for bit, with the same settings."""
    load(scene)
    objects = [bpy.data.objects[name] for name in ("Floor", "Wall")]
    select(*objects)
    bpy.ops.obscurance.bake()
    operator = {ob.name: colors(ob) for ob in objects}
    found = load(scene)
    objects = [found[name] for name in ("Floor", "Wall")]
    group = bpy.context.scene.obscurance
    BakeJob(bpy.context, objects, group.to_settings(), group.to_output()).run()
    job = {ob.name: colors(ob) for ob in objects}
    done = command("bake", scene, "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    objects = load(scene)
    for name in ("Floor", "Wall"):
        assert np.array_equal(operator[name], job[name])
        assert np.array_equal(colors(objects[name]), job[name])


# ------------------------------------------------------------------------------------------------------------- report


def test_the_report_tells_what_was_done(scene, tmp_path):
    """Version, and for each file what was baked, by how much work, and how well."""
    report, out = tmp_path / "report.json", tmp_path / "out.blend"
    load(scene)["Wall"].hide_render = True
    save(scene)
    assert run(scene, "--output", out, "--report", report) == 0
    told = json.loads(report.read_text())
    assert told["version"] == version()
    assert told["blender"] == bpy.app.version_string
    assert told["peak_memory_bytes"] > 1 << 20
    assert told["seconds"] > 0.0
    (entry,) = told["files"]
    assert (entry["scene"], entry["output"]) == (str(scene), str(out))
    assert entry["objects"] == ["Floor"]
    assert (entry["patches"], entry["triangles"], entry["rays"]) == (4, 8, 2 * 4 * 16)
    assert {"load", "extract", "build", "trace", "write"} <= set(entry["seconds"])
    assert all(seconds >= 0.0 for seconds in entry["seconds"].values())
    assert sum(entry["seconds"].values()) <= told["seconds"]
    assert entry["mrays_per_second"] == pytest.approx(entry["rays"] / entry["seconds"]["trace"] / 1e6)
    assert entry["r_ave"] == pytest.approx([0.8] * 3)
    assert entry["rmse"] == pytest.approx([0.0] * 3, abs=1e-6)
    assert entry["peak_memory_bytes"] > 1 << 20
    assert any("'Wall'" in warning for warning in entry["warnings"])


def strict(text):
    """JSON as the standard has it, without Infinity and NaN."""

    def refuse(name):
        raise ValueError(name)

    return json.loads(text, parse_constant=refuse)


def test_the_report_is_json_for_an_endless_reach_too(scene, tmp_path):
    """JSON knows no infinity."""
    report = tmp_path / "report.json"
    assert run(scene, "--distance", "inf", "--report", report) == 0
    assert strict(report.read_text())["files"][0]["settings"]["distance"] == "inf"


@pytest.mark.parametrize("name", ["missing/report.json", "folder"])
def test_a_report_that_cannot_be_written_fails_before_anything_is_baked(scene, tmp_path, capsys, name):
    """Nobody waits for a bake whose report is lost; the message names the path."""
    (tmp_path / "folder").mkdir()
    before = scene.read_bytes()
    assert run(scene, "--report", tmp_path / name) == 1
    assert str(tmp_path / name) in capsys.readouterr().err
    assert scene.read_bytes() == before


@pytest.mark.parametrize("output", [[], ["--output", "out.blend"]])
def test_the_report_never_takes_the_place_of_a_scene(scene, tmp_path, monkeypatch, output):
    """Naming the scene, or what is written, as the report is wrong usage."""
    monkeypatch.chdir(tmp_path)
    before = scene.read_bytes()
    with pytest.raises(SystemExit) as stop:
        run(scene, *output, "--report", output[-1] if output else scene)
    assert stop.value.code == 2
    assert scene.read_bytes() == before


def test_rays_given_replace_a_budget_of_the_file(scene, tmp_path):
    """A budget saved in the file does not silently win over --rays."""
    load(scene)
    bpy.context.scene.obscurance.ray_budget = 64
    save(scene)
    report = tmp_path / "report.json"
    assert run(scene, "--rays", "32", "--report", report) == 0
    (entry,) = json.loads(report.read_text())["files"]
    assert (entry["settings"]["rays"], entry["settings"]["ray_budget"]) == (32, None)
    assert entry["rays"] == 2 * 32 * entry["patches"]


def test_metres_are_metres_at_any_unit_scale(scene, tmp_path):
    """In a scene of centimetres, a reach of 0.02 m is two units, and the report says metres again."""
    report = tmp_path / "report.json"
    assert run(scene, "--distance", "2", "--output", tmp_path / "metres.blend") == 0
    expected = colors(load(tmp_path / "metres.blend")["Floor"])
    load(scene)
    bpy.context.scene.unit_settings.scale_length = 0.01
    save(scene)
    assert run(scene, "--distance", "0.02", "--report", report) == 0
    assert json.loads(report.read_text())["files"][0]["settings"]["distance"] == pytest.approx(0.02)
    np.testing.assert_array_equal(colors(load(scene)["Floor"]), expected)


# ----------------------------------------------------------------------------------------------------------- terminal


def test_quiet_prints_nothing_of_its_own(scene, capsys):
    """Without it, one line tells what was baked where, and one for each note."""
    load(scene)["Wall"].hide_render = True
    save(scene)
    capsys.readouterr()
    assert run(scene) == 0
    told = capsys.readouterr()
    assert f"{scene} -> {scene}: Baked 4 patches of 'Floor'" in told.out
    assert "note: hidden from renders, so they do not occlude: 'Wall'" in told.out
    assert run(scene, "--quiet") == 0
    told = capsys.readouterr()
    assert "patches" not in told.out
    assert "note:" not in told.out
    assert told.err == ""


def test_the_process_says_its_version_and_help_without_blender():
    """At once, with status 0."""
    told = command("--version", env=os.environ | {"PYTHONPATH": ""})
    assert (told.returncode, told.stdout.strip()) == (0, version())
    assert command("bake", "--help").returncode == 0


# ----------------------------------------------------------------------------------------------------------- failures


def uv_named_like_the_result(path):
    build()
    bpy.data.objects["Floor"].data.uv_layers.new(name=FACE_LAYER)
    return save(path), ["'Floor'", "UV map", "choose another attribute name"]


def nothing_in_it(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return save(path), ["nothing to bake"]


def zero_distance(path):
    build()
    bpy.context.scene.obscurance.distance_mode = "METRES"
    bpy.context.scene.obscurance.distance = 0.0
    return save(path), ["distance is 0 m", "above 0"]


def not_a_blend(path):
    path.write_bytes(b"this is no scene at all, but longer than a header")
    return path, []


def cut_short(path):
    build()
    save(path)
    path.write_bytes(path.read_bytes()[:100])
    return path, []


def absent(path):
    return path, ["no such file", "check the path"]


def a_folder(path):
    path.mkdir()
    return path, ["is a folder", "name a .blend"]


@pytest.mark.parametrize(
    "make", [uv_named_like_the_result, nothing_in_it, zero_distance, not_a_blend, cut_short, absent, a_folder]
)
def test_a_file_that_fails_does_not_stop_the_others(scene, tmp_path, make, capsys):
    """Status 1; the error names the file and what is wrong; the file is as it was; the others are baked."""
    bad, words = make(tmp_path / "bad.blend")
    kept = bad.read_bytes() if bad.is_file() else None
    report = tmp_path / "report.json"
    capsys.readouterr()
    assert run(bad, scene, "--report", report) == 1
    told = capsys.readouterr().err
    assert f"obscurance: error: {bad}: " in told
    assert all(word in told for word in words), told
    entries = json.loads(report.read_text())["files"]
    assert "error" in entries[0]
    assert all(word in entries[0]["error"] for word in words)
    assert "error" not in entries[1]
    assert (bad.read_bytes() if bad.is_file() else None) == kept
    assert FACE_LAYER in load(scene)["Floor"].data.attributes


def test_an_unexpected_error_in_one_file_does_not_stop_the_others(scene, tmp_path, monkeypatch, capsys):
    """Out of memory, say: the next file may be smaller."""
    from obscurance_addon.core.order import bake_order

    other = tmp_path / "other.blend"
    other.write_bytes(scene.read_bytes())
    bake, calls = bake_order.bake_obscurances, []

    def fails_once(*arguments, **keywords):
        calls.append(1)
        if len(calls) == 1:
            raise MemoryError("Unable to allocate 90 GiB")
        return bake(*arguments, **keywords)

    monkeypatch.setattr(bake_order, "bake_obscurances", fails_once)
    assert run(scene, other) == 1
    assert f"{scene}: " in capsys.readouterr().err
    assert FACE_LAYER not in load(scene)["Floor"].data.attributes
    assert FACE_LAYER in load(other)["Floor"].data.attributes


def test_objects_that_are_not_there_are_named(scene, tmp_path, capsys):
    """With the option to check, and those that are there; the file is not written."""
    before = folder_state(tmp_path)
    assert run(scene, "--objects", "Floor", "Roof") == 1
    told = capsys.readouterr().err
    assert "no object named 'Roof'" in told
    assert "--objects" in told
    assert "there are 'Floor', 'Wall'" in told
    assert folder_state(tmp_path) == before


def test_a_folder_that_is_not_there_is_named(scene, tmp_path, capsys):
    """Before the bake begins."""
    assert run(scene, "--output", tmp_path / "missing" / "out.blend") == 1
    assert f"'{tmp_path / 'missing'}' does not exist: create it first" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--distance", "0"], "give a distance above 0"),
        (["--distance", "-1"], "give a distance above 0"),
        (["--distance", "nan"], "give a distance above 0"),
        (["--distance", "far"], "neither a number of metres nor 'auto'"),
        (["--rays", "0"], "rays per patch is 0"),
        (["--rays", "many"], "invalid int value"),
        (["--seed", "-1"], "seed is -1"),
        (["--threads", "5000"], "threads is 5000"),
        (["--falloff", "CUBIC"], "SQRT"),
        (["--scale", "GREY"], "WHITE"),
        (["--target", "EDGE"], "CORNER"),
        (["--sampler", "HALTON"], "SOBOL"),
        (["--what"], "unrecognized"),
        (["--output", "a.blend", "--output-dir", "."], "not allowed with"),
        (["other.blend", "--output", "out.blend"], "--output-dir for several"),
        (["deep/scene.blend", "--output-dir", "."], "same file name"),
    ],
)
def test_wrong_usage_is_status_2_and_says_what_is_right(scene, capsys, arguments, words):
    """Before any file is touched."""
    before = scene.read_bytes()
    assert words in usage_error(capsys, scene, *arguments)
    assert scene.read_bytes() == before


def test_exit_statuses_of_the_process(scene, tmp_path):
    """0, 1 and 2, as a shell sees them, with the error on stderr."""
    assert command("bake", scene, "--output", tmp_path / "out.blend").returncode == 0
    failed = command("bake", tmp_path / "absent.blend")
    assert failed.returncode == 1
    assert "absent.blend: no such file" in failed.stderr
    wrong = command("bake", scene, "--rays", "0")
    assert wrong.returncode == 2
    assert "rays per patch is 0" in wrong.stderr
    assert command().returncode == 2


# -------------------------------------------------------------------------------------------------------------- light


def lit(path):
    """The scene with a lamp."""
    build()
    light = bpy.data.lights.new("Lamp", "POINT")
    light.energy = 50.0
    lamp = bpy.data.objects.new("Lamp", light)
    lamp.location = (1.0, 2.0, 1.0)
    bpy.context.scene.collection.objects.link(lamp)
    return save(path / "lit.blend")


@pytest.mark.parametrize(
    "options",
    [
        ("AMBIENT",),
        ("AMBIENT", "--ambient", "EMISSION", "--no-bleeding"),
        ("AMBIENT", "--reflectors", "4"),
        ("DIRECT",),
        ("COMBINED", "--reflectors", "auto"),
        ("RADIOSITY",),
        ("RADIOSITY", "--indirect-only"),
    ],
)
def test_light_from_the_command_line(tmp_path, options):
    """Each quantity arrives, and the report says the ambient light per channel and the reflectors."""
    out, report = tmp_path / "out.blend", tmp_path / "report.json"
    assert run(lit(tmp_path), "--quantity", *options, "--output", out, "--report", report) == 0
    (entry,) = json.loads(report.read_text())["files"]
    found = colors(load(out)["Floor"])
    assert np.isfinite(found).all()
    assert found.max() > 0.0
    assert entry["settings"]["quantity"] == options[0]
    if options[0] in ("AMBIENT", "COMBINED"):
        assert len(entry["ambient_light"]) == 3
        assert all(x > 0.0 for x in entry["ambient_light"])
        assert 0.0 < entry["openness"] < 1.0
    else:
        assert entry["ambient_light"] is None
    assert entry["reflectors"] == 4 or "4" not in options


def test_quantities_fit_together(tmp_path):
    """COMBINED is DIRECT plus AMBIENT; radiosity less its indirect part is DIRECT."""
    scene, found = lit(tmp_path), {}
    for name, options in {
        "DIRECT": (),
        "AMBIENT": (),
        "COMBINED": (),
        "RADIOSITY": (),
        "INDIRECT": ("--indirect-only",),
    }.items():
        out = tmp_path / f"{name}.blend"
        quantity = "RADIOSITY" if name == "INDIRECT" else name
        assert run(scene, "--quantity", quantity, *options, "--output", out) == 0
        found[name] = colors(load(out)["Floor"])
    np.testing.assert_allclose(found["COMBINED"], found["DIRECT"] + found["AMBIENT"], rtol=1e-5)
    np.testing.assert_allclose(found["RADIOSITY"] - found["INDIRECT"], found["DIRECT"], rtol=1e-4)


@pytest.mark.parametrize("bad", ["few", "-1", "5000", "1.5"])
def test_reflectors_that_make_no_sense(scene, capsys, bad):
    assert "reflectors" in usage_error(capsys, scene, "--reflectors", bad)


def test_radiosity_of_too_many_rays_is_refused_with_the_cure(tmp_path, capsys):
    """Nothing is written, the exit status is 1."""
    out = tmp_path / "out.blend"
    build()
    cube("Cube")  # six faces more: 11 of 2^24 rays
    options = ("--quantity", "RADIOSITY", "--rays", str(1 << 24), "--output", out)
    assert run(save(tmp_path / "large.blend"), *options) == 1
    assert not out.exists()
    assert "use fewer rays per patch" in capsys.readouterr().err
