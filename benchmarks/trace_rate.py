"""Rays per second of tracing and weighing, beside bare embreex on the same rays and threads."""

from __future__ import annotations

import dataclasses
import time
from concurrent.futures import ThreadPoolExecutor

import bpy
import numpy as np
from scenes import empty_scene, suzanne_over_plane

from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.core.obscurance.estimator import gather_obscurances
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.output import Target
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.tracing.intersector import Hits


class _Recorder:
    """Keeps the rays of every block that the estimator casts, and answers them."""

    def __init__(self, tracer: EmbreeIntersector) -> None:
        self._tracer = tracer
        self.blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def intersect(self, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> Hits:
        self.blocks.append((origins.copy(), directions.copy(), limits.copy()))
        return self._tracer.intersect(origins, directions, limits)


def run(repeats: int) -> list[dict]:
    """Trace the same rays both ways, alternating; one entry with and one without bleeding."""
    return [_compare(repeats, use_bleeding) for use_bleeding in (True, False)]


def _compare(repeats: int, use_bleeding: bool) -> dict:
    empty_scene()
    arrays = prepare_arrays(snapshot_scene(bpy.context, suzanne_over_plane()), Target.FACE)
    settings = BakeSettings(rays=64, use_bleeding=use_bleeding)
    scene = build_scene(arrays.surfaces, arrays.patches, settings).traced
    recorder = _Recorder(scene.intersector)
    recorded = gather_obscurances(dataclasses.replace(scene, intersector=recorder), arrays.patches.ids, settings)
    embree = scene.intersector.embreex_scene

    def bare(block: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        origins, directions, limits = block
        embree.run(origins, directions, dists=limits.copy(), output=True)

    ours, theirs = [], []
    for _ in range(repeats):
        began = time.perf_counter()
        gather_obscurances(scene, arrays.patches.ids, settings)
        ours.append(time.perf_counter() - began)
        began = time.perf_counter()
        with ThreadPoolExecutor(settings.thread_count()) as pool:
            for _ in pool.map(bare, recorder.blocks):
                pass
        theirs.append(time.perf_counter() - began)
    return {
        "bleeding": use_bleeding,
        "faces": len(arrays.patches),
        "rays": recorded.rays,
        "threads": settings.thread_count(),
        "seconds": ours,
        "seconds_bare": theirs,
    }
