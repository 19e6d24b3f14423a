"""Images that a lightmap bake makes: what is in them and in their files, and what they leave alone."""

import os
import signal
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.marks import MADE_HERE
from obscurance_addon.blender.writing import image as lightmap_image
from obscurance_addon.blender.writing import image_formats
from obscurance_addon.blender.writing.image import stage
from obscurance_addon.blender.writing.image_files import ImageFileError, check_path
from obscurance_addon.core.order.output import ImageFormat
from obscurance_addon.core.shading.arithmetic import srgb_to_linear
from tests.blender.helpers import file_state

pytestmark = pytest.mark.usefixtures("empty_scene")
ROOT = Path(__file__).parents[3]

SIZE = 32
EXR, PNG = [ImageFormat.EXR_HALF, ImageFormat.EXR_FULL], [ImageFormat.PNG_8, ImageFormat.PNG_16]
HALF, FLOAT = 1, 2  # types of channels in EXR files
ZIP = 3
SRGB_SLOPE = 2.4 / 1.055  # the steepest part of the curve, at 1
PNG_8_STEP, PNG_16_STEP = SRGB_SLOPE / 255, SRGB_SLOPE / 65535
BLENDERS_CURVE = 2.6e-5  # by which Blender's sRGB curve is off when it reads 16 bits


def page(seed=0, size=SIZE, high=3.0):
    """A page whose values differ everywhere, some above 1, opaque."""
    made = np.random.default_rng(seed).uniform(0.0, high, (size, size, 4)).astype(np.float32)
    made[..., 3] = 1.0
    return made


def land(pages, name="Lightmap", path="", image_format=ImageFormat.EXR_HALF):
    return stage(pages, name, path, image_format).land()


def linear(image):
    """Linear pixels (height, width, 4) of an image's first tile, as a render sees them."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, 4)
    if not image.is_float:
        pixels[..., :3] = srgb_to_linear(pixels[..., :3])
    return pixels


def loaded(path, like):
    """Linear pixels of a file, with the settings of another image."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name, image.alpha_mode = like.colorspace_settings.name, like.alpha_mode
    pixels = linear(image)
    bpy.data.images.remove(image)
    return pixels


def tile_values(image, folder):
    """Mean red of each tile, of packed ones too."""
    means = {}
    for tile in image.tiles:
        path = Path(bpy.path.abspath(image.filepath_raw).replace("<UDIM>", str(tile.number)))
        for packed in image.packed_files:
            if packed.tile_number == tile.number:
                path = folder / f"unpacked.{tile.number}{path.suffix}"
                path.write_bytes(packed.packed_file.data)
        means[tile.number] = loaded(path, image)[..., 0].mean()
    return means


def flat(*levels, size=SIZE):
    """Pages of one colour each."""
    return [np.full((size, size, 4), [level, level, level, 1.0], np.float32) for level in levels]


def check_values(found, expected, image_format):
    """Make sure that the format's precision is kept."""
    error = np.abs(found - expected)
    if image_format is ImageFormat.EXR_FULL:
        np.testing.assert_array_equal(found, expected)
    elif image_format is ImageFormat.EXR_HALF:
        np.testing.assert_array_equal(found, expected.astype(np.float16))
    elif image_format is ImageFormat.HDR:
        largest = np.maximum(expected[..., :3].max(-1, keepdims=True), 1e-30)
        assert (error[..., :3] / largest).max() <= 1 / 256 + 1e-6  # half a step of mantissas that go from 128 to 255
        np.testing.assert_array_equal(found[..., 3], 1.0)
    else:
        half = 0.5 * (PNG_8_STEP if image_format is ImageFormat.PNG_8 else PNG_16_STEP) + BLENDERS_CURVE
        assert np.abs(found - np.clip(expected, 0.0, 1.0)).max() <= half


def exr_header(data):
    """Attributes of an OpenEXR file by name, and the channels' types."""
    assert data[:4] == b"\x76\x2f\x31\x01"
    found, channels, at = {}, {}, 8
    while data[at]:
        name, kind, rest = data[at:].split(b"\0", 2)
        at += len(name) + len(kind) + 2
        length = struct.unpack("<i", rest[:4])[0]
        found[name.decode()] = rest[4 : 4 + length]
        at += 4 + length
    listed = found["channels"]
    while listed[0]:
        name, rest = listed.split(b"\0", 1)
        channels[name.decode()] = struct.unpack("<i", rest[:4])[0]
        listed = rest[16:]
    return found, channels


def check_header(data, image_format, alpha=False):
    """Make sure that a file is what its format says."""
    if image_format in EXR:
        found, channels = exr_header(data)
        assert found["compression"][0] == ZIP
        assert set(channels) == set("RGBA" if alpha else "RGB")
        assert set(channels.values()) == {FLOAT if image_format is ImageFormat.EXR_FULL else HALF}
    elif image_format in PNG:
        assert data[12:16] == b"IHDR"
        assert data[24:26] == bytes([16 if image_format is ImageFormat.PNG_16 else 8, 6 if alpha else 2])
        assert data.endswith(b"IEND\xae\x42\x60\x82")
    else:
        assert data.startswith(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n")


def save(path, **options):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False, **options)


def reopened(path, name="Lightmap"):
    """The image after saving and loading the .blend."""
    save(path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.images[name]


def image_state(image):
    """All that a user could miss of an image."""
    properties = (p.identifier for p in image.bl_rna.properties if p.type in {"BOOLEAN", "INT", "STRING", "ENUM"})
    volatile = {"is_dirty", "has_data", "bindcode", "users", "session_uid", "tag", "is_evaluated"}
    return {
        "settings": {name: str(getattr(image, name)) for name in properties if name not in volatile},
        "space": image.colorspace_settings.name,
        "tiles": [tile.number for tile in image.tiles],
        "packed": [(packed.filepath, packed.packed_file.data) for packed in image.packed_files],
        "mark": image.get(MADE_HERE),
        "pixels": linear(image).tobytes(),
    }


def used_by_material(image):
    """An Image Texture node that shows the image."""
    material = bpy.data.materials.new("Material")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    return node


def names(folder):
    return sorted(path.name for path in folder.iterdir())


# ------------------------------------------------------------------------------------------------------ round trips


@pytest.mark.parametrize("image_format", ImageFormat)
def test_packed_image_survives_saving(image_format, tmp_path):
    pixels = page()
    image = land([pixels], image_format=image_format)
    check_values(linear(image), pixels, image_format)
    assert (image.name, image.source, tuple(image.size)) == ("Lightmap", "FILE", (SIZE, SIZE))
    again = reopened(tmp_path / "scene.blend")
    check_values(linear(again), pixels, image_format)
    check_header(again.packed_file.data, image_format)
    assert again.colorspace_settings.name == ("sRGB" if image_format in PNG else "Linear Rec.709")
    assert again.filepath_raw == "//Lightmap" + image_format.extension
    assert names(tmp_path) == ["scene.blend"]


@pytest.mark.parametrize("image_format", ImageFormat)
def test_file_holds_the_pixels(image_format, tmp_path):
    pixels = page()
    image = land([pixels], path=str(tmp_path / "map"), image_format=image_format)
    file = tmp_path / ("map" + image_format.extension)
    assert names(tmp_path) == [file.name]
    check_header(file.read_bytes(), image_format)
    check_values(loaded(file, image), pixels, image_format)
    check_values(linear(image), pixels, image_format)
    again = reopened(tmp_path / "scene.blend")
    assert not again.packed_files
    check_values(linear(again), pixels, image_format)


@pytest.mark.parametrize("image_format", ImageFormat)
def test_pixels_of_a_page_larger_than_a_block(image_format, tmp_path, monkeypatch):
    monkeypatch.setattr(image_formats, "BLOCK_TEXELS", 1000)
    pixels = page(size=200)  # in HDR one full run of 128 bytes and a shorter one
    check_values(linear(land([pixels], image_format=image_format)), pixels, image_format)


@pytest.mark.parametrize("width", [1, 7, 8, 128, 256, 300])
def test_hdr_of_any_width(width, tmp_path):
    pixels = page(size=width)
    check_values(linear(land([pixels], image_format=ImageFormat.HDR)), pixels, ImageFormat.HDR)


def test_hdr_of_any_brightness():
    pixels = page(high=1.0) * np.logspace(-25, 25, SIZE, dtype=np.float32)[:, None, None]
    pixels[0, 0, :3], pixels[0, 1, :3], pixels[0, 2, :3] = 0.0, -1.0, 255.9
    pixels[..., 3] = 1.0
    found = linear(land([pixels], image_format=ImageFormat.HDR))
    check_values(found, np.maximum(pixels, 0.0), ImageFormat.HDR)


def png_codes(data):
    """Whole numbers (height, width, channels) in an opaque PNG file, the bottom row first."""
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        content = data[at + 8 : at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0] == zlib.crc32(kind + content)
        if kind == b"IHDR":
            width, height, bits = struct.unpack(">IIB", content[:9])
        packed += content if kind == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, -1)
    assert (rows[:, 0] == 2).all()  # each row was stored as its difference to the one above
    rows = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8)
    return rows.view(">u2" if bits == 16 else "u1").reshape(height, width, 3)[::-1]


@pytest.mark.parametrize("image_format", PNG)
@pytest.mark.parametrize("block", [1 << 20, 100])
def test_png_clamps_and_rounds_to_nearest(block, image_format, monkeypatch):
    monkeypatch.setattr(image_formats, "BLOCK_TEXELS", block)
    pixels = page(high=1.0)
    pixels[0, :4, :3] = np.array([-1.0, 7.0, np.inf, np.nan])[:, None]
    codes = png_codes(land([pixels], image_format=image_format).packed_file.data)
    pixels[0, :4, :3] = np.array([0.0, 1.0, 1.0, 0.0])[:, None]
    top = 65535 if image_format is ImageFormat.PNG_16 else 255
    exact = pixels[..., :3].astype(np.float64)
    exact = np.where(exact <= 0.0031308, 12.92 * exact, 1.055 * np.maximum(exact, 0.0) ** (1 / 2.4) - 0.055) * top
    assert np.abs(codes - exact).max() < 0.51


@pytest.mark.parametrize("image_format", EXR + PNG)
def test_coverage_does_not_change_the_colour(image_format, tmp_path):
    pixels = page(high=1.0)
    pixels[..., 3] = np.linspace(0.0, 1.0, SIZE, dtype=np.float32)
    image = land([pixels], path=str(tmp_path / "map"), image_format=image_format)
    check_header((tmp_path / ("map" + image_format.extension)).read_bytes(), image_format, alpha=True)
    check_values(linear(image), pixels, image_format)
    assert image.alpha_mode == "CHANNEL_PACKED"


def test_bottom_row_comes_first():
    pixels = flat(0.0)[0]
    pixels[0, :, :3] = 1.0
    for image_format in ImageFormat:
        found = linear(land([pixels], image_format=image_format))
        assert found[0, :, 0].min() == pytest.approx(1.0, abs=BLENDERS_CURVE)
        assert found[1:, :, 0].max() == 0.0


# ------------------------------------------------------------------------------------------------------------- tiles


@pytest.mark.parametrize("image_format", ImageFormat)
@pytest.mark.parametrize("packed", [True, False])
def test_pages_become_tiles(packed, image_format, tmp_path):
    levels = [0.125, 0.5, 1.0]
    path = "" if packed else str(tmp_path / "map")
    image = land(flat(*levels), path=path, image_format=image_format)
    assert image.source == "TILED"
    end = image_format.extension
    assert names(tmp_path) == ([] if packed else [f"map.{tile}{end}" for tile in (1001, 1002, 1003)])
    again = reopened(tmp_path / "scene.blend")
    assert tile_values(again, tmp_path) == pytest.approx(dict(zip((1001, 1002, 1003), levels, strict=True)), abs=4e-3)
    assert len(again.packed_files) == (3 if packed else 0)
    if packed:
        assert again.filepath_raw == f"//Lightmap.<UDIM>{end}"
        assert [file.filepath for file in again.packed_files] == [f"//Lightmap.{1001 + i}{end}" for i in range(3)]


@pytest.mark.parametrize("packed", [True, False])
def test_cycles_renders_all_tiles(packed, tmp_path):
    """An emitting strip over two tiles, after the .blend was saved and loaded."""
    image = land(flat(0.25, 3.0), path="" if packed else str(tmp_path / "map"))
    node = used_by_material(image)
    nodes, links = node.id_data.nodes, node.id_data.links
    emission = nodes.new("ShaderNodeEmission")
    links.new(node.outputs["Color"], emission.inputs["Color"])
    links.new(emission.outputs[0], nodes.get("Material Output").inputs["Surface"])
    mesh = bpy.data.meshes.new("Strip")
    mesh.from_pydata([(-1, -0.5, 0), (1, -0.5, 0), (1, 0.5, 0), (-1, 0.5, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().uv.foreach_set("vector", np.array([0, 0, 2, 0, 2, 1, 0, 1], np.float32))
    mesh.materials.append(bpy.data.materials["Material"])
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    scene = bpy.context.scene
    for data in (mesh, camera):
        scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    scene.camera = bpy.data.objects["Camera"]
    scene.camera.location.z = 1.0
    reopened(tmp_path / "scene.blend")
    scene = bpy.context.scene
    render = scene.render
    render.engine, render.threads_mode, render.threads = "CYCLES", "FIXED", 1
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    render.resolution_x, render.resolution_y, render.resolution_percentage = 8, 4, 100
    render.image_settings.file_format, render.filepath = "OPEN_EXR", str(tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    seen = linear(bpy.data.images.load(render.filepath))
    np.testing.assert_allclose(seen[:, :3, :3], 0.25, rtol=1e-3)
    np.testing.assert_allclose(seen[:, 5:, :3], 3.0, rtol=1e-3)


def test_udim_in_the_path_names_the_tiles(tmp_path):
    image = land(flat(0.5), path=str(tmp_path / "<UDIM>_map.exr"))
    assert names(tmp_path) == ["1001_map.exr"]
    assert image.source == "TILED"


def test_pages_are_taken_one_at_a_time(tmp_path):
    asked = []

    def make(level):
        asked.append((level, [name for name in names(tmp_path) if name.endswith(".part.exr")]))
        return flat(level)[0]

    staged = stage([lambda: make(1.0), lambda: make(2.0)], "Lightmap", str(tmp_path / "map"), ImageFormat.EXR_FULL)
    assert [(level, len(parts)) for level, parts in asked] == [(1.0, 0), (2.0, 1)]
    assert tile_values(staged.land(), tmp_path) == {1001: 1.0, 1002: 2.0}


def test_fewer_pages_than_last_time(tmp_path):
    path = str(tmp_path / "map.exr")
    first = land(flat(1.0, 2.0, 3.0), path=path)
    again = land(flat(4.0, 5.0), path=path)
    assert again == first
    assert tile_values(again, tmp_path) == {1001: 4.0, 1002: 5.0}
    assert set(tile_values(reopened(tmp_path / "scene.blend"), tmp_path)) == {1001, 1002}


def test_too_many_pages():
    with pytest.raises(ImageFileError, match="1001 tiles"):
        stage([flat(1.0, size=1)[0]] * 1001, "Lightmap", "", ImageFormat.EXR_HALF)


# --------------------------------------------------------------------------------------------------------- the image


def test_image_is_updated_in_place(tmp_path):
    """Between all four kinds of image, so that each follows each."""
    kinds = [(number, path) for number in (1, 2) for path in ("", str(tmp_path / "map"))]
    image = land(flat(9.0))
    node, uid, users = used_by_material(image), image.session_uid, image.users
    for was in kinds:
        for number, path in kinds:
            land(flat(1.0, 2.0)[: was[0]], path=was[1], image_format=ImageFormat.PNG_8)
            levels = [3.0, 4.0][:number]
            again = land(flat(*levels, size=8), path=path)
            assert (again.session_uid, node.image, again.users) == (uid, image, users)
            assert tuple(again.size) == (8, 8)
            assert (again.source, len(again.packed_files)) == (
                "TILED" if number > 1 else "FILE",
                0 if path else number,
            )
            assert tile_values(again, tmp_path) == dict(zip(range(1001, 1003), levels, strict=False))
    assert len(bpy.data.images) == 1


def test_image_that_nothing_uses_is_saved(tmp_path):
    land(flat(2.0))
    assert linear(reopened(tmp_path / "scene.blend"))[0, 0, 0] == 2.0


def test_image_of_the_user_stays():
    own = bpy.data.images.new("Lightmap", 4, 4)
    own.pixels[0] = 0.25
    before = image_state(own)
    first = land(flat(1.0))
    second = land(flat(2.0))
    assert first == second != own
    assert first.name == "Lightmap.001"
    assert image_state(own) == before
    assert len(bpy.data.images) == 2


def test_renamed_image_of_an_earlier_bake_stays():
    kept = land(flat(1.0))
    kept.name = "To compare"
    made = land(flat(2.0))
    assert (kept.name, made.name) == ("To compare", "Lightmap")
    assert linear(kept)[0, 0, 0] == 1.0


def test_long_names_are_not_mixed_up():
    names = ["Ä" * 40 + end for end in ("a", "b")]
    first, second = (land(flat(level), name=name) for level, name in enumerate(names))
    assert first != second
    assert land(flat(5.0), name=names[1]) == second


def test_no_temporary_path_in_the_blend(tmp_path):
    for pages in (flat(1.0), flat(1.0, 2.0)):
        before = names(Path(bpy.app.tempdir))
        land(pages, name=f"Lightmap {len(pages)}")
        save(tmp_path / "scene.blend")
        data = (tmp_path / "scene.blend").read_bytes()
        assert b"Lightmap_1" in data
        assert os.fsencode(os.path.normpath(bpy.app.tempdir)) not in data
        assert names(Path(bpy.app.tempdir)) == before


def test_other_images_of_the_file_are_reloaded(tmp_path):
    path = str(tmp_path / "map.exr")
    land(flat(1.0), path=path).name = "Other"
    other, painted = bpy.data.images["Other"], bpy.data.images.load(path)
    del other[MADE_HERE]
    assert linear(other)[0, 0, 0] == 1.0
    painted.pixels[0] = 0.5
    land(flat(2.0), path=path)
    assert linear(other)[0, 0, 0] == 2.0
    assert painted.pixels[0] == 0.5


# ------------------------------------------------------------------------------------------------------------- paths


def test_path_relative_to_the_blend(tmp_path):
    (tmp_path / "maps").mkdir()
    save(tmp_path / "scene.blend")
    image = land(flat(2.0), path="//maps/map")
    assert names(tmp_path / "maps") == ["map.exr"]
    assert image.filepath_raw == "//maps/map.exr"
    image = land(flat(2.0, 3.0), path="//maps/map.exr")
    assert image.filepath_raw == "//maps/map.<UDIM>.exr"


@pytest.mark.parametrize("relative", [True, False])
def test_path_relative_to_the_working_directory(relative, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert land(flat(2.0), path="map.exr").filepath_raw == str(tmp_path / "here" / "map.exr")
    save(tmp_path / "scene.blend")
    monkeypatch.setattr(bpy.context.preferences.filepaths, "use_relative_paths", relative)
    image = land(flat(3.0), path="map.exr")
    assert image.filepath_raw == ("//here/map.exr" if relative else str(tmp_path / "here" / "map.exr"))
    assert linear(image)[0, 0, 0] == 3.0
    assert names(tmp_path / "here") == ["map.exr"]


def test_extension_is_added_or_kept(tmp_path):
    base = str(tmp_path / "map")
    assert check_path("", ImageFormat.HDR) == ""
    assert check_path(base, "EXR_HALF") == base + ".exr"
    assert check_path(base + ".v2", ImageFormat.HDR) == base + ".v2.hdr"
    assert check_path(base + ".PNG", ImageFormat.PNG_16) == base + ".PNG"
    assert check_path(base + ".<UDIM>", ImageFormat.PNG_8) == base + ".<UDIM>.png"
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("path", "image_format", "words"),
    [
        ("{}/missing/map.exr", "EXR_HALF", "does not exist: create it"),
        ("{}/file/map.exr", "EXR_HALF", "does not exist: create it"),
        ("{}/folder", "EXR_HALF", "is a folder: name a file"),
        ("{}/new/", "EXR_HALF", "is a folder: name a file"),
        ("{}/folder.exr", "EXR_HALF", "is a folder"),
        ("{}/folder.<UDIM>.exr", "EXR_HALF", "is a folder"),
        ("//map.exr", "EXR_HALF", "has not been saved: save it first"),
        ("{}/map.png", "EXR_HALF", "ends in .png, but .* end in .exr: change"),
        ("{}/map.exr", "PNG_8", "ends in .exr, but .* end in .png: change"),
        ("{}/map.jpg", "HDR", "ends in .jpg"),
        ("{}/protected.exr", "EXR_HALF", "is write-protected"),
        ("{}/link.exr", "EXR_HALF", "is a device, which must not be replaced"),
        ("{}/" + "m" * 300, "HDR", "cannot be used"),
        ("{}/" + "m/" * 600 + "map.exr", "EXR_HALF", "too long"),
    ],
)
def test_paths_that_cannot_be_used(path, image_format, words, tmp_path):
    for folder in ("folder", "folder.exr", "folder.1001.exr"):
        (tmp_path / folder).mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "protected.exr").touch(mode=0o444)
    (tmp_path / "link.exr").symlink_to(os.devnull)
    before, path = names(tmp_path), path.format(tmp_path)
    with pytest.raises(ImageFileError, match=words) as caught:
        check_path(path, ImageFormat(image_format))
    assert path in str(caught.value)
    with pytest.raises(ImageFileError, match=words):
        stage(flat(1.0), "Lightmap", path, ImageFormat(image_format))
    assert names(tmp_path) == before


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_replaced_file_keeps_its_mode_and_links_stay_links(tmp_path):
    (tmp_path / "real").mkdir()
    file, link = tmp_path / "real" / "map.exr", tmp_path / "link.exr"
    file.touch()
    file.chmod(0o640)
    link.symlink_to(file)
    land(flat(2.0), path=str(link))
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert exr_header(file.read_bytes())
    assert (names(tmp_path), names(tmp_path / "real")) == (["link.exr", "real"], ["map.exr"])


# -------------------------------------------------------------------------------------------- failure and what stays


def scene_settings():
    """Settings that saving an image could spoil."""
    scene = bpy.context.scene
    owners = (
        scene.render,
        scene.render.image_settings,
        scene.view_settings,
        scene.display_settings,
        scene.sequencer_colorspace_settings,
    )
    return [
        {p.identifier: str(getattr(owner, p.identifier)) for p in owner.bl_rna.properties if p.type != "POINTER"}
        for owner in owners
    ]


@pytest.mark.parametrize("image_format", ImageFormat)
def test_nothing_of_the_users_changes(image_format, tmp_path):
    bpy.data.scenes.new("Second")
    bpy.context.scene.render.image_settings.file_format = "JPEG"
    bpy.context.scene.view_settings.exposure = 3.0
    before, settings, scene = file_state(), scene_settings(), bpy.context.scene
    temporary = names(Path(bpy.app.tempdir))
    for path in ("", str(tmp_path / "map")):
        stage([page(), page()], "Lightmap", path, image_format).discard()
        assert (file_state(), scene_settings()) == (before, settings)
        bpy.data.images.remove(land([page(), page()], path=path, image_format=image_format))
        assert (file_state(), scene_settings()) == (before, settings)
    assert bpy.context.scene == scene
    assert names(Path(bpy.app.tempdir)) == temporary


def full_disk(limit):
    """No file of this process may grow larger from now on."""
    resource = pytest.importorskip("resource")
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))


@pytest.mark.parametrize("image_format", ImageFormat)
@pytest.mark.parametrize("short_by", [1, 3000])
@pytest.mark.parametrize("packed", [True, False])
def test_full_disk(packed, short_by, image_format, tmp_path):
    path = "" if packed else str(tmp_path / "map")
    pages = [page(seed, size=64) for seed in range(2)]
    image = land(pages, path=str(tmp_path / "map"), image_format=image_format)
    size = min(file.stat().st_size for file in tmp_path.iterdir())
    before, files = image_state(image), {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    everything, temporary = file_state(), names(Path(bpy.app.tempdir))
    try:
        full_disk(size - short_by)
        with pytest.raises(ImageFileError, match=r"could not be written .*: make room"):
            stage(pages, "Lightmap", path, image_format)
    finally:
        full_disk(-1)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == files
    assert names(Path(bpy.app.tempdir)) == temporary
    assert image_state(image) == before
    assert file_state() == everything


def test_a_page_that_cannot_be_made_leaves_nothing(tmp_path):
    def fail():
        raise KeyboardInterrupt

    temporary = names(Path(bpy.app.tempdir))
    for path in ("", str(tmp_path / "map")):
        with pytest.raises(KeyboardInterrupt):
            stage([flat(1.0)[0], fail], "Lightmap", path, ImageFormat.EXR_HALF)
    assert (names(tmp_path), names(Path(bpy.app.tempdir))) == ([], temporary)
    assert len(bpy.data.images) == 0


def failing(step, at=1):
    """A function that does what `step` does, but fails the time after that."""
    calls = []

    def wrapper(*arguments, **keywords):
        calls.append(arguments)
        if len(calls) > at:
            raise PermissionError(13, "Permission denied")
        return step(*arguments, **keywords)

    return wrapper


@pytest.mark.parametrize("old", [0, 1, 2])
def test_a_file_that_cannot_be_replaced(old, tmp_path, monkeypatch):
    """The second of two; before there were none, one that is not in the way, or both."""
    image = land(flat(1.0, 2.0)[:old], path=str(tmp_path / "map")) if old else None
    before = image and image_state(image)
    files = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    staged = stage(flat(3.0, 4.0), "Lightmap", str(tmp_path / "map"), ImageFormat.EXR_HALF)
    with monkeypatch.context() as patched:
        broken = failing(os.replace)
        patched.setattr(os, "replace", lambda a, b, real=os.replace: broken(a, b) if ".part" in str(a) else real(a, b))
        with pytest.raises(ImageFileError, match=r"could not be replaced \(Permission denied\): close"):
            staged.land()
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == files
    assert [*bpy.data.images] == ([image] if image else [])
    assert before == (image and image_state(image))


@pytest.mark.parametrize("was", ["new", "packed", "packed tiles", "file", "tiles"])
@pytest.mark.parametrize("packed", [True, False])
def test_an_image_that_cannot_be_loaded(was, packed, tmp_path, monkeypatch):
    path, kept = str(tmp_path / "map"), str(tmp_path / "old" / "map")
    (tmp_path / "old").mkdir()
    node = before = None
    if was != "new":
        image = land(flat(1.0, 2.0)[: 2 if "tiles" in was else 1], path="" if "packed" in was else kept)
        node, before = used_by_material(image), image_state(image)
    staged = stage(flat(3.0, 4.0), "Lightmap", "" if packed else path, ImageFormat.PNG_8)

    def broken(image, tiles):
        raise RuntimeError("Error: no such luck\nand more")

    with monkeypatch.context() as patched:
        patched.setattr(lightmap_image, "_keep_tiles", broken)
        with pytest.raises(ImageFileError, match=r"\(no such luck\)"):
            staged.land()
    assert names(tmp_path) == ["old"]
    assert len(bpy.data.images) == (node is not None)
    if node:
        assert node.image == bpy.data.images["Lightmap"]
        assert image_state(node.image) == before
        assert land(flat(5.0)) == node.image


KILLED = """
import os, signal, sys
import bpy, numpy as np
from obscurance_addon.blender.writing import image as lightmap_image

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

moment, path = sys.argv[1:]
pages = [np.full((32, 32, 4), 7.0, np.float32)] * 2
replaced = []
def replace(part, target, real=os.replace):
    if len(replaced) == int(moment):
        die()
    replaced.append(target)
    real(part, target)
if moment == "writing":
    pages[1] = die
else:
    os.replace = replace
staged = lightmap_image.stage(pages, "Lightmap", path, lightmap_image.ImageFormat.EXR_HALF)
staged.land()
die()
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(
    ("moment", "levels"), [("writing", [1.0, 2.0]), ("0", [1.0, 2.0]), ("1", [7.0, 2.0]), ("2", [7.0, 7.0])]
)
def test_killed(moment, levels, tmp_path):
    """Each file is the old one or the new one."""
    path = tmp_path / "map.exr"
    image = land(flat(1.0, 2.0), path=str(path))
    done = subprocess.run([sys.executable, "-c", KILLED, moment, str(path)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [loaded(tmp_path / f"map.{tile}.exr", image)[0, 0, 0] for tile in (1001, 1002)] == levels
    assert (len(names(tmp_path)) > 2) == (moment != "2")
    land(flat(1.0, 2.0), path=str(path))
    assert names(tmp_path) == ["map.1001.exr", "map.1002.exr"]
