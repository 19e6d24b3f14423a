"""Frame caches that are broken in every way: each plays, or is one sentence with the cure, within little memory."""

import json
import os
import random
import shutil
import tracemalloc

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.live_preview import PREVIEW
from obscurance_addon.blender.frame_caches.frame_cache import FrameCache, FrameCacheError
from obscurance_addon.core.errors import ObscuranceError
from tests.blender.frame_caches.cache_helpers import FRAMES, SIZES, values, write, write_version_1
from tests.blender.helpers import colors, cube, floor

MUTATIONS = 300
MEMORY_BYTES = 2 << 20  # the caches have 5 kB; Python's own needs are most of it
HOSTILE = [
    None, True, -1, 0, 1, 3, 10**9, 10**30, -(10**30), 1.5, float("nan"), float("inf"), "", "x", "../..", "/dev/zero",
    "\0", "\ud800", "x" * 10_000, [], {}, [[]], [1], [None], {"": []}, [[1, 2, 3]], [[4, 1]], [10**30, 1],
    [[1, 10**12]],
]  # fmt: skip
BOMB = np.zeros((300_000, 3), np.float32)  # packs into 4 kB


@pytest.fixture
def scene(empty_scene):
    """Objects with as many faces as the caches have values."""
    floor("Floor", n=4)
    cube("Block", 0.3)
    floor("Far", n=2)
    bpy.context.view_layer.update()
    yield empty_scene
    PREVIEW.stop()


@pytest.fixture(scope="module")
def caches(tmp_path_factory):
    """A cache as it is written today, and one of version 1."""
    home = tmp_path_factory.mktemp("caches")
    write(home / "today", values(1))
    write_version_1(home / "former", values(1))
    return [home / "today", home / "former"]


def replaced(choose, path):
    """Put something else in the place of a file."""
    content = path.read_bytes()
    path.unlink()
    kind = choose.choice(["none", "folder", "pipe", "device", "dangling", "circle", "other", "link to itself"])
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "dangling":
        path.symlink_to(path.with_name("nothing"))
    elif kind == "circle":
        path.symlink_to(path)
    elif kind == "other":
        path.write_bytes(choose.randbytes(choose.randrange(2000)))
    elif kind == "link to itself":
        path.with_name("aside").write_bytes(content)
        path.symlink_to("aside")


def cut_or_flipped(choose, path):
    """Change some bytes of a file, or leave out or repeat some."""
    data = bytearray(path.read_bytes())
    for _ in range(choose.choice([1, 1, 1, 5, 50])):
        at = choose.randrange(len(data))
        kind = choose.randrange(5)
        if kind == 0:
            del data[at:]
        elif kind == 1:
            del data[at : at + choose.randrange(1, 40)]
        elif kind == 2:
            data[at:at] = data[at : at + choose.randrange(1, 200)]
        elif kind == 3:
            size = choose.choice([2, 4, 8])
            data[at : at + size] = choose.choice([b"\xff", b"\0", b"\x7f"]) * size
        else:
            data[at] ^= 1 << choose.randrange(8)
        if not data:
            break
    path.write_bytes(data)


def other_index(choose, path):
    """Put a wrong value anywhere into the index, or another text in its place."""
    text = path.read_text()
    kind = choose.randrange(12)
    if kind == 0:
        path.write_text("[" * 100_000)
    elif kind == 1:
        path.write_text(text.replace("1", '{"a":' * 50_000, 1))
    elif kind == 2:
        path.write_text(text, encoding=choose.choice(["utf-16", "utf-32", "utf-8-sig"]))
    elif kind == 3:
        path.write_bytes(text.replace("Far", "F\xe4r").encode("latin-1"))
    elif kind == 4:
        path.write_text(text.replace("[1", "[" + "9" * 6000, 1))
    else:
        index = json.loads(text)
        node = index
        while True:
            key = choose.choice(list(node) if isinstance(node, dict) else range(len(node)))
            if isinstance(node[key], (dict, list)) and node[key] and choose.random() < 0.7:
                node = node[key]
                continue
            break
        if isinstance(node, dict) and choose.random() < 0.2:
            node[choose.choice(["", "x", "\ud800", "Floor"])] = node.pop(key)
        else:
            node[key] = choose.choice(HOSTILE)
        path.write_text(json.dumps(index))


def other_arrays(choose, path):
    """Write a file of a frame with something else in it than there should be."""
    with np.load(path) as file:
        arrays = dict(file)
    save, name = np.savez, choose.choice(list(arrays))
    kind = choose.randrange(12)
    if kind == 0:
        save = np.savez_compressed
    elif kind == 1:
        save, arrays[name] = np.savez_compressed, BOMB
    elif kind == 2:
        arrays[name] = np.array([{"code": os.system}, 1], object)
    elif kind == 3:
        arrays["0"] = choose.choice([np.nan, np.inf, -np.inf]) * np.ones_like(arrays["0"])
    elif kind == 4:
        arrays[name] = arrays[name].astype(choose.choice(["f8", "i4", "S8", "c8", "?"]), casting="unsafe")
    elif kind == 5:
        arrays["0"] = choose.choice([arrays["0"].T, arrays["0"][:-1], arrays["0"].ravel(), arrays["0"][..., None]])
    elif kind == 6:
        names = [choose.choice(HOSTILE) for _ in SIZES]
        arrays["names"] = np.array(choose.choice([json.dumps(names), "[" * 30_000, "{}", "null", "1", ""]))
    elif kind == 7:
        del arrays[name]
    elif kind == 8:
        arrays = dict(reversed(arrays.items()))
    elif kind == 9:
        arrays["0"] = np.asfortranarray(arrays["0"])
    elif kind == 10:
        arrays |= {f"more {i}": arrays["0"] for i in range(100)}
    else:
        arrays["0"] = arrays["0"] * np.float32(choose.choice([-1, 1e30, 1e-40]))
    save(path, **{name: np.asarray(array) for name, array in arrays.items()})


def broken(choose, cache, folder):
    """Copy a cache and break it somewhere."""
    shutil.copytree(cache, folder)
    frames = sorted(folder.rglob("frame_*.npz"))
    path = choose.choice([folder / "index.json", *frames[:2]])
    if path.suffix == ".json":
        choose.choice([replaced, cut_or_flipped, other_index, other_index])(choose, path)
    else:
        choose.choice([replaced, cut_or_flipped, cut_or_flipped, other_arrays, other_arrays])(choose, path)


def one_sentence(error, folder):
    text = str(error)
    assert "\n" not in text
    assert len(text) < 300 + len(str(folder))
    assert any(
        cure in text for cure in ("bake the frames again", "choose another", "choose a shorter", "clear Frame Cache")
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes and devices")
def test_a_broken_cache_plays_or_is_one_sentence(scene, caches, tmp_path):
    """Nothing else is raised, hardly any memory is used, and what plays is finite."""
    choose = random.Random(17)
    played, sentences = 0, set()
    tracemalloc.start()
    try:
        for number in range(MUTATIONS):
            folder = tmp_path / "c"
            broken(choose, caches[number % 2], folder)
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            try:
                cache = FrameCache.open(folder)
                for frame in range(FRAMES[0], FRAMES[1] + 1):
                    if cache.has(frame):
                        cache.show(frame)
                played += 1
            except ObscuranceError as error:
                one_sentence(error, folder)
                sentences.add(str(error))
            assert tracemalloc.get_traced_memory()[1] - before < MEMORY_BYTES, number
            shutil.rmtree(folder)
    finally:
        tracemalloc.stop()
    assert 0.1 * MUTATIONS < played < 0.5 * MUTATIONS  # a zip has fields that tell nothing of its values
    assert len(sentences) > 10
    assert all(np.isfinite(colors(ob)).all() for ob in scene.objects if "Obscurance" in ob.data.attributes)


def told(caplog):
    return [record.message for record in caplog.records if "frame cache" in record.message]


@pytest.mark.parametrize("broken_file", ["index.json", "frame_*.npz"])
def test_a_cache_that_breaks_while_it_plays_is_said_once(scene, caches, tmp_path, caplog, capfd, broken_file):
    """The panel shows the sentence at each frame; a handler that raised would print a traceback."""
    folder = shutil.copytree(caches[0], tmp_path / "c")
    scene.obscurance.corner_copy, scene.obscurance.rays = False, 1
    scene.obscurance.frame_cache, scene.obscurance.live_preview = str(folder), True
    scene.frame_set(1)
    assert "from the cache" in PREVIEW.status
    with caplog.at_level("INFO"):
        for path in folder.rglob(broken_file):
            path.write_bytes(b"nothing")
        for frame in (2, 3, 4, 2, 3):
            scene.frame_set(frame)
            assert "cannot be read" in PREVIEW.status or broken_file == "index.json"
        assert len(told(caplog)) == 1
        assert "cannot be read" in told(caplog)[0]
        assert told(caplog)[0].endswith("bake the frames again, or clear Frame Cache")
        for path in folder.rglob("*.npz"):
            path.unlink()
        for frame in (2, 3, 4):
            scene.frame_set(frame)
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_cache_that_is_baked_again_while_it_plays_goes_on(scene, tmp_path):
    """Its former files are gone when the next frame is set, and even when they vanish within it."""
    write(tmp_path / "c", values(1))
    scene.obscurance.frame_cache, scene.obscurance.live_preview = str(tmp_path / "c"), True
    scene.frame_set(1)
    write(tmp_path / "c", values(2))
    scene.frame_set(2)
    assert np.array_equal(colors(bpy.data.objects["Floor"]), values(2)[2]["Floor"])
    assert PREVIEW._playback.has(scene)
    write(tmp_path / "c", values(3))
    scene.frame_current = 3
    assert "from the cache" in PREVIEW._playback.show(scene)
    assert np.array_equal(colors(bpy.data.objects["Floor"]), values(3)[3]["Floor"])


def test_a_path_that_is_no_text_is_said(scene, caplog, capfd):
    """As a file has it that was made where other characters were in use."""
    scene.obscurance.rays, scene.obscurance.live_preview = 1, True
    scene.obscurance.frame_cache = os.fsdecode(b"/nowhere/\xe4")
    with caplog.at_level("INFO"):
        for frame in (1, 2, 3):
            scene.frame_set(frame)
    (sentence,) = told(caplog)
    assert sentence.encode().endswith(b"'/nowhere/?': bake the frames again, or clear Frame Cache")
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_cache_of_another_version_is_said(caches, tmp_path):
    folder = shutil.copytree(caches[0], tmp_path / "c")
    index = json.loads((folder / "index.json").read_text())
    (folder / "index.json").write_text(json.dumps(index | {"version": 3}))
    with pytest.raises(FrameCacheError, match="another version"):
        FrameCache.open(folder)
