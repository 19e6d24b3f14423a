"""Direct light: what patches receive from lamps, emissive faces and the world, with shadows.

H(i) = 1/N sum_j E_j over the same sample points as the obscurances: places on the patch jointly with points on each
lamp, or with directions. Soft sources and the extent of the patch are integrated by the same four-dimensional points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..obscurance import Caster
from ..sampling import UNIT
from ..settings import BakeSettings
from ..tracing import (
    BLOCK_RAYS,
    FAR,
    LEAST_LIGHT,
    MAX_SURFACES,
    Hits,
    Passage,
    PatchSamples,
    TracedScene,
    pass_doubled_faces,
    shadowed,
)
from .emitters import EmissiveTriangles
from .lamps import Lamp, LightSource
from .visibility import light_share

SPARSE_RAYS = 4  # a patch at least, to tell how open a scene is
OPENNESS_RAYS = 1 << 15  # in all, shared out by area: one large face may be most of a scene
MAX_OPENNESS_RAYS = 4096  # of them for one patch

_HIT, _DROPPED = 3, 4  # columns of the sums over unlimited rays behind the irradiance


@dataclass(frozen=True)
class LitScene:
    """A scene with its light, ready for casting.

    Attributes
    ----------
    traced : TracedScene
        All surfaces; its cells are those of all patches that scatter light, first those to bake.
    ids : ndarray, (p,) uint32
        Stable identity of each patch.
    lamps : tuple of Lamp
    emitters : EmissiveTriangles or None
    world : ndarray, (3,)
        Constant radiance of the world, W/(m^2 sr).
    """

    traced: TracedScene
    ids: np.ndarray
    lamps: tuple[Lamp, ...]
    emitters: EmissiveTriangles | None
    world: np.ndarray

    @property
    def sources(self) -> list[LightSource]:
        """Everything that shadow rays are sent to."""
        return [*self.lamps, *([self.emitters] if self.emitters else [])]

    @property
    def shines_on_rays(self) -> bool:
        """Whether rays without a limit meet anything that shines."""
        return self.emitters is not None or bool(self.world.any())


@dataclass(frozen=True)
class DirectLight:
    """What patches receive.

    Attributes
    ----------
    irradiance : ndarray, (p, 3) float64
        W/m^2, mean over the part of each patch outside of solids; 0 where there is none.
    valid : ndarray, (p,) float64
        Share of each patch outside of solids.
    hit_share : ndarray, (p,) float64
        Share of the hemisphere, cosine weighted, in which there is any surface.
    rays : int
    unreached : list of str
        Lamps that face patches, but light none.
    """

    irradiance: np.ndarray
    valid: np.ndarray
    hit_share: np.ndarray
    rays: int
    unreached: list[str]


def gather_direct_light(
    scene: LitScene,
    per_patch: np.ndarray,
    settings: BakeSettings,
    *,
    valid: np.ndarray | None = None,
    with_openness: bool = True,
    replicate: int = 0,
    progress: Callable[[int], None] = lambda _rays: None,
    block_rays: int = BLOCK_RAYS,
) -> DirectLight:
    """Cast shadow rays to all sources, and rays without a limit to what cannot be sampled otherwise.

    Parameters
    ----------
    scene : LitScene
    per_patch : ndarray, (p,) int
        Samples for each patch and source.
    settings : BakeSettings
        Sampler, seed and threads.
    valid : ndarray, (q,) float64, q <= p, optional
        Known shares outside of solids of the first patches; partly hidden ones get more samples.
    with_openness : bool
        Cast rays to find `hit_share`, also where nothing else needs them; else it is 0 there.
    replicate : int
        0 for the bake; other numbers give independent samples.
    progress : callable
        Called from any thread with the number of rays just cast; may raise to cancel.
    block_rays : int

    Returns
    -------
    DirectLight
        Bit for bit the same for any number of threads and any block size.
    """
    cells, n_patches = scene.traced.cells, len(scene.traced.cells.area)
    every = np.arange(len(cells.patch))
    known = 0 if valid is None else len(valid)
    if known:  # few samples of a partly hidden patch count
        per_patch = np.append(per_patch[:known] * Caster.more_rays(valid), per_patch[known:])
    far_rays, openness_rays = per_patch.copy(), share_by_area(cells.area, OPENNESS_RAYS, MAX_OPENNESS_RAYS)
    if not scene.shines_on_rays:  # then they only tell what is inside of solids, and how open the scene is
        sparse = slice(None) if scene.traced.bodies is None else slice(0, known)
        far_rays[sparse] = openness_rays[sparse]
    far = _FarRays(scene, PatchSamples(cells, scene.ids, far_rays, settings, replicate, block_rays), progress)
    needed = scene.shines_on_rays or with_openness or known < n_patches
    rays = far.samples.run(every, far.cast) if needed else 0
    if (suspect := np.bincount(cells.patch, far.sums[:, _DROPPED], n_patches) > 0.0).any():
        again = np.flatnonzero(suspect[cells.patch])
        far.sums[again] = 0.0
        rays += far.samples.run(again, far.cast_thoroughly) + int(far.asked.sum())

    def per_patch_mean(sums: np.ndarray, samples: PatchSamples) -> np.ndarray:
        share = cells.weight / samples.count
        return np.stack([np.bincount(cells.patch, column * share, n_patches) for column in sums.T], -1)

    found = per_patch_mean(far.sums, far.samples)
    wide = np.flatnonzero((openness_rays > far_rays)[cells.patch] & (cells.patch < known))
    if len(wide) and with_openness:  # large patches, whose own number of rays says too little of the scene
        more = _FarRays(scene, PatchSamples(cells, scene.ids, openness_rays, settings, replicate, block_rays), progress)
        rays += more.samples.run(wide, more.cast)
        patches = np.unique(cells.patch[wide])
        found[patches, _HIT] = per_patch_mean(more.sums, more.samples)[patches, _HIT]
    exposed = np.bincount(cells.patch, cells.weight, n_patches) - found[:, _DROPPED]
    exposed[exposed < 1e-9] = 0.0
    if valid is not None:
        exposed[:known] = valid
    shadows = _ShadowRays(
        scene,
        PatchSamples(cells, scene.ids, per_patch, settings, replicate, block_rays),
        progress,
        (exposed < 1.0 - 1e-9)[cells.patch],
    )
    if scene.sources:
        rays += shadows.samples.run(every, shadows.cast, UNIT) * len(scene.sources)
    irradiance = per_patch_mean(shadows.sums, shadows.samples) + found[:, :3]
    divisor = np.where(exposed > 0.0, exposed, 1.0)
    irradiance[exposed == 0.0] = 0.0
    return DirectLight(
        irradiance=irradiance / divisor[:, None],
        valid=exposed,
        hit_share=np.clip(found[:, _HIT] / divisor, 0.0, 1.0),
        rays=rays,
        unreached=[
            source.name
            for source, tried, reached in zip(scene.sources, shadows.tried, shadows.reached, strict=True)
            if tried and not reached
        ],
    )


def share_by_area(area: np.ndarray, budget: int, most: int) -> np.ndarray:
    """Samples of each patch (p,) int64, powers of two from SPARSE_RAYS to `most`, in proportion to area (p,)."""
    share = area / max(float(area.sum()), np.finfo(float).tiny)
    return 2 ** np.floor(np.log2(np.clip(budget * share, SPARSE_RAYS, most))).astype(np.int64)


class _ShadowRays:
    """Sums per cell over rays to points on the sources; every block writes its own cells."""

    def __init__(
        self, scene: LitScene, samples: PatchSamples, progress: Callable[[int], None], partly_inside: np.ndarray
    ) -> None:
        self.scene, self.samples, self.progress = scene, samples, progress
        self.partly_inside = partly_inside  # (c,) bool: cells of patches that reach into solids
        self.sums = np.zeros((len(scene.traced.cells.patch), 3))
        self.tried = np.zeros(len(scene.sources), bool)
        self.reached = np.zeros(len(scene.sources), bool)

    def cast(self, cells: np.ndarray, samples: np.ndarray) -> None:
        """Add samples (4, m, n) of cells (m,)."""
        m, n = samples.shape[1:]
        traced = self.scene.traced
        origins = self.samples.origins(cells, samples)
        normals = np.repeat(traced.cells.frames[cells, 2, 3:], n, axis=0)
        unit = samples[2:4].reshape(2, -1).T
        may_be_inside, rooms = np.repeat(self.partly_inside[cells], n), traced.rooms_of(cells, n)
        total = np.zeros((m, 3))
        for index, source in enumerate(self.scene.sources):
            sample = source.sample(origins, normals, unit)
            cosine = np.einsum("ij,ij->i", sample.direction, normals)
            lit = np.flatnonzero((cosine > 0.0) & (sample.received > 0.0).any(1))
            if len(lit):
                self.tried[index] = True
                distance = sample.distance[lit] if source.casts_shadow else np.zeros(len(lit), np.float32)
                share = np.float32(1.0)
                if source.casts_shadow or may_be_inside[lit].any():
                    rays = origins[lit], sample.direction[lit], distance, may_be_inside[lit], _of(rooms, lit)
                    if traced.transparency is None:
                        lit = lit[~shadowed(traced, *rays)]
                    else:
                        share = light_share(traced, *rays)
                        lit, share = lit[share.any(1)], share[share.any(1)]
                if len(lit):
                    self.reached[index] = True
            irradiance = np.zeros((m * n, 3), np.float32)
            irradiance[lit] = sample.received[lit] * cosine[lit, None]
            if len(lit):
                irradiance[lit] *= share
            total += irradiance.reshape(m, n, 3).sum(1, dtype=np.float64)
            self.progress(m * n)
        self.sums[cells] += total


def _of(values: np.ndarray | None, rays: np.ndarray) -> np.ndarray | None:
    """Those of some of the rays, (m,) int."""
    return None if values is None else values[rays]


class _FarRays:
    """Sums per cell over rays without a limit."""

    def __init__(self, scene: LitScene, samples: PatchSamples, progress: Callable[[int], None]) -> None:
        self.scene, self.samples, self.progress = scene, samples, progress
        self.sums = np.zeros((len(scene.traced.cells.patch), 5))
        self.asked = np.zeros(len(self.sums), np.int64)  # rays that asked bodies, by the first cell of a block
        self._sky = np.float32(np.pi * scene.world)

    def cast_thoroughly(self, cells: np.ndarray, samples: np.ndarray) -> None:
        """As `cast`, asking each body which rays start inside of it."""
        self.cast(cells, samples, thorough=True)

    def cast(self, cells: np.ndarray, samples: np.ndarray, thorough: bool = False) -> None:
        """Add samples (5, m, n) of cells (m,)."""
        m, n = samples.shape[1:]
        traced = self.scene.traced
        origins, directions = self.samples.origins(cells, samples), self.samples.directions(cells, samples)
        hits = traced.intersector.intersect(origins, directions, np.full(len(origins), FAR, np.float32))
        pass_doubled_faces(traced, cells, n, origins, directions, FAR, hits)
        cosine = samples[4].ravel()
        rooms, known = traced.rooms_of(cells, n), None
        if thorough:
            known, cast = traced.bodies.start_inside(origins, directions, rooms)
            self.asked[cells[0]] += cast
        found, inside, stopped = self._found(hits, directions, cosine, rooms, known)
        if traced.transparency is not None:
            self._go_on(origins, directions, hits, cosine, rooms, known, (found, inside, stopped))
        if self.scene.shines_on_rays:
            self.sums[cells, :3] += found.reshape(m, n, 3).sum(1, dtype=np.float64)
        if traced.bodies is not None:
            self.sums[cells, _DROPPED] += np.count_nonzero(inside.reshape(m, n), axis=1)
        self.sums[cells, _HIT] += stopped.reshape(m, n).sum(1, dtype=np.float64)
        self.progress(m * n)

    def _found(
        self,
        hits: Hits,
        directions: np.ndarray,
        cosine: np.ndarray,
        rooms: np.ndarray | None,
        known: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What rays (n,) bring that met these hits, (n, 3); if they start in a solid; if something stops them.

        `known` (n,) bool tells of all of them whether they start in a solid, where that was asked.
        """
        traced, met = self.scene.traced, hits.triangle >= 0
        found = np.zeros((len(met), 3), np.float32)
        if self.scene.shines_on_rays:
            found += np.where(met[:, None], np.float32(0.0), self._sky)
            if self.scene.emitters is not None:
                found += self.scene.emitters.met(hits, directions, cosine)
        inside = np.zeros(len(met), bool) if known is None else known
        if known is None and traced.bodies is not None:
            inside = traced.meets_inside(directions, hits, rooms)
        return found, inside, (met & ~inside).astype(np.float32)

    def _go_on(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        hits: Hits,
        cosine: np.ndarray,
        rooms: np.ndarray | None,
        known: np.ndarray | None,
        sums: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> None:
        """Add what rays find behind transparent surfaces to what `_found` says of their first hits, `sums`."""
        traced, (found, inside, stopped) = self.scene.traced, sums
        rays = np.flatnonzero(traced.transparency.lets_through(hits.triangle) & ~inside)
        passage, light = (
            Passage(traced.intersector, origins, directions, FAR, hits, rays),
            np.ones((len(rays), 4), np.float32),
        )
        stopped[rays] = 0.0
        for _ in range(MAX_SURFACES):
            if not len(passage.rays):
                return
            transmission, _ = passage.looked_up(traced.transparency)
            stopped[passage.rays] += light[:, 3] * (1.0 - transmission[:, 3])
            light *= transmission
            onward = traced.transparency.lets_through(passage.triangle) & (light.max(1) > LEAST_LIGHT)
            passage.keep(onward)
            light = light[onward]
            passage.go_on()
            behind = passage.rays
            brought, within, _ = self._found(
                passage.hits(), passage.directions, cosine[behind], _of(rooms, behind), _of(known, behind)
            )
            found[behind] += light[:, :3] * brought
            inside[behind] = within
            stopped[behind[within]] = 0.0
            out = passage.triangle >= 0
            passage.keep(out & ~within)
            light = light[out & ~within]
