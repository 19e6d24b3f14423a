"""Cost and memory as the scene grows to 1,000,000 faces, or the rays per face to 4,096; one process for each."""

from __future__ import annotations

import resource

import bpy
from scenes import TERRAIN_DISTANCE, bumpy_terrain, empty_scene

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.core.order.output import OutputSettings
from obscurance_addon.core.settings import BakeSettings


def run(faces: int, rays: int) -> dict:
    """Bake one terrain twice; the first bake pays for warming up."""
    empty_scene()
    terrain = bumpy_terrain(faces)
    before = _peak()
    settings = BakeSettings(rays=rays, distance=TERRAIN_DISTANCE)
    reports = [BakeJob(bpy.context, [terrain], settings, OutputSettings()).run() for _ in range(2)]
    return {
        "faces": reports[0].patches,
        "rays": reports[0].rays,
        "rays_per_face": rays,
        "phases": [report.seconds for report in reports],
        "peak_bytes": _peak(),
        "peak_bytes_before": before,
    }


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
