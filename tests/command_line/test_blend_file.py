"""Files that Blender opens or saves with a report, files of a newer Blender, and files that carry Python."""

import struct

import bpy
import pytest

from obscurance_addon.command_line import batch
from obscurance_addon.command_line.blend_file import _handled
from obscurance_addon.core.files import CHECKS, NotWholeError
from tests.blender.helpers import FACE_LAYER, cube, floor

pytestmark = pytest.mark.usefixtures("empty_scene")


def save(path, **options):
    bpy.context.scene.obscurance.rays = 4
    bpy.ops.wm.save_as_mainfile(filepath=str(path), **options)
    return path


def run(*arguments):
    return batch.main(["bake", *map(str, arguments)])


def is_baked(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return FACE_LAYER in bpy.data.objects["Floor"].data.attributes


def made_newer(path):
    """Let a file say that the next version of Blender saved it."""
    data = bytearray(path.read_bytes())
    at, digits = (13, 4) if data[7:9].isdigit() else (9, 3)
    data[at : at + digits] = b"%0*d" % (digits, int(data[at : at + digits]) + 1)
    path.write_bytes(data)
    return path


def test_a_file_of_a_newer_blender_is_not_saved_over(tmp_path, capsys):
    """Nor by the name of the output, or through a link; another output is noted."""
    floor("Floor")
    scene = made_newer(save(tmp_path / "scene.blend", compress=False))
    before = scene.read_bytes()
    (tmp_path / "link.blend").symlink_to(scene)
    for arguments in ((scene,), (scene, "--output", tmp_path / "link.blend")):
        assert run(*arguments) == 1
        told = capsys.readouterr().err
        assert "was saved by Blender" in told
        assert "another file with --output" in told
        assert scene.read_bytes() == before
    assert run(scene, "--output", tmp_path / "out.blend") == 0
    assert "note: the scene was saved by Blender" in capsys.readouterr().out
    assert scene.read_bytes() == before
    assert is_baked(tmp_path / "out.blend")


def with_strip(path, channel):
    """A file with a video strip in a channel, as bytes."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    floor("Floor")
    editor = bpy.context.scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    new = strips.new_effect
    length = (
        "length"
        if "length" in {p.identifier for p in strips.bl_rna.functions["new_effect"].parameters}
        else "frame_end"
    )
    new(name="S", type="COLOR", channel=channel, frame_start=1, **{length: 10})
    return bytearray(save(path, compress=False).read_bytes())


def test_a_file_that_opens_with_a_report_is_baked(tmp_path, capsys):
    """Here a video strip is in a channel that Blender has no more."""
    scene = tmp_path / "scene.blend"
    one, other = with_strip(scene, 100), with_strip(scene, 101)
    places = [
        i
        for i in range(min(len(one), len(other)) - 4)
        if one[i] != other[i]
        and (struct.unpack_from("<i", one, i), struct.unpack_from("<i", other, i)) == ((100,), (101,))
    ]
    assert places
    for place in places:
        struct.pack_into("<i", other, place, 200)
    scene.write_bytes(other)
    assert run(scene) == 0
    assert "note: Blender opened the file and reported: 1 " in capsys.readouterr().out
    assert is_baked(scene)


def test_a_file_that_is_saved_with_a_report_is_kept(tmp_path, capsys):
    """Automatic packing is on, and a texture is missing."""
    floor("Floor")
    image = bpy.data.images.new("Gone", 4, 4)
    image.source, image.filepath, image.use_fake_user = "FILE", "//gone/texture.jpg", True
    with pytest.raises(RuntimeError, match=r"texture\.jpg"):
        bpy.ops.file.autopack_toggle()
    with pytest.raises(RuntimeError, match=r"texture\.jpg"):
        save(tmp_path / "scene.blend")
    assert run(tmp_path / "scene.blend") == 0
    assert "note: Blender saved the file and reported: Unable to pack file" in capsys.readouterr().out
    with pytest.raises(RuntimeError, match=r"texture\.jpg"):
        bpy.ops.wm.save_mainfile()
    assert is_baked(tmp_path / "scene.blend")


@pytest.mark.parametrize("options", [(), ("--frames", "1-2"), ("--target", "LIGHTMAP", "--size", "256")])
def test_python_in_a_file_is_not_run(tmp_path, options):
    """Not by drivers of objects and nodes, not by registered texts and the handlers that they would make."""
    marks = tmp_path / "marks"
    marks.mkdir()
    ob = floor("Floor")
    write = f"(open({str(marks)!r} + '/%s', 'w').write('x'), 0.5)[1]"
    driven = ob.driver_add("location", 0).driver
    driven.type, driven.expression = "SCRIPTED", write % "driver"
    material = bpy.data.materials.new("M")
    material.use_nodes = True
    ob.data.materials.append(material)
    roughness = material.node_tree.nodes["Principled BSDF"].inputs["Roughness"]
    roughness.driver_add("default_value").driver.expression = write % "node"
    text = bpy.data.texts.new("register.py")
    text.from_string(
        f"import bpy\n{write % 'text'}\nbpy.app.handlers.frame_change_pre.append("
        f"bpy.app.handlers.persistent(lambda *_: {write % 'handler'}))\n"
    )
    text.use_module = True
    scene = save(tmp_path / "scene.blend")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for mark in marks.iterdir():
        mark.unlink()
    preferences = bpy.context.preferences.filepaths
    preferences.use_scripts_auto_execute = True  # as a user may have allowed for files of his own
    try:
        assert run(scene, "--output", tmp_path / "out.blend", *options) == 0
    finally:
        preferences.use_scripts_auto_execute = False
    assert [mark.name for mark in marks.iterdir()] == []


def test_a_fluid_writes_no_cache_where_the_file_says(tmp_path, capsys):
    """It is left out, with a note, and is there in the output."""
    if not bpy.app.build_options.fluid:
        pytest.skip("this Blender has no fluids")
    floor("Floor")
    modifier = cube("Tank").modifiers.new("Fluid", "FLUID")
    modifier.show_viewport = False
    modifier.fluid_type = "DOMAIN"
    assert modifier.domain_settings.cache_type == "REPLAY"
    modifier.domain_settings.cache_directory = str(tmp_path / "cache")
    scene, out, shown = save(tmp_path / "scene.blend"), tmp_path / "out.blend", []

    def show(*_arguments):
        bpy.data.objects["Tank"].modifiers["Fluid"].show_viewport = True

    def hide(*_arguments):
        shown.append(bpy.data.objects["Tank"].modifiers["Fluid"].show_viewport)
        bpy.data.objects["Tank"].modifiers["Fluid"].show_viewport = False

    with _handled(bpy.app.handlers.save_pre, show), _handled(bpy.app.handlers.save_post, hide):
        save(scene)  # never evaluated with the fluid, which would make the folder
    assert run(scene, "--frames", "1-2", "--output", out) == 0
    assert "note: object 'Tank' has a fluid of cache type Replay" in capsys.readouterr().out
    with _handled(bpy.app.handlers.load_post, hide):
        bpy.ops.wm.open_mainfile(filepath=str(out))
    assert shown == [True, True]
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("name", ["plain.blend", "packed.blend", "text.usda", "binary.usdc", "ogawa.abc"])
def test_a_file_that_was_cut_is_known(tmp_path, name):
    """Wherever it was cut, but for the empty lines at the end of a text."""
    floor("Floor", n=3)
    path = tmp_path / name
    if path.suffix == ".blend":
        save(path, copy=True, compress=name.startswith("packed"))
    elif path.suffix == ".abc":
        bpy.ops.wm.alembic_export(filepath=str(path), as_background_job=False)
    else:
        bpy.ops.wm.usd_export(filepath=str(path))
    check, whole = CHECKS[path.suffix], path.read_bytes()
    check(path)
    needed = len(whole.rstrip(b"\n")) if path.suffix == ".usda" else len(whole)
    cuts = {*range(40), *range(needed - 40, needed), *range(0, needed, max(1, needed // 50))}
    for size in cuts & set(range(needed)):
        path.write_bytes(whole[:size])
        with pytest.raises(NotWholeError):
            check(path)
