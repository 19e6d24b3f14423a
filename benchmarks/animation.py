"""Updates while an object moves: table 1 of the paper, the cost beside the size of the scene, and the 2003 list."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bmesh
import bpy
import numpy as np
from scenes import SAMPLES, empty_scene, select_only

from obscurance_addon.blender.animation.live_preview import PREVIEW
from obscurance_addon.blender.jobs.job import TRACERS
from obscurance_addon.core.obscurance.bake import bake_obscurances
from obscurance_addon.core.scene.objects import join_objects
from obscurance_addon.core.updates.incremental import IncrementalBake

TABLE_SCENES = ("room_1423", "room_4016", "infinite_5508", "infinite_13824")
TABLE_RAYS = (60, 80, 100)
FRAMES = range(2, 62)  # after the first, over which the moving cube passes the red and the yellow one
PASSES = 2  # in the first one, what stands still is traced where the cube comes near
CUBE, CUBE_CELLS = "Moving Cube", 5  # 150 faces

TILE_FACES, TILE_SIDE, TILE_RAYS, TILE_REACH = 64, 4.0, 64, 1.0  # faces along a side, metres, rays a face, metres
TILES = (5, 10)  # along a side: 102,400 and 409,600 faces

LIST_SCENES = ("room_1423", "room_4016")
LIST_RAYS = 64


def run(repeats: int) -> dict:
    """All parts."""
    return {
        "table": [_table_row(name, rays) for name in TABLE_SCENES for rays in TABLE_RAYS],
        "tiles": _tiles(repeats),
        "list": [_list_row(name) for name in LIST_SCENES],
    }


def _table_row(name: str, rays: int) -> dict:
    """One scene with one number of rays: a full bake, and updates over two passes through the same frames."""
    _open(name)
    scene = bpy.context.scene
    scene.obscurance.rays = rays
    objects = [ob for ob in scene.objects if ob.type == "MESH"]
    select_only(objects)
    full = []
    for _ in range(3):
        TRACERS.clear()
        full.append(_seconds(bpy.ops.obscurance.bake))
    without = [_seconds(lambda frame=frame: scene.frame_set(frame)) for frame in FRAMES]
    with _preview(scene):
        passes = [_pass(scene) for _ in range(PASSES)]
        full_core = [_seconds(_full_core) for _ in range(3)]
    return {
        "scene": name,
        "patches": sum(len(ob.data.polygons) for ob in objects),
        "moving": len(bpy.data.objects[CUBE].data.polygons),
        "rays_per_patch": rays,
        "full": full,
        "full_core": full_core,
        "frames_without": without,
        "passes": passes,
    }


def _full_core() -> None:
    """A full bake of the arrays that the preview has, by the core alone; its error estimate included."""
    bake = PREVIEW._updater._follower._following._bake
    joined = join_objects(bake.objects.values())
    bake_obscurances(
        joined.surfaces,
        joined.patches,
        bpy.context.scene.obscurance.to_settings(),
        neighbours=joined.neighbours,
        patch_reflectance=joined.patch_reflectance,
        held=bake.held,
    )


def _pass(scene: bpy.types.Scene) -> dict:
    """Seconds of every frame, of the core's part of it, and counts."""
    scene.frame_set(FRAMES[0] - 1)
    core, counts = [], []
    with _core_watched(core, counts):
        whole = [_seconds(lambda frame=frame: scene.frame_set(frame)) for frame in FRAMES]
    assert len(core) == len(whole)
    return {"frames": whole, "core": core, "counts": counts}


def _tiles(repeats: int) -> list[dict]:
    """The same mover above the same tile, among few and among many other tiles."""
    rows = []
    for side in TILES:
        empty_scene()
        scene = bpy.context.scene
        objects = [*_tiled_floor(side), _add_cube((0.0, 0.0, 0.5), 0.5)]
        cube = objects[-1]
        for frame, x in ((1, -0.6), (FRAMES[-1], 0.6)):
            cube.location = (x, 0.1, 0.5)
            cube.keyframe_insert("location", frame=frame)
        bpy.context.view_layer.update()
        group = scene.obscurance
        group.rays, group.distance_mode, group.distance = TILE_RAYS, "METRES", TILE_REACH
        select_only(objects)
        full = []
        for _ in range(repeats):
            TRACERS.clear()
            full.append(_seconds(bpy.ops.obscurance.bake))
        with _preview(scene):
            passes = [_pass(scene) for _ in range(1 + repeats)]
        rows.append(
            {"patches": sum(len(ob.data.polygons) for ob in objects), "objects": len(objects), "full": full}
            | {"passes": passes}
        )
    return rows


def _tiled_floor(side: int) -> list[bpy.types.Object]:
    """side x side bumpy tiles, each an object with a mesh of its own; the cube is above the middle of the same one."""
    line = np.linspace(-0.5 * TILE_SIDE, 0.5 * TILE_SIDE, TILE_FACES + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    points = np.stack([x, y, 0.05 * np.sin(5.0 * x) * np.sin(4.0 * y)], -1)
    first = (np.arange(TILE_FACES)[:, None] * (TILE_FACES + 1) + np.arange(TILE_FACES)).ravel()
    faces = np.stack([first, first + 1, first + TILE_FACES + 2, first + TILE_FACES + 1], -1)
    tiles = []
    for i in range(side * side):
        mesh = bpy.data.meshes.new("Tile")
        mesh.from_pydata(points.tolist(), [], faces.tolist())
        tile = bpy.data.objects.new("Tile", mesh)
        tile.location = (TILE_SIDE * (i % side), TILE_SIDE * (i // side), 0.0)
        bpy.context.scene.collection.objects.link(tile)
        tiles.append(tile)
    return tiles


def _list_row(name: str) -> dict:
    """The 2003 list beside the exact mode: patches that it misses, how wrong they are, rays and time."""
    values, rows = {}, {}
    for mode in ("EXACT", "LIST"):
        _open(name)
        scene = bpy.context.scene
        scene.obscurance.rays, scene.obscurance.preview_mode = LIST_RAYS, mode
        with _preview(scene):
            rows[mode] = _pass(scene)
            values[mode] = []
            scene.frame_set(1)
            for frame in FRAMES:
                scene.frame_set(frame)
                values[mode].append(_all_values())
    changed = missed = 0
    stale = 0.0
    before = values["EXACT"][0]
    for exact, listed in zip(values["EXACT"][1:], values["LIST"][1:], strict=True):
        is_changed, is_wrong = (exact != before).any(1), (exact != listed).any(1)
        changed += int(np.count_nonzero(is_changed))
        missed += int(np.count_nonzero(is_wrong))
        stale = max(stale, float(np.abs(exact - listed).max()))
        before = exact
    return {"scene": name, "rays_per_patch": LIST_RAYS, "changed": changed, "wrong": missed, "stale": stale} | rows


def _all_values() -> np.ndarray:
    found = []
    for ob in sorted(bpy.context.scene.objects, key=lambda ob: ob.name):
        if ob.type == "MESH":
            data = ob.data.attributes["Obscurance"].data
            values = np.empty(len(data) * 4, np.float32)
            data.foreach_get("color", values)
            found.append(values.reshape(-1, 4)[:, :3])
    return np.concatenate(found)


def _open(name: str) -> None:
    """A sample scene; one in which nothing moves gets a cube as Room has it, a tenth of the scene's width."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / f"{name}.blend"))
    if CUBE in bpy.data.objects:
        return
    corners = np.array(
        [ob.matrix_world @ v.co for ob in bpy.data.objects if ob.type == "MESH" for v in ob.data.vertices]
    )
    low, high = corners.min(0), corners.max(0)
    centre, width = 0.5 * (low + high), float((high - low)[0])
    cube = _add_cube(centre, 0.1 * width)
    for frame, share in ((1, -0.25), (FRAMES[-1], 0.25)):
        cube.location = centre + np.array([share * width, 0.0, 0.0])
        cube.keyframe_insert("location", frame=frame)


def _add_cube(place: np.ndarray, side: float) -> bpy.types.Object:
    """A cube of 150 faces."""
    mesh, shape = bpy.data.meshes.new(CUBE), bmesh.new()
    bmesh.ops.create_cube(shape, size=side)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=CUBE_CELLS - 1, use_grid_fill=True)
    shape.to_mesh(mesh)
    shape.free()
    cube = bpy.data.objects.new(CUBE, mesh)
    cube.location = place
    bpy.context.scene.collection.objects.link(cube)
    return cube


@contextmanager
def _preview(scene: bpy.types.Scene) -> Iterator[None]:
    scene.obscurance.live_preview = True
    scene.frame_set(FRAMES[0] - 1)
    assert PREVIEW.status.startswith("Following"), PREVIEW.status
    try:
        yield
    finally:
        scene.obscurance.live_preview = False


@contextmanager
def _core_watched(seconds: list[float], counts: list[tuple[int, int, int]]) -> Iterator[None]:
    """Note how long each update of the core takes, its patches, rays, and rays with known static hits."""
    update = IncrementalBake.update

    def watched(self: IncrementalBake, *args: object, **kw: object) -> object:
        began = time.perf_counter()
        found = update(self, *args, **kw)
        seconds.append(time.perf_counter() - began)
        counts.append((found.patches, found.rays, found.cached))
        return found

    IncrementalBake.update = watched
    try:
        yield
    finally:
        IncrementalBake.update = update


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
