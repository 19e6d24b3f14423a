"""Indirect light by every method beside a radiosity reference on the same patches, with seconds and rays."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import bpy
import numpy as np
from light_scene import RAYS, LightScene
from scenes import light_to_all_sides, open_sample, yard

from obscurance_addon.blender.jobs.job import BakeJob
from obscurance_addon.blender.reading.visibility import rendered_meshes
from obscurance_addon.core.light.records import BakedLight
from obscurance_addon.core.light.settings import LightSettings
from obscurance_addon.core.obscurance.error_metrics import energy_ratio, relative_rmse, shape_error
from obscurance_addon.core.order.output import OutputSettings
from obscurance_addon.core.settings import BakeSettings

REFERENCE_RAYS = 4096
REFLECTORS = (4, 16, 64, 256)
WALKS = (20_000, 100_000, 500_000)
SOLVER_RAYS = (16, 64, 256)
SCENES: dict[str, Callable[[], None]] = {
    "Light near a wall": lambda: open_sample("light_near_wall"),
    "The same, lamp to all sides": light_to_all_sides,
    "Cornell box": lambda: open_sample("cornell_box"),
    "Room, 4016": lambda: open_sample("room_4016"),
    "Infinite, 5508": lambda: open_sample("infinite_5508"),
    "Yard (open)": yard,
}
COST_SCENE = "room_4016"


def run(repeats: int) -> dict:
    """All scenes, and what redistribution costs a whole bake."""
    return {"scenes": [_Scene(name, make).measure(repeats) for name, make in SCENES.items()], "cost": _cost(repeats)}


class _Scene(LightScene):
    """One scene, and its reference."""

    def __init__(self, name: str, make: Callable[[], None]) -> None:
        make()
        super().__init__()
        self.name = name
        self.last_reflectors = 0

    def measure(self, repeats: int) -> dict:
        reference = self.bake(REFERENCE_RAYS, quantity="RADIOSITY", indirect_only=True)
        self.reference = reference.radiance
        again = self.bake(REFERENCE_RAYS, seed=1, quantity="RADIOSITY", indirect_only=True).radiance
        dark = self.arrays.materials.emission.max(1) == 0.0
        self.weight = self.area * dark * reference.exposed
        direct = self.bake(quantity="DIRECT")
        rows = [self._row(label, compute, repeats) for label, compute in self._methods(direct)]
        return {
            "scene": self.name,
            "patches": len(self.arrays.patches),
            "reference_noise": relative_rmse(again, self.reference, self.weight) / 2**0.5,
            "rows": rows,
        }

    def _methods(self, direct: BakedLight) -> list[tuple[str, Callable[[], tuple[np.ndarray, int]]]]:
        """Label of each row, and what computes indirect radiance (p, 3) and the number of rays."""
        emission = {"ambient": "EMISSION", "reflectors": 0}
        nothing = np.zeros_like(direct.radiance)
        return [
            ("no indirect light", lambda: (nothing, self._rays("DIRECT"))),
            ("constant ambient (eq. 3)", lambda: self._constant(direct)),
            ("obscurances, grey (eq. 3)", lambda: self._ambient(bleeding=False, **emission)),
            ("obscurances, bleeding (eq. 4)", lambda: self._ambient(**emission)),
            ("+ received light", lambda: self._ambient(reflectors=0)),
            *((f"+ {k} reflectors", lambda k=k: self._ambient(reflectors=k)) for k in REFLECTORS),
            ("+ automatic reflectors", self._ambient),
            *((f"random walk, {n:,} particles", lambda n=n: self.walk(n)) for n in WALKS),
            *((f"radiosity, {n} rays a patch", lambda n=n: self._solver(n)) for n in SOLVER_RAYS),
        ]

    def _row(self, label: str, compute: Callable[[], tuple[np.ndarray, int]], repeats: int) -> dict:
        seconds = []
        for _ in range(repeats):
            began = time.perf_counter()
            radiance, rays = compute()
            seconds.append(time.perf_counter() - began)
        return {
            "method": label,
            "rmse": relative_rmse(radiance, self.reference, self.weight),
            "shape": shape_error(radiance, self.reference, self.weight),
            "energy": energy_ratio(radiance, self.reference, self.weight),
            "seconds": seconds,
            "rays": rays,
            "reflectors": self.last_reflectors if "reflectors" in label else None,
        }

    def _rays(self, quantity: str) -> int:
        baked = self.bake(quantity=quantity)
        return baked.rays + baked.error_rays

    def _constant(self, direct: BakedLight) -> tuple[np.ndarray, int]:
        """R I_A with the same I_A everywhere; its cost is that of direct light."""
        rays = self._rays("DIRECT")
        emitted = self.arrays.materials.emission.T @ self.area + sum(
            lamp.flux() for lamp in self.snapshot.sources.lamps
        )
        received = emitted / self.area.sum() * direct.r_ave / (1.0 - direct.r_ave)
        return self.arrays.materials.reflectance * received / np.pi, rays

    def _ambient(self, **light: object) -> tuple[np.ndarray, int]:
        baked = self.bake(quantity="AMBIENT", **light)
        self.last_reflectors = baked.reflectors
        return baked.radiance, baked.rays + baked.error_rays

    def _solver(self, rays: int) -> tuple[np.ndarray, int]:
        baked = self.bake(rays, quantity="RADIOSITY", indirect_only=True)
        return baked.radiance, baked.rays + baked.error_rays


def _cost(repeats: int) -> dict:
    """Whole bakes through the job, with 64 reflectors and with none, alternating."""
    open_sample(COST_SCENE)
    objects = rendered_meshes(bpy.context)
    seconds: dict[str, list[float]] = {"0": [], "64": [], "AUTO": []}
    for _ in range(3 * repeats + 1):
        for key, found in seconds.items():
            light = LightSettings("AMBIENT", reflectors=None if key == "AUTO" else int(key))
            began = time.perf_counter()
            report = BakeJob(bpy.context, objects, BakeSettings(RAYS), OutputSettings(), light).run()
            found.append(time.perf_counter() - began)
    kept = {key: found[1:] for key, found in seconds.items()}  # the first builds tables and caches
    ratio = statistics.median(b / a for a, b in zip(kept["0"], kept["64"], strict=True))
    return {"scene": COST_SCENE, "patches": report.patches, "seconds": kept, "ratio": ratio}
