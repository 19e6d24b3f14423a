"""A whole bake, from extraction to the attributes written, beside the time it traces."""

from __future__ import annotations

import time

import bpy
from scenes import empty_scene, suzanne_over_plane

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import OutputSettings, Target
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.embree import fill_scene


def run(repeats: int) -> list[dict]:
    """Bake Suzanne over a plane several times."""
    empty_scene()
    objects = suzanne_over_plane()
    fill = _fill_seconds(objects)
    bakes = []
    for _ in range(repeats):
        began = time.perf_counter()
        report = BakeJob(bpy.context, objects, BakeSettings(rays=64), OutputSettings()).run()
        bakes.append({"seconds": time.perf_counter() - began, "phases": report.seconds})
    return [{"faces": report.patches, "rays": report.rays, "fill_seconds": fill, "bakes": bakes}]


def _fill_seconds(objects: list[bpy.types.Object]) -> float:
    """Time that embreex takes to copy the triangles into its buffers, which no caller can shorten."""
    surfaces = prepare_arrays(snapshot_scene(bpy.context, objects), Target.FACE).surfaces
    began = time.perf_counter()
    fill_scene(surfaces.vertices, surfaces.triangles)
    return time.perf_counter() - began
