"""Lightmaps: rays per second beside bare embreex, error and time beside Cycles' bake, unwrapping, and memory.

Errors need no reference of infinitely many rays. Two bakes with different seeds are independent, so that half the mean
square of their difference is the variance of one, and of a value v and two references r, s with seeds of their own the
mean of (v - r)(v - s) is the mean square error of v, free of the references' noise.
"""

from __future__ import annotations

import resource
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import bpy
import numpy as np
from scenes import empty_scene, select_only, solids_on_floor
from trace_rate import _Recorder

from obscurance_addon.blender.jobs.job import TRACERS, BakeJob
from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.core.lightmap.bake import bake_lightmap
from obscurance_addon.core.lightmap.obscurances import TexelTracer
from obscurance_addon.core.lightmap.settings import LightmapSettings, UvMode
from obscurance_addon.core.lightmap.texels import covered_texels
from obscurance_addon.core.order.arrays import prepare_arrays
from obscurance_addon.core.order.atlas_layout import lay_out
from obscurance_addon.core.order.output import ImageFormat, OutputSettings, Target
from obscurance_addon.core.order.report import BakeReport
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.tracing.embree import EmbreeIntersector
from obscurance_addon.core.tracing.samples import BLOCK_RAYS

SOLIDS, MANY_SOLIDS = 9, 300
DISTANCE = 2.0  # metres; the solids stand 3 m apart
UNWRAP_SIZE, MANY_SIZE = 1024, 2048  # 300 solids are thousands of charts
UV_MAP = "Obscurance"

TRACED = ((512, 64, True), (512, 64, False), (512, 16, True), (1024, 64, True))  # page, rays a texel, with bleeding

# Page size: samples of Cycles, rays of ours, and rays of each of the two references. All together take a quarter of an
# hour.
COMPARED = {
    512: ((16, 64, 256, 1024), (4, 16, 64, 256), 2048),
    1024: ((16, 64), (4, 16, 64, 256), 512),
    2048: ((64,), (16, 64, 128), 128),
}
ERROR_BOUNDS = (0.01, 0.02)  # the default first
SEEDS, REFERENCE_SEEDS = (1, 2), (3, 4)
VALID_RAYS = 64  # that find no inside of a solid in texels that are compared

MEMORY_RAYS = 16


def run(repeats: int) -> dict:
    """Everything but memory, on one scene with one UV map."""
    unwrapped = [_unwrapped(SOLIDS, UNWRAP_SIZE), _unwrapped(MANY_SOLIDS, MANY_SIZE)]
    objects = _scene(SOLIDS)
    _unwrap(objects)
    traced = [_trace_rate(objects, *how, repeats) for how in TRACED]
    compared = [_Comparison(objects, size).measure(*counts) for size, counts in COMPARED.items()]
    return {"trace": traced, "compared": compared, "unwrapped": unwrapped}


def memory(size: int, adaptive: int) -> dict:
    """One bake of a large page into a half-float EXR file; peak of this process, which does nothing else."""
    objects = _scene(SOLIDS)
    _unwrap(objects)
    before = _peak()
    with tempfile.TemporaryDirectory() as folder:
        output = OutputSettings(target="LIGHTMAP", image_path=str(Path(folder, "lightmap.exr")))
        began = time.perf_counter()
        report = BakeJob(
            bpy.context, objects, BakeSettings(rays=MEMORY_RAYS), output, lightmap=_kept(size, adaptive=bool(adaptive))
        ).run()
        return {
            "size": size,
            "adaptive": bool(adaptive),
            "rays_per_texel": MEMORY_RAYS,
            "texels": report.patches,
            "rays": report.rays,
            "seconds": time.perf_counter() - began,
            "peak_bytes": _peak(),
            "peak_bytes_before": before,
        }


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _scene(solids: int) -> list[bpy.types.Object]:
    empty_scene()
    objects = solids_on_floor(solids)
    material = bpy.data.materials.new("Grey")
    material.use_nodes = True
    for ob in objects:
        ob.data.materials.append(material)
    return objects


def _kept(size: int, **options: object) -> LightmapSettings:
    return LightmapSettings(size=size, uv_mode=UvMode.KEEP, uv_map=UV_MAP, margin=0, **options)


def _unwrap(objects: list[bpy.types.Object]) -> None:
    """Give the objects the UV map that all bakes share."""
    lightmap = LightmapSettings(size=UNWRAP_SIZE)
    BakeJob(bpy.context, objects, BakeSettings(rays=1), OutputSettings(target="LIGHTMAP"), lightmap=lightmap).run()
    for ob in objects:
        layer = ob.data.uv_layers[UV_MAP]
        layer.active = layer.active_render = True


def _unwrapped(solids: int, size: int) -> dict:
    """Seconds of a bake with the usual settings but that of the unwrapper, of which xatlas takes its part."""
    objects = _scene(solids)
    output, lightmap = OutputSettings(target="LIGHTMAP"), LightmapSettings(size=size, unwrapper="XATLAS")
    report = BakeJob(bpy.context, objects, BakeSettings(), output, lightmap=lightmap).run()
    faces = sum(len(ob.data.polygons) for ob in objects)
    return {"objects": len(objects), "faces": faces, "size": size, "use": report.lightmap.use, "phases": report.seconds}


def _trace_rate(objects: list[bpy.types.Object], size: int, rays: int, use_bleeding: bool, repeats: int) -> dict:
    """The trace phase of a plain bake, and bare embreex on the rays of that phase."""
    settings, lightmap = BakeSettings(rays=rays, use_bleeding=use_bleeding), _kept(size, adaptive=False)
    arrays, layout = _read(objects, lightmap)
    arguments = (arrays.surfaces, arrays.patches, layout, settings, lightmap)
    tracers, recorders = [], []

    def recording(*build: object) -> _Recorder:
        tracers.append(EmbreeIntersector(*build))
        recorders.append(_Recorder(tracers[-1]))
        return recorders[-1]

    bake_lightmap(*arguments, intersector=recording)
    embree, blocks = tracers[0].embreex_scene, recorders[0].blocks

    def bare(block: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        origins, directions, limits = block
        embree.run(origins, directions, dists=limits.copy(), output=True)

    normalisation = build_scene(arrays.surfaces, arrays.patches, settings)[1]
    ours, theirs, finding = [], [], []
    for _ in range(repeats):
        began = time.perf_counter()
        texels = covered_texels(layout.triangles(size, normalisation), size, 0, (0, size))
        finding.append(time.perf_counter() - began)
        ours.append(bake_lightmap(*arguments).seconds["trace"])
        began = time.perf_counter()
        with ThreadPoolExecutor(settings.thread_count()) as pool:
            for _ in pool.map(bare, blocks):
                pass
        theirs.append(time.perf_counter() - began)
    return {
        "size": size,
        "texels": len(texels),
        "rays_per_texel": rays,
        "bleeding": use_bleeding,
        "rays": sum(len(origins) for origins, _, _ in blocks),
        "threads": settings.thread_count(),
        "seconds": ours,
        "seconds_bare": theirs,
        "seconds_finding": finding,
    }


def _read(objects: list[bpy.types.Object], lightmap: LightmapSettings) -> tuple:
    """What a bake reads of the scene, and where the faces lie."""
    snapshot = snapshot_scene(bpy.context, objects, lightmap=lightmap)
    arrays = prepare_arrays(snapshot, Target.FACE)
    return arrays, lay_out(snapshot, arrays.ranges, lightmap, 1.0, lambda: None, lambda _share: None).layout


class _Comparison:
    """Bakes by Cycles and by ours into images of one size, over the same UV map."""

    def __init__(self, objects: list[bpy.types.Object], size: int) -> None:
        self._objects, self._size = objects, size
        self._image = bpy.data.images.new("Cycles AO", size, size, alpha=True, float_buffer=True, is_data=True)
        _prepare_cycles(objects, self._image)
        self._texels = np.arange(size**2)
        reached = self._cycles(1, 0)[0][:, 3] > 0.0  # loads kernels, too
        texels, in_one_face, covered = _comparable_texels(objects, size)
        kept = reached[texels]
        self._texels, self._in_one_face = texels[kept], in_one_face[kept]
        self._covered = {"ours": covered, "cycles": int(np.count_nonzero(reached))}

    def measure(self, samples: tuple[int, ...], rays: tuple[int, ...], reference_rays: int) -> dict:
        """Error and time of every method and count, each baked with two seeds; references first."""
        self._reference = [self._ours(reference_rays, seed)[0] for seed in REFERENCE_SEEDS]
        rows = [self._cycles_row(count) for count in samples]
        rows += [self._row(None, count) for count in rays]
        rows += [self._row(bound, count) for bound in ERROR_BOUNDS for count in rays]
        return {
            "size": self._size,
            "objects": len(self._objects),
            "covered": self._covered,
            "compared": len(self._texels),
            "reference_rays": reference_rays,
            "reference_noise": _random_error(*self._reference) / 2**0.5,
            "in_one_face": int(np.count_nonzero(self._in_one_face)),
            **self._differences,
            "rows": rows,
        }

    def _cycles_row(self, samples: int) -> dict:
        (one, seconds), (other, more) = (self._cycles(samples, seed) for seed in SEEDS)
        one, other = one[:, 0], other[:, 0]
        differences = one - self._reference[0], other - self._reference[1]
        self._differences = {  # those of the most samples stay
            "difference": _rms_product(*differences),
            "difference_in_one_face": _rms_product(*(of[self._in_one_face] for of in differences)),
        }
        return {
            "method": "Cycles",
            "count": samples,
            "seconds": [seconds, more],
            "rmse": _random_error(one, other),
            "beside_ours": self._error([one, other]),
        }

    def _row(self, error_bound: float | None, rays: int) -> dict:
        values, seconds, reports = zip(*(self._ours(rays, seed, error_bound) for seed in SEEDS), strict=True)
        return {
            "method": "plain" if error_bound is None else "adaptive",
            "error_bound": error_bound,
            "count": rays,
            "seconds": seconds,
            "rmse": self._error(values),
            "rays": reports[0].rays,
            "traced": reports[0].lightmap.traced_texels / reports[0].patches,
        }

    def _error(self, values: list[np.ndarray]) -> float:
        one, other = self._reference
        return float(np.sqrt(np.mean([_rms_product(value - one, value - other) ** 2 for value in values])))

    def _ours(self, rays: int, seed: int, error_bound: float | None = None) -> tuple[np.ndarray, float, BakeReport]:
        adaptive = {"adaptive": False} if error_bound is None else {"error_bound": error_bound}
        settings = BakeSettings(rays=rays, distance=DISTANCE, falloff="STEP", use_bleeding=False, seed=seed)
        output = OutputSettings(target="LIGHTMAP", attribute_name=UV_MAP, image_format=ImageFormat.EXR_FULL)
        TRACERS.clear()  # Cycles builds its tree anew as well
        began = time.perf_counter()
        job = BakeJob(bpy.context, self._objects, settings, output, lightmap=_kept(self._size, **adaptive))
        report = job.run()
        seconds = time.perf_counter() - began
        return self._pixels(bpy.data.images[report.lightmap.image])[:, 0], seconds, report

    def _cycles(self, samples: int, seed: int) -> tuple[np.ndarray, float]:
        cycles = bpy.context.scene.cycles
        cycles.samples, cycles.seed = samples, seed
        began = time.perf_counter()
        bpy.ops.object.bake(type="AO", target="IMAGE_TEXTURES", margin=0, use_clear=True)
        seconds = time.perf_counter() - began
        return self._pixels(self._image), seconds

    def _pixels(self, image: bpy.types.Image) -> np.ndarray:
        """Pixels (k, 4) of the texels that are compared."""
        pixels = np.empty(self._size**2 * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(-1, 4)[self._texels].astype(np.float64)


def _comparable_texels(objects: list[bpy.types.Object], size: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Texels wholly in a chart and outside of solids, which of them are in one triangle; number of all covered ones."""
    lightmap, settings = _kept(size), BakeSettings(rays=VALID_RAYS, distance=DISTANCE, use_bleeding=False)
    arrays, layout = _read(objects, lightmap)
    scene, normalisation, *_ = build_scene(arrays.surfaces, arrays.patches, settings)
    texels = covered_texels(layout.triangles(size, normalisation), size, 0, (0, size))
    tracer = TexelTracer(scene, settings, np.ones(3, bool), lambda _rays: None, BLOCK_RAYS)
    whole = np.flatnonzero(texels.cover >= 1.0 - 1e-6)
    whole = whole[tracer.trace(texels, whole).valid >= 1.0 - 1e-6]
    return texels.index[whole], np.isin(whole, texels.whole.patch), len(texels)


def _random_error(one: np.ndarray, other: np.ndarray) -> float:
    """Of a bake, from two with different seeds."""
    return float(np.sqrt(np.mean((one - other) ** 2) / 2.0))


def _rms_product(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(max(np.mean(one * other), 0.0)))


def _prepare_cycles(objects: list[bpy.types.Object], image: bpy.types.Image) -> None:
    """Give Cycles the image to bake to, and the same distance on the processor."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.world = scene.world or bpy.data.worlds.new("World")
    scene.world.light_settings.distance = DISTANCE
    nodes = objects[0].data.materials[0].node_tree.nodes
    node = nodes.get("Bake") or nodes.new("ShaderNodeTexImage")
    node.name, node.image = "Bake", image
    nodes.active = node
    select_only(objects)
