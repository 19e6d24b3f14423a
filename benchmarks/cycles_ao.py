"""Beside Cycles' own ambient occlusion bake to colour attributes: same meshes, distance, samples and machine, one run.

Cycles bakes every face corner at the corner itself. Ours bakes the same corners as the surface around them (target
CORNER), or one value for each face (target FACE). Both use the STEP falloff, which is what Cycles computes.
"""

from __future__ import annotations

import time
from dataclasses import replace

import bpy
import numpy as np
from scenes import empty_scene, many_objects, select_only, suzanne_over_plane

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.core.order.output import OutputSettings
from obscurance_addon.core.settings import BakeSettings

SAMPLES = 64
CYCLES_LAYER = "Cycles AO"
DISTANCE = 0.5  # metres; Suzanne is 2.7 m wide


def run(repeats: int) -> list[dict]:
    """One large mesh, and 100 separate small ones."""
    return [_compare("126k-face mesh", suzanne_over_plane, repeats), _compare("100 objects", many_objects, repeats)]


def _compare(name: str, make, repeats: int) -> dict:
    empty_scene()
    objects = make()
    _prepare_cycles(objects)
    settings = BakeSettings(rays=SAMPLES, distance=DISTANCE, falloff="STEP", use_bleeding=False)
    entry = {
        "noise": _noise(objects, settings),
        "scene": name,
        "objects": len(objects),
        "faces": sum(len(ob.data.polygons) for ob in objects),
        "corners": sum(len(ob.data.loops) for ob in objects),
        "samples": SAMPLES,
        "seconds_cycles": [],
        "seconds_face": [],
        "seconds_corner": [],
    }
    for _ in range(repeats):
        for ob in objects:
            ob.data.attributes.active_color_name = CYCLES_LAYER
        began = time.perf_counter()
        bpy.ops.object.bake(type="AO", target="VERTEX_COLORS")
        entry["seconds_cycles"].append(time.perf_counter() - began)
        for target in ("FACE", "CORNER"):
            began = time.perf_counter()
            BakeJob(bpy.context, objects, settings, OutputSettings(target=target)).run()
            entry[f"seconds_{target.lower()}"].append(time.perf_counter() - began)
    return entry


def _noise(objects: list[bpy.types.Object], settings: BakeSettings) -> dict:
    """Random error of one bake, as the RMS difference between two with different seeds, over the square root of 2.

    Cycles' values are averaged over the corners of each face first, so that both say something about faces.
    """
    faces = {"cycles": [], "face": []}
    for seed in (1, 2):
        bpy.context.scene.cycles.seed = seed
        bpy.ops.object.bake(type="AO", target="VERTEX_COLORS")
        faces["cycles"].append(np.concatenate([_face_means(ob.data) for ob in objects]))
        BakeJob(bpy.context, objects, replace(settings, seed=seed), OutputSettings(corner_copy=False)).run()
        faces["face"].append(np.concatenate([_values(ob.data, "Obscurance") for ob in objects]))
    return {key: float(np.sqrt(np.mean((a - b) ** 2) / 2.0)) for key, (a, b) in faces.items()}


def _values(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    data = mesh.attributes[name].data
    rgba = np.empty(len(data) * 4, np.float32)
    data.foreach_get("color", rgba)
    return rgba[::4]


def _face_means(mesh: bpy.types.Mesh) -> np.ndarray:
    size = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", size)
    return np.add.reduceat(_values(mesh, CYCLES_LAYER), np.cumsum(size) - size) / size


def _prepare_cycles(objects: list[bpy.types.Object]) -> None:
    """Give each mesh a colour attribute to bake to, and Cycles the same distance and samples on the processor."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.world = bpy.data.worlds.new("World")
    scene.world.light_settings.distance = DISTANCE
    for ob in objects:
        ob.data.color_attributes.new(CYCLES_LAYER, "FLOAT_COLOR", "CORNER")
        ob.data.attributes.active_color_name = CYCLES_LAYER
        ob.data.materials.append(bpy.data.materials.get("White") or bpy.data.materials.new("White"))
    select_only(objects)
