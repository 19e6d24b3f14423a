"""Charts do not overlap, keep their distance, have one density, and what cannot be placed is told."""

import subprocess
import sys
import time
import weakref
from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.errors import BackendError, BakeCancelledError, GeometryError
from obscurance_addon.core.lightmap import unwrapping as module
from obscurance_addon.core.lightmap.settings import LightmapSettings, Unwrapper
from obscurance_addon.core.lightmap.unwrap_worker import retired
from obscurance_addon.core.lightmap.unwrapping import TooManyChartsError, UnwrapMesh, unwrap
from obscurance_addon.core.native_library import why_missing
from obscurance_addon.core.process import child
from tests.core.scenes import box, grid, icosphere, welded

MISSING = [kind.library for kind in Unwrapper if why_missing(kind.library)]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"{' and '.join(MISSING)} not installed")
BOTH = pytest.mark.parametrize("unwrapper", Unwrapper)
SIZE, PADDING, FINE = 256, 3, 4  # FINE: samples per texel


def polygons(name, vertices, faces):
    """A mesh of polygons, each a fan of triangles from its first corner."""
    start = np.cumsum([0, *map(len, faces)])
    fans = [(a, a + i, a + i + 1) for a, f in zip(start, faces, strict=False) for i in range(1, len(f) - 1)]
    owner = [n for n, f in enumerate(faces) for _ in range(len(f) - 2)]
    vertex = np.array([v for f in faces for v in f], int)
    triangles = np.array(fans, int).reshape(-1, 3)
    return UnwrapMesh(name, np.asarray(vertices, float).reshape(-1, 3), vertex, start, triangles, np.array(owner, int))


def of(mesh, name="Thing"):
    """From a mesh of scenes.py: pairs of triangles with one face become quads."""
    if mesh.faces == len(mesh.triangles):
        return polygons(name, mesh.vertices, mesh.triangles.tolist())
    a, b = mesh.triangles[::2], mesh.triangles[1::2]
    return polygons(name, mesh.vertices, np.column_stack([a, b[:, 2]]).tolist())


def torus(n, minor=0.4):
    flat = grid((0, 0, 0), (2 * np.pi, 0, 0), (0, 2 * np.pi, 0), n, n)
    u, v = flat.vertices[:, 0], flat.vertices[:, 1]
    ring = 1.0 + minor * np.cos(v)
    return welded(replace(flat, vertices=np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], 1).round(9)))


def noisy(n, height):
    flat = grid((0, 0, 0), (1, 0, 0), (0, 1, 0), n, n)
    z = np.random.default_rng(1).normal(size=len(flat.vertices))[:, None] * [0, 0, height / n]
    return replace(flat, vertices=flat.vertices + z)


def prism(n, radius=1.0):
    """Two n-gons and n quads."""
    turn = 2 * np.pi * np.arange(n) / n
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], 1)
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return polygons(
        "Prism", np.concatenate([ring, ring + np.eye(3)[2]]), [list(range(n))[::-1], list(range(n, 2 * n)), *sides]
    )


def star():
    """A flat concave polygon with five points, and its triangles."""
    turn, radius = np.pi * np.arange(10) / 5, np.where(np.arange(10) % 2, 0.4, 1.0)
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], 1)
    ears = [((i - 1) % 10, i, (i + 1) % 10) for i in range(0, 10, 2)]
    inner = [(1, 3, 5), (1, 5, 7), (1, 7, 9)]
    return UnwrapMesh("Star", ring, np.arange(10), np.array([0, 10]), np.array(ears + inner), np.zeros(8, int))


def joined(*meshes):
    vertices, faces, first = [], [], 0
    for m in meshes:
        vertices.append(m.vertices)
        faces += (m.triangles + first).tolist()
        first += len(m.vertices)
    return polygons("Joined", np.concatenate(vertices), faces)


FIN = [[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 2, 3]]
FIN_POINTS = [(0, 0, 0), (0, 0, 1), (1, 0, 0.5), (-1, 0.5, 0.5), (-1, -1, 0.2)]
NEEDLES = [(0, 0, 0), *[(1.0, 1e-6 * i, 0) for i in range(40)]]
BROKEN = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (np.nan, 0, 0), (np.inf, 0, 0), (1e20, 0, 0), (1, 1, 0), (1, 1, 0)]
BROKEN_FACES = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5], [0, 1, 1], [6, 7, 0], [1, 6, 2]]

AWKWARD = {
    "box": of(box((0, 0, 0), (1, 2, 3), 3)),
    "icosphere": of(icosphere(3)),
    "fine sphere": of(icosphere(5)),
    "flipped": of(icosphere(2).flipped()),
    "torus": of(torus(24)),
    "tube bent by less than xatlas sees": of(torus(40, 0.02)),
    "uneven quads": of(noisy(24, 0.2)),
    "noisy": joined(noisy(24, 1.0)),
    "rough": joined(noisy(16, 6.0)),
    "prism": prism(64),
    "star": star(),
    "through each other": joined(icosphere(2), icosphere(2).moved(1.0, (0.3, 0, 0)), box((0, 0, 0), (1, 1, 1))),
    "twice the same": joined(icosphere(1), icosphere(1)),
    "duplicate faces": polygons("Double", BROKEN[:3], [[0, 1, 2], [0, 1, 2], [0, 2, 1]]),
    "three on an edge": polygons("Fin", FIN_POINTS, FIN),
    "needles": polygons("Needles", NEEDLES, [[0, i, i + 1] for i in range(1, 40)]),
    "twisted quad": polygons("Twist", [(0, 0, 0), (1, 0, 0.4), (1, 1, 0), (0, 1, 0.4)], [[0, 1, 2, 3]]),
    "broken": polygons("Broken", BROKEN, BROKEN_FACES),
    "small far away": of(icosphere(2).moved(1e-3, (5000.0, 0, 0))),
    "huge": of(box((0, 0, 0), (1e6, 1e6, 1e6), 2)),
}


def place(meshes, size=SIZE, padding=PADDING, **more):
    return unwrap(meshes, size=size, padding=padding, **{"check": lambda: None, **more})


def texels(atlas, meshes):
    """Triangles (t, 3, 2) in texels, and chart, page (t,) of each that is placed."""
    rows = []
    for mesh, uv, page, chart in zip(meshes, atlas.uv, atlas.page, atlas.chart, strict=True):
        on = chart[mesh.triangle_face] >= 0
        face = mesh.triangle_face[on]
        rows.append((uv[mesh.triangle_corners[on]].astype(float) * atlas.size, chart[face], page[face]))
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def samples_in(triangle, margin, step):
    """Points (n, 2) of the grid of that step that lie in a triangle by more than `margin` (below it when negative)."""
    a, b, c = triangle if cross(triangle) > 0 else triangle[::-1]
    low = np.floor((triangle.min(0) - max(-margin, 0)) / step)
    high = np.ceil((triangle.max(0) + max(-margin, 0)) / step)
    x, y = (np.arange(low[k], high[k] + 1) for k in (0, 1))
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    inside = np.ones(len(points), bool)
    for p, q in ((a, b), (b, c), (c, a)):
        normal = np.array([p[1] - q[1], q[0] - p[0]])
        length = np.hypot(*normal)
        inside &= (points * step - p) @ normal > margin * length if length else margin < 0.0
    return points[inside].astype(int)


def cross(t):
    return (t[1, 0] - t[0, 0]) * (t[2, 1] - t[0, 1]) - (t[1, 1] - t[0, 1]) * (t[2, 0] - t[0, 0])


def assert_apart(atlas, meshes):
    """No point of a grid of FINE samples per texel lies in two triangles by more than a hundredth of a texel."""
    triangles, _, pages = texels(atlas, meshes)
    used = np.zeros((atlas.pages, atlas.size * FINE + 1, atlas.size * FINE + 1), np.uint8)
    for triangle, page in zip(triangles, pages, strict=True):
        x, y = samples_in(triangle, 0.01, 1.0 / FINE).T
        used[page, y, x] += 1
    assert used.max() <= 1


def assert_whole_and_inside(atlas, meshes):
    for mesh, uv, page, chart in zip(meshes, atlas.uv, atlas.page, atlas.chart, strict=True):
        assert (uv.dtype, page.dtype, chart.dtype) == (np.float32, np.int32, np.int32)
        assert ((page >= 0) == (chart >= 0)).all()
        assert uv.min() >= 0.0
        assert uv.max() <= 1.0
        assert not uv[np.repeat(page < 0, np.diff(mesh.face_start))].any()
        assert page.max(initial=-1) < atlas.pages


def assert_not_mirrored(atlas, meshes):
    """Each triangle turns the same way in the map as in the mesh, seen from its front."""
    assert min(map(cross, texels(atlas, meshes)[0])) >= 0.0


def assert_even(atlas, meshes, tolerance):
    """Each object has the density told."""
    for mesh, uv, chart in zip(meshes, atlas.uv, atlas.chart, strict=True):
        corners = mesh.triangle_corners[chart[mesh.triangle_face] >= 0]
        flat = sum(abs(cross(t)) for t in uv[corners].astype(float) * atlas.size)
        p = mesh.positions[mesh.corner_vertex[corners]]
        real = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum()
        assert flat == pytest.approx(real * atlas.texels_per_metre**2, rel=tolerance)


@BOTH
@pytest.mark.parametrize("name", AWKWARD)
def test_awkward_meshes(name, unwrapper):
    """1 % of area: rounding of coordinates, at float32 over a page of 256, on meshes some 10 texels wide or more."""
    meshes = [AWKWARD[name]]
    atlas = place(meshes, unwrapper=unwrapper)
    assert_apart(atlas, meshes)
    assert_whole_and_inside(atlas, meshes)
    assert_not_mirrored(atlas, meshes)
    assert atlas.pages == 1
    if name != "needles":  # these are thinner than float32 tells on a page
        assert_even(atlas, meshes, 0.01)


@BOTH
def test_all_at_once_is_deterministic(unwrapper):
    meshes = [mesh for name, mesh in AWKWARD.items() if name not in ("huge", "small far away", "fine sphere")]
    one, two = (place(meshes, 512, unwrapper=unwrapper) for _ in range(2))
    for name in ("uv", "page", "chart"):
        assert [a.tobytes() for a in getattr(one, name)] == [a.tobytes() for a in getattr(two, name)]
    assert one.texels_per_metre == two.texels_per_metre
    assert_apart(one, meshes)
    numbers = [set(chart[chart >= 0].tolist()) for chart in one.chart]
    assert sum(map(len, numbers)) == len(set().union(*numbers))


@BOTH
@pytest.mark.parametrize("padding", [0, 1, 2, 4, 8])
def test_charts_keep_their_distance(padding, unwrapper):
    """Between texels that two charts touch lie `padding` others."""
    meshes = [of(icosphere(2)), of(box((0, 0, 0), (1, 1, 1), 2)), of(torus(8)), prism(7, 0.3)]
    atlas = place(meshes, 256, padding, unwrapper=unwrapper)
    triangles, charts, _ = texels(atlas, meshes)
    owner = np.full((atlas.size, atlas.size), -1)
    fine = {}
    for triangle, chart in zip(triangles, charts, strict=True):
        fine.setdefault(chart, []).append(samples_in(triangle, -1e-3, 1.0 / FINE) // FINE)
    for chart, points in fine.items():
        x, y = np.minimum(np.concatenate(points), atlas.size - 1).T
        assert set(owner[y, x].tolist()) <= {-1, chart}
        owner[y, x] = chart
    for dy in range(-padding, padding + 1):
        for dx in range(-padding, padding + 1):
            low, high = np.maximum([dy, dx], 0), atlas.size + np.minimum([dy, dx], 0)
            here = owner[low[0] : high[0], low[1] : high[1]]
            there = owner[low[0] - dy : high[0] - dy, low[1] - dx : high[1] - dx]
            assert not ((here >= 0) & (there >= 0) & (here != there)).any()


@BOTH
def test_polygons_stay_flat(unwrapper):
    """A planar n-gon keeps its shape: distances of corners are those in the world times the density."""
    mesh = prism(64)
    atlas = place([mesh], unwrapper=unwrapper)
    for face in (0, 1):
        loop = slice(mesh.face_start[face], mesh.face_start[face + 1])
        flat, real = atlas.uv[0][loop] * SIZE, mesh.positions[mesh.corner_vertex[loop]]
        gap = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (flat, real)]
        np.testing.assert_allclose(gap[0], gap[1] * atlas.texels_per_metre, atol=0.02)


@BOTH
def test_the_greatest_density_is_found(unwrapper):
    """Six equal squares cannot be wider than a third of a page, and come within padding and a texel of it."""
    atlas = place([of(box((0, 0, 0), (1, 1, 1), 4))], 512, 2, unwrapper=unwrapper)
    best = (512 - 3 - 3 * 2) / 3
    assert best / 1.03 < atlas.texels_per_metre <= 512 / 3


@BOTH
def test_given_density_takes_pages(unwrapper):
    meshes = [of(icosphere(3)), of(box((0, 0, 0), (2, 3, 1), 6), "Box")]
    atlas = place(meshes, 128, texels_per_metre=50.0, unwrapper=unwrapper)
    assert atlas.texels_per_metre == 50.0
    assert atlas.pages > 1
    assert {p for page in atlas.page for p in page.tolist()} == set(range(atlas.pages))
    assert_apart(atlas, meshes)
    assert_not_mirrored(atlas, meshes)
    assert_even(atlas, meshes, 0.01)


@BOTH
def test_wide_charts_are_cut(unwrapper):
    """A plane of 3 x 3 pages falls into parts, none of them shrunk."""
    mesh = of(grid((0, 0, 0), (3, 0, 0), (0, 3, 0), 30, 30))
    atlas = place([mesh], 64, texels_per_metre=64.0, unwrapper=unwrapper)
    assert atlas.pages >= 9
    assert_even(atlas, [mesh], 0.01)
    assert_apart(atlas, [mesh])


@BOTH
def test_a_face_wider_than_a_page(unwrapper):
    with pytest.raises(
        GeometryError, match=r"a face of object 'Floor' is 10 m wide, 1000 texels, .* lower .* raise the size"
    ):
        place([of(grid((0, 0, 0), (10, 0, 0), (0, 1, 0)), "Floor")], 512, texels_per_metre=100.0, unwrapper=unwrapper)


@BOTH
def test_too_many_pages(unwrapper):
    with pytest.raises(GeometryError, match=r"more than 100; lower the texels per metre or raise the size"):
        place([of(box((0, 0, 0), (1, 1, 1), 64))], 16, texels_per_metre=100.0, unwrapper=unwrapper)


@BOTH
@pytest.mark.parametrize(("padding", "least"), [(2, 480), (4, 80)], ids=["packed", "counted"])
def test_too_many_charts_for_a_page(padding, least, unwrapper, monkeypatch):
    """Eighty boxes are so many charts at least, which is known before anything is cut."""
    parts = joined(*[box((3 * i, 0, 0), (3 * i + 1, 1, 1)) for i in range(80)])
    if padding == 4:
        monkeypatch.setattr(module, "ChildProcess", None)
    with pytest.raises(TooManyChartsError, match=rf"at least {least} charts, more than a page of 32 x 32") as caught:
        place([parts], 32, padding, unwrapper=unwrapper)
    assert caught.value.charts == least


def test_the_refusal_of_too_many_charts_proposes_what_holds_them():
    """Raising the size alone does not help for ever: the padding grows with it."""
    few, many, most = (LightmapSettings(margin=16).cure_for(charts) for charts in (9_000, 60_000, 10_000_000))
    assert few == "raise the size to 2048 (Size, --size 2048)"
    assert many == "raise the size to 2048 (Size, --size 2048) and lower the margin to 8 (Margin, --margin 8)"
    assert most.startswith("unwrap fewer objects at once, or give a density")
    assert LightmapSettings(size=8192, margin=64).cure_for(200_000) == "lower the margin to 4 (Margin, --margin 4)"


@BOTH
def test_a_vertex_far_astray(unwrapper):
    """One face takes the page, the others shrink to points on it."""
    sphere = icosphere(2)
    faces = [*sphere.triangles.tolist(), [0, 1, len(sphere.vertices)]]
    atlas = place([polygons("Astray", np.append(sphere.vertices, [[1e14, 0, 0]], 0), faces)], unwrapper=unwrapper)
    assert (atlas.page[0] == 0).all()


@BOTH
def test_faces_without_area_are_told(unwrapper):
    atlas = place([AWKWARD["broken"], of(icosphere(1))], unwrapper=unwrapper)
    assert atlas.page[0].tolist() == [0, -1, -1, -1, -1, -1, 0]
    assert atlas.notes == [
        "faces without area, or far astray, get no texels: 'Broken'; remove these faces, or scale the objects up"
    ]


@pytest.mark.parametrize(
    "meshes",
    [[], [polygons("Nil", [], [])], [polygons("Line", [(0, 0, 0), (1, 1, 1), (2, 2, 2)], [[0, 1, 2]] * 1000)]],
    ids=["none", "empty", "lines"],
)
def test_nothing_to_unwrap(meshes):
    with pytest.raises(GeometryError, match=r"no face to unwrap has an area.*repair") as caught:
        place(meshes)
    assert all(f"'{mesh.name}'" in str(caught.value) for mesh in meshes)


@BOTH
def test_empty_meshes_beside_others(unwrapper):
    atlas = place(
        [polygons("Nil", [], []), of(icosphere(1)), polygons("Line", np.eye(3)[:1].repeat(3, 0), [[0, 1, 2]])],
        unwrapper=unwrapper,
    )
    assert [len(page) for page in atlas.page] == [0, 80, 1]
    assert atlas.notes == [
        "faces without area, or far astray, get no texels: 'Line'; remove these faces, or scale the objects up"
    ]


@BOTH
def test_a_polygon_that_overlaps_itself_is_told(unwrapper):
    """A staircase around a corner, more than once; a bow, which unfolds, is nothing to tell."""
    turn = np.linspace(0.0, 3.5 * np.pi, 30)
    stairs = [(0, 0, 0), *np.stack([np.cos(turn), np.sin(turn), 0.02 * turn], 1)]
    bow = polygons("Bow", [(0, 0, 0), (1, 1, 0), (1, 0, 0.3), (0, 2, 0)], [[0, 1, 2, 3]])
    atlas = place([polygons("Stairs", stairs, [list(range(31))]), bow], unwrapper=unwrapper)
    assert atlas.notes == ["twisted faces overlap themselves when laid flat: 'Stairs'; triangulate them"]
    assert_apart(place([bow], unwrapper=unwrapper), [bow])


@BOTH
def test_cancelling_ends_the_child(monkeypatch, unwrapper):
    started = []
    start = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(start(*a, **k)) or started[-1])

    def check():
        raise BakeCancelledError("cancelled")

    begin = time.monotonic()
    with pytest.raises(BakeCancelledError):
        place([of(icosphere(6))], check=check, unwrapper=unwrapper)
    assert started[0].returncode is not None
    assert time.monotonic() - begin < 5.0  # the unwrapping itself takes as long; starting it takes a tenth


FIRST_LINES = """
import importlib.util, os, sys, time
from multiprocessing.connection import Connection
from pathlib import Path
spec = importlib.util.spec_from_file_location("start", {start!r})
start = importlib.util.module_from_spec(spec)
spec.loader.exec_module(start)
start.load_package(Path(sys.argv[1]), sys.argv[2])
from obscurance_addon.core.process import Channel
channel = Channel(Connection(int(sys.argv[3])), Path(sys.argv[4]))
"""
CHILDREN = {
    "abort": (
        "channel.send(('mesh', 1)); os.abort()",
        r"failed \(it was ended by signal 6 \(SIGABRT\)\) on object 'Second'; keep an existing UV",
    ),
    "exit": ("raise ValueError('odd')", r"failed \(ValueError: odd\) before its first mesh; keep existing UV maps"),
    "packing": (
        "channel.send(('mesh', 0)); channel.send(('pack', 0)); sys.exit(3)",
        r"exit code 3\) while it packed",
    ),
    "silence": ("pass", r"failed \(exit code 0\)"),
    "printing": (
        "print('ASSERT', flush=True); channel.send(('mesh', 0)); print('pack 0', flush=True); sys.exit(3)",
        r"failed \(pack 0\) on object 'First'",
    ),
    "hang": ("channel.send(('mesh', 0)); time.sleep(60)", r"does not come to an end on object 'First'; keep"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="the child is made with POSIX pipes")
@pytest.mark.parametrize("kind", CHILDREN)
def test_a_failing_child(kind, monkeypatch, tmp_path):
    script, message = CHILDREN[kind]
    (tmp_path / "child.py").write_text(FIRST_LINES.format(start=str(child._START)) + script)
    monkeypatch.setattr(child, "_START", tmp_path / "child.py")
    if kind == "hang":
        monkeypatch.setattr(module, "PATIENCE", 2.0)
    with pytest.raises(BackendError, match=message):
        place([of(icosphere(0), "First"), of(icosphere(0), "Second")])


def test_a_child_that_cannot_start(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(BackendError, match="does not start"):
        place([of(icosphere(0))])


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the child ends later")
def test_the_child_dies_with_its_parent(tmp_path):
    """Its parent is killed while it cuts a mesh that takes it seconds."""
    code = (
        "import sys, time; sys.path[:0] = {0!r}; from tests.core.lightmap.test_unwrapping import *; "
        "place([of(icosphere(6))])"
    )
    parent = subprocess.Popen([sys.executable, "-c", code.format(sys.path)], env={"TMPDIR": str(tmp_path)})
    try:
        wait(lambda: children(parent.pid))
        (unwrapper,) = children(parent.pid)
    finally:
        parent.kill()
        parent.wait()
    wait(lambda: not running(unwrapper))


def wait(condition):
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def children(pid):
    try:
        with open(f"/proc/{pid}/task/{pid}/children") as file:
            return [int(word) for word in file.read().split()]
    except FileNotFoundError:
        return []


def running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_atlases_rest_before_they_are_freed(monkeypatch):
    """xatlas hangs when it frees an atlas whose threads have yet to fall asleep."""
    now = [0.0]
    monkeypatch.setattr(retired.time, "monotonic", lambda: now[0])
    alive = []
    for now[0] in (0.0, 0.9 * retired.REST, 1.1 * retired.REST):
        atlas = icosphere(0)  # any object that can be watched
        alive.append(weakref.ref(atlas))
        retired.retire(atlas)
        del atlas
    assert [ref() is not None for ref in alive] == [False, True, True]


def test_what_the_library_prints_is_one_note():
    """A rim of pentagons at which xatlas prints an assertion and goes on."""
    corners = [[0.4781, 0.0, 0.0], [0.4691, 0.0, 0.0205], [0.4691, 0.0, 0.0205]]
    turn = 2.0 * np.pi * np.arange(32)[:, None] / 32
    radius, _, height = np.array(corners).T
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.broadcast_to(height, (32, 3))], -1)
    points[:, 2, :2] = 0.5 * (points[:, 1, :2] + np.roll(points[:, 1, :2], -1, 0))
    faces = [[3 * i, 3 * i + 1, 3 * i + 2, 3 * i + 4, 3 * i + 3] for i in range(17)]
    rim = polygons("Rim", np.float32(points), faces)
    cut = np.tile([[4, 0, 1], [2, 3, 4], [1, 2, 4]], (17, 1, 1))  # as Blender does it
    cut[[5, 13], 1:] = [[1, 2, 3], [1, 3, 4]]
    rim = replace(rim, triangle_corners=(cut + 5 * np.arange(17)[:, None, None]).reshape(-1, 3))
    (note,) = place([rim], 256, 4, unwrapper=Unwrapper.XATLAS).notes
    assert "ASSERT" in note
    assert "--unwrapper" in note
    assert place([rim], 256, 4, unwrapper=Unwrapper.UVUNWRAP).notes == []


def test_a_missing_library_names_the_other(monkeypatch):
    monkeypatch.setattr(module, "why_missing", lambda name: "is gone" if name == "uvunwrap" else None)
    with pytest.raises(BackendError, match=r"is gone, or choose the unwrapper xatlas \(--unwrapper XATLAS\)"):
        place([of(icosphere(0))], unwrapper=Unwrapper.UVUNWRAP)


@BOTH
def test_progress_grows_to_its_end(unwrapper):
    heard = []
    place([of(icosphere(2)), of(icosphere(1))], progress=heard.append, unwrapper=unwrapper)
    assert heard == sorted(heard)
    assert heard[0] == 0.0
    assert 0.6 < heard[-1] <= 1.0
