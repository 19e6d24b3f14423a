"""One bake of light into a lightmap: faces light each other, texels receive.

What surfaces pass on, and the ambient light, is found on whole faces, as in `bake_light`; each texel then gathers its
own direct light, obscurances, and what the faces pass on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..light import (
    LightSettings,
    LightSources,
    LitFaces,
    LitScene,
    PatchMaterials,
    Quantity,
    check_size,
    gather_direct_light,
    gather_radiosity,
    light_up_faces,
    lit_scene,
    redistribute,
)
from ..monitor import Monitor
from ..obscurance import precision_warnings
from ..scene import Patches, Surfaces, join_cells
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, EmbreeIntersector, Intersector, build_scene
from .bake import Lightmap, TexelObscurances
from .estimation import bands_at_once, estimate_pages, finish_pages, texel_settings
from .layout import AtlasLayout
from .obscurances import TexelTracer, TexelValues, texel_triangles
from .progress import TexelProgress
from .settings import LightmapSettings
from .texels import Texels

MaterialsAt = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def bake_light_map(
    surfaces: Surfaces,
    patches: Patches,
    others: Patches,
    materials: PatchMaterials,
    sources: LightSources,
    layout: AtlasLayout,
    settings: BakeSettings,
    light: LightSettings,
    lightmap: LightmapSettings,
    *,
    factor: float = 1.0,
    materials_at: MaterialsAt | None = None,
    monitor: Monitor | None = None,
    intersector: Callable[..., Intersector] = EmbreeIntersector,
    block_rays: int = BLOCK_RAYS,
) -> Lightmap:
    """Compute the light that leaves texels, as radiance in W/(m^2 sr).

    Parameters
    ----------
    surfaces, patches, others, materials, sources, settings, light
        As for `bake_light`, with whole faces as patches; `rays` are for each texel.
    layout : AtlasLayout
    lightmap : LightmapSettings
        `adaptive` is for the obscurances: direct light has shadows, which no sparse texel could foresee.
    factor : float
        To brighten the light by.
    materials_at : callable, optional
        Reflectance and emission (m, 3) of triangles (m,) of the layout at places (m, 2) in texels of their page; by
        default those of the whole face.
    monitor, intersector, block_rays
        As for `bake_obscurances`.

    Raises
    ------
    GeometryError
        When there is nothing to bake, or too much for radiosity.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    n_faces = len(patches)
    if light.quantity is Quantity.RADIOSITY:
        check_size(n_faces + len(others), (n_faces + len(others)) * settings.rays)
    began = time.perf_counter()
    bare = build_scene(surfaces, patches, settings, monitor, intersector, whole=True)
    triangles = layout.triangles(lightmap.size, bare.normalisation)
    for_texels = texel_settings(settings, lightmap, triangles.texels())
    settings = replace(for_texels, threads=settings.threads)
    scene = lit_scene(bare, surfaces, patches.with_others(others), sources, settings)
    built = time.perf_counter()
    scale = bare.normalisation.scale
    faces = light_up_faces(scene, surfaces, n_faces, materials, sources, scale, settings, light, monitor)
    lit = time.perf_counter()
    progress = TexelProgress(monitor, settings.rays * (1 + len(scene.sources)))
    as_grey = _channels_as_grey(surfaces, settings)
    estimator = _TexelLight(
        faces,
        TexelTracer(
            bare.traced,
            for_texels,
            as_grey,
            progress.cast,
            block_rays,
            open_value=np.where(as_grey, 1.0, faces.r_ave),
        ),
        light,
        lightmap,
        factor / np.pi,
        materials_at,
    )
    monitor.phase("trace", int(triangles.texels()))
    at_once = bands_at_once(settings)
    pages, counts = estimate_pages(triangles, layout.pages, n_faces, lightmap, estimator, progress, at_once)
    gathered = time.perf_counter()
    finished = finish_pages(pages, estimator, lightmap, monitor)
    return Lightmap(
        pages=finished,
        counts=counts,
        r_ave=faces.r_ave,
        rmse=counts.rmse(estimator.finish),
        d_max=bare.d_max,
        rays=faces.rays + counts.rays,
        error_rays=faces.error_rays + counts.error_rays,
        ambient=faces.ambient[0] if faces.ambient else None,
        reflectors=len(faces.reflectors) if faces.reflectors else 0,
        reflected_share=faces.reflectors.light_share if faces.reflectors else 0.0,
        seconds={
            "build": built - began,
            "light": lit - built,
            "trace": gathered - lit,
            "margin": time.perf_counter() - gathered,
        },
        warnings=precision_warnings(bare) + faces.warnings,
        rooms=bare.rooms,
    )


def _channels_as_grey(surfaces: Surfaces, settings: BakeSettings) -> np.ndarray:
    """(3,) bool: channels in which W is taken without colour, because there is none to relate it to."""
    return ~(surfaces.reflectance > 0.0).any(0) if settings.use_bleeding else np.ones(3, bool)


class _TexelLight:
    """Estimates the light of texels; values are radiance at once, times `factor` x pi."""

    def __init__(
        self,
        faces: LitFaces,
        tracer: TexelTracer,
        light: LightSettings,
        lightmap: LightmapSettings,
        factor: float,
        materials_at: MaterialsAt | None,
    ) -> None:
        self._materials_at = materials_at
        self._faces, self._tracer, self._factor = faces, tracer, factor
        has_colour = tracer.settings.use_bleeding & (faces.r_ave > 0.0)
        self._open = np.where(has_colour, faces.r_ave, 1.0)
        self._obscurances = TexelObscurances(tracer, self._open, lightmap) if faces.ambient else None
        self._with_direct = light.quantity is not Quantity.AMBIENT
        self._with_emission = light.quantity is Quantity.COMBINED
        if light.quantity is Quantity.RADIOSITY:
            self._with_direct = self._with_emission = not light.indirect_only

    def estimate(self, texels: Texels, n: int, rows: tuple[int, int]) -> TexelValues:
        """As of `TexelEstimator`; `traced` are the texels that cast rays for obscurances, if there are any."""
        obscurances = self._obscurances.estimate(texels, n, rows) if self._obscurances else None
        return self._radiance(texels, np.arange(n), obscurances, 0)

    def repeat(self, texels: Texels, chosen: np.ndarray, replicate: int) -> TexelValues:
        obscurances = self._tracer.trace(texels, chosen, replicate=replicate) if self._obscurances else None
        return self._radiance(texels, chosen, obscurances, replicate)

    def finish(self, values: np.ndarray) -> None:
        """Nothing is left to do."""

    def open_color(self) -> np.ndarray:
        return np.zeros(3)

    def _radiance(
        self, texels: Texels, chosen: np.ndarray, obscurances: TexelValues | None, replicate: int
    ) -> TexelValues:
        """Radiance of texels (m,), from obscurances where there are some."""
        faces = self._faces
        irradiance = np.zeros((len(chosen), 3))
        valid, rays, traced = None, 0, len(chosen)
        if obscurances is not None:
            valid, rays, traced = obscurances.valid, obscurances.rays, obscurances.traced
            white = (obscurances.values[:, :3] + obscurances.values[:, 3:] * self._open) / self._open
            irradiance += white * faces.ambient[min(replicate, 1)].irradiance
        if self._with_direct or valid is None:
            direct, valid, cast = self._direct(texels, chosen, valid, replicate)
            rays += cast
            if self._with_direct:
                irradiance += direct
        if faces.reflectors:
            passed_on, cast = self._passed_on(texels, chosen, valid, replicate)
            irradiance += passed_on
            rays += cast
        if faces.radiosity is not None:
            received, cast = self._from_radiosity(texels, chosen, valid, replicate)
            irradiance += received
            rays += cast
        reflectance, emission = self._materials(texels, chosen)
        radiosity = reflectance * irradiance
        if self._with_emission:
            radiosity += emission
        found = np.zeros((len(chosen), 4))
        found[:, :3] = self._factor * radiosity
        found[valid <= 0.0] = 0.0
        return TexelValues(found, valid, rays, traced)

    def _materials(self, texels: Texels, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reflectance and emission (m, 3) of texels."""
        if self._materials_at is None:
            face = texels.face[chosen]
            return self._faces.reflectance[face], self._faces.emission[face]
        return self._materials_at(texels.triangle[chosen], texels.centres(chosen))

    def _direct(
        self, texels: Texels, chosen: np.ndarray, valid: np.ndarray | None, replicate: int
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Irradiance (m, 3) of lamps and such, shares (m,) outside of solids, and the number of rays cast."""
        whole, parts = (
            gather_direct_light(
                scene,
                np.full(len(chosen), self._tracer.settings.rays),
                self._tracer.settings,
                valid=valid,
                with_openness=False,
                replicate=replicate,
                progress=self._tracer.progress,
                block_rays=self._tracer.block_rays,
            )
            for scene in self._scenes(texels, chosen)
        )
        if valid is None:
            valid = whole.valid + parts.valid
        return whole.irradiance + parts.irradiance, valid, whole.rays + parts.rays

    def _passed_on(
        self, texels: Texels, chosen: np.ndarray, valid: np.ndarray, replicate: int
    ) -> tuple[np.ndarray, int]:
        """What the reflectors among the faces pass on, (m, 3), and the number of rays cast."""
        faces, lit = self._faces, self._faces.lit
        cells = join_cells(faces.scene.traced.cells, texel_triangles(texels, chosen))
        n_faces, m = len(lit.unshot), len(chosen)
        found = redistribute(
            replace(
                faces.scene,
                traced=replace(
                    faces.scene.traced,
                    cells=cells,
                    rooms=faces.scene.traced.rooms_of_patches(np.append(np.arange(n_faces), texels.face[chosen])),
                ),
                ids=np.concatenate([faces.scene.ids, texels.ids[chosen]]),
            ),
            faces.reflectors,
            np.concatenate([lit.unshot_filled() if replicate else lit.unshot, np.zeros((m, 3))]),
            np.concatenate([lit.direct.valid, valid]),
            n_faces + np.arange(m),
            self._tracer.settings,
            replicate=replicate,
            progress=self._tracer.progress,
        )
        return found.irradiance, found.rays

    def _from_radiosity(
        self, texels: Texels, chosen: np.ndarray, valid: np.ndarray, replicate: int
    ) -> tuple[np.ndarray, int]:
        """What all faces radiate to texels, (m, 3), and the number of rays cast."""
        total, rays = np.zeros((len(chosen), 3)), 0
        for scene in self._scenes(texels, chosen):
            irradiance, cast = gather_radiosity(
                scene,
                self._faces.radiosity,
                np.full(len(chosen), self._tracer.settings.rays),
                self._tracer.settings,
                replicate=replicate,
                progress=self._tracer.progress,
                block_rays=self._tracer.block_rays,
            )
            total += irradiance
            rays += cast
        return total / np.where(valid > 0.0, valid, 1.0)[:, None], rays

    def _scenes(self, texels: Texels, chosen: np.ndarray) -> list[LitScene]:
        """The scene with rays leaving the parallelograms of texels, and their triangles."""
        scene = self._faces.scene
        rooms = scene.traced.rooms_of_patches(texels.face[chosen])
        return [
            replace(scene, traced=replace(scene.traced, cells=cells, rooms=rooms), ids=texels.ids[chosen])
            for cells in texels.cells_of(chosen)
        ]
