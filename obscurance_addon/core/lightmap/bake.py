"""One bake of obscurances into a lightmap."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..light import AmbientLight
from ..monitor import Monitor
from ..obscurance import precision_warnings, white_warnings
from ..scene import LUMINANCE, Patches, Surfaces, mean_reflectance, scattering_mean, surface_sums
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, EmbreeIntersector, Intersector, Rooms, build_scene
from .adaptive import AdaptiveTexels
from .estimation import TexelCounts, bands_at_once, estimate_pages, finish_pages, texel_settings
from .layout import AtlasLayout
from .obscurances import TexelTracer, TexelValues
from .progress import TexelProgress
from .settings import LightmapSettings
from .texels import Texels


@dataclass(frozen=True)
class Lightmap:
    """What a bake of a lightmap computed.

    Attributes
    ----------
    pages : list of ndarray, (size, size, 4) float32
        Colour, the bottom row first; alpha is 1 where there is a value, margins included, else 0.
    counts : TexelCounts
        `texels` were covered, of which `traced` cast rays of their own; the others were interpolated.
    r_ave : ndarray, (3,) float64
    rmse : ndarray, (3,) float64
        Estimated root mean square error of the colours, interpolation included.
    d_max : float
        Metres.
    rays, error_rays : int
    ambient, reflectors, reflected_share
        As of `BakedLight`.
    seconds : dict of str to float
        Per phase: build, trace, margin.
    warnings : list of str
    rooms : Rooms or None
        Who is in which room.
    """

    pages: list[np.ndarray]
    counts: TexelCounts
    r_ave: np.ndarray
    rmse: np.ndarray
    d_max: float
    rays: int
    error_rays: int
    ambient: AmbientLight | None = None
    reflectors: int = 0
    reflected_share: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    rooms: Rooms | None = None

    @property
    def traced(self) -> int:
        """Texels that cast rays of their own."""
        return self.counts.traced

    @property
    def use(self) -> float:
        """Share of the pages that is covered."""
        return self.counts.texels / sum(page[..., 0].size for page in self.pages)


def bake_lightmap(
    surfaces: Surfaces,
    patches: Patches,
    layout: AtlasLayout,
    settings: BakeSettings,
    lightmap: LightmapSettings,
    *,
    white: bool = True,
    patch_reflectance: np.ndarray | None = None,
    patch_opacity: np.ndarray | None = None,
    monitor: Monitor | None = None,
    intersector: Callable[..., Intersector] = EmbreeIntersector,
    block_rays: int = BLOCK_RAYS,
) -> Lightmap:
    """Compute the obscurances of texels among surfaces.

    Parameters
    ----------
    surfaces : Surfaces
        All that rays can hit, what is baked included.
    patches : Patches
        The faces to bake, whole.
    layout : AtlasLayout
    settings : BakeSettings
        `rays` are for each texel.
    lightmap : LightmapSettings
    white : bool
        An open texel is white, as of `Obscurances.white`; else it has the value of the paper (W).
    patch_reflectance, patch_opacity : ndarray, (f, 3) and (f,) float64, optional
        As for `bake_obscurances`.
    monitor, intersector, block_rays
        As for `bake_obscurances`.

    Raises
    ------
    GeometryError
        When there is nothing to bake.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    began = time.perf_counter()
    scene = build_scene(surfaces, patches, settings, monitor, intersector)
    triangles = layout.triangles(lightmap.size, scene.normalisation)
    built = time.perf_counter()
    face_area = scene.traced.cells.area * scene.normalisation.scale**2
    scattering = scattering_mean(surface_sums(surfaces)[4:])
    is_white_coloured = white and settings.use_bleeding
    is_open_white = white or not settings.use_bleeding
    guess = np.ones(3) if is_open_white else mean_reflectance(surfaces, face_area, np.ones(len(patches)), None)
    at_once, settings = bands_at_once(settings), texel_settings(settings, lightmap, triangles.texels())
    progress = TexelProgress(monitor, settings.rays)
    reference = scattering @ LUMINANCE if is_white_coloured else None
    as_grey = np.full(3, not settings.use_bleeding)
    tracer = TexelTracer(scene.traced, settings, as_grey, progress.cast, block_rays, reference, guess)
    estimator = _Obscurances(TexelObscurances(tracer, guess, lightmap), guess)
    monitor.phase("trace", int(triangles.texels()))
    pages, counts = estimate_pages(triangles, layout.pages, len(patches), lightmap, estimator, progress, at_once)
    traced = time.perf_counter()
    r_ave = mean_reflectance(surfaces, face_area, counts.exposed(), patch_reflectance, patch_opacity)
    if not is_open_white:
        estimator.open_value = r_ave
    finished = finish_pages(pages, estimator, lightmap, monitor)
    return Lightmap(
        pages=finished,
        counts=counts,
        r_ave=r_ave,
        rmse=counts.rmse(estimator.finish),
        d_max=scene.d_max,
        rays=counts.rays,
        error_rays=counts.error_rays,
        seconds={"build": built - began, "trace": traced - built, "margin": time.perf_counter() - traced},
        warnings=precision_warnings(scene) + (white_warnings(scattering) if is_white_coloured else []),
        rooms=scene.rooms,
    )


class TexelObscurances:
    """Obscurances of bands of texels, traced or interpolated.

    Parameters
    ----------
    tracer : TexelTracer
    open_value : ndarray, (3,)
        About what an open texel has.
    lightmap : LightmapSettings
    """

    def __init__(self, tracer: TexelTracer, open_value: np.ndarray, lightmap: LightmapSettings) -> None:
        self.tracer = tracer
        self._adaptive = AdaptiveTexels(tracer, open_value, lightmap.error_bound) if lightmap.adaptive else None

    def estimate(self, texels: Texels, n: int, rows: tuple[int, int]) -> TexelValues:
        """As of `TexelEstimator`."""
        if self._adaptive is None:
            return self.tracer.trace(texels, np.arange(n))
        band = self._adaptive.interpolate(texels, rows)
        left = np.flatnonzero(~(band.known | band.between)[:n])
        found = self.tracer.trace(texels, left)
        band.values[left], band.valid[left] = found.values, found.valid
        interpolated = int(np.count_nonzero((band.between & ~band.known)[:n]))
        return TexelValues(band.values[:n], band.valid[:n], band.rays + found.rays, n - interpolated)


class _Obscurances:
    """Estimates obscurances; `open_value` (3,) may be a guess until the texels are finished."""

    def __init__(self, source: TexelObscurances, open_value: np.ndarray) -> None:
        self._source, self.open_value = source, open_value

    def estimate(self, texels: Texels, n: int, rows: tuple[int, int]) -> TexelValues:
        return self._source.estimate(texels, n, rows)

    def repeat(self, texels: Texels, chosen: np.ndarray, replicate: int) -> TexelValues:
        return self._source.tracer.trace(texels, chosen, replicate=replicate)

    def finish(self, values: np.ndarray) -> None:
        for column, open_value in zip(values.T, self.open_value.astype(values.dtype), strict=False):
            column += values[:, 3] * open_value

    def open_color(self) -> np.ndarray:
        return self.open_value
