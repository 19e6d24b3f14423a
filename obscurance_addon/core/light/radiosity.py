"""Radiosity on the patches of a bake: the reference that obscurances are judged by.

I = R F (U + I), where U = R H is what patches scatter of the direct light and F are form factors with visibility. Two
solutions are here: F gathered by cosine-distributed rays and the system solved by Jacobi iteration, and the shooting
random walk of the 2003 paper's figure 3. Surfaces scatter on the side of their normal; their backs are black.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import GeometryError
from ..sampling import ascending_ends, pick
from ..scene import LUMINANCE, Cells
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, FAR, PatchSamples
from .direct import LitScene

MAX_PATCHES = 50_000  # a row of form factors has up to as many entries as rays: 64 rays each take about 30 MB
MAX_RAYS = 1 << 27  # in all: about a gigabyte of form factors
CONVERGED = 1e-7  # relative change per sweep
MAX_SWEEPS = 2000
_MAX_BOUNCES = 10_000  # no path of a reflectance below 1 comes near


@dataclass(frozen=True)
class FormFactors:
    """F of a scene in compressed rows: entries `start[i]` .. `start[i + 1]` belong to patch i.

    Attributes
    ----------
    start : ndarray, (p + 1,) int64
    column : ndarray, (e,) int32
        Patch that is seen.
    factor : ndarray, (e,) float32
    rays : int
    """

    start: np.ndarray
    column: np.ndarray
    factor: np.ndarray
    rays: int

    def gather(self, radiosity: np.ndarray) -> np.ndarray:
        """F B: irradiance (p, 3) float64 from radiosities (p, 3)."""
        filled = np.flatnonzero(self.start[1:] > self.start[:-1])
        found = np.zeros((len(self.start) - 1, radiosity.shape[1]))
        if len(filled):
            for k in range(radiosity.shape[1]):  # column by column takes least memory
                found[filled, k] = np.add.reduceat(self.factor * radiosity[self.column, k], self.start[filled])
        return found


def check_size(n_patches: int, n_rays: int) -> None:
    """Raise GeometryError when a scene is too large for a radiosity solution."""
    if n_patches > MAX_PATCHES:
        raise GeometryError(
            f"radiosity needs every face of the scene as a patch, at most {MAX_PATCHES:,}, but there are "
            f"{n_patches:,}: hide what does not matter, or bake COMBINED"
        )
    if n_rays > MAX_RAYS:
        raise GeometryError(
            f"radiosity would keep {n_rays:,} rays, at most {MAX_RAYS:,} are allowed: use fewer rays per patch"
        )


def gather_form_factors(
    scene: LitScene,
    per_patch: np.ndarray,
    valid: np.ndarray,
    settings: BakeSettings,
    *,
    replicate: int = 0,
    progress: Callable[[int], None] = lambda _rays: None,
    block_rays: int = BLOCK_RAYS,
) -> FormFactors:
    """Form factors as the shares of cosine-distributed rays that meet each patch first.

    Parameters
    ----------
    scene : LitScene
        Its surfaces name the patch of each triangle.
    per_patch : ndarray, (p,) int
        Rays.
    valid : ndarray, (p,) float64
        Share of each patch outside of solids, to which its row is related.
    settings : BakeSettings
        Sampler, seed and threads.
    replicate : int
    progress : callable
        Called from any thread with the number of rays just cast; may raise to cancel.
    block_rays : int
    """
    cells, n_patches = scene.traced.cells, len(scene.traced.cells.area)
    samples = PatchSamples(cells, scene.ids, per_patch, settings, replicate, block_rays)
    share = cells.weight / samples.count
    lock, found = threading.Lock(), []

    def cast(block: np.ndarray, points: np.ndarray) -> None:
        n = points.shape[2]
        target = _patch_seen(scene, samples.origins(block, points), samples.directions(block, points))
        seen = target >= 0
        cell = np.repeat(block, n)[seen]
        key, place, count = np.unique(cell * n_patches + target[seen], return_index=True, return_counts=True)
        cell = cell[place]
        entry = cells.patch[cell] * n_patches + key % n_patches, (count * share[cell]).astype(np.float32)
        with lock:
            found.append(entry)
        progress(len(seen))

    rays = samples.run(np.arange(len(cells.patch)), cast)
    key = np.concatenate([k for k, _ in found] or [np.zeros(0, np.int64)])
    factor = np.concatenate([f for _, f in found] or [np.zeros(0, np.float32)])
    order = np.lexsort((factor, key))  # by value too, so that the order in which threads finish does not show
    key, factor = key[order], factor[order]
    row = key // n_patches
    exposed = np.where(valid > 0.0, valid, 1.0)
    return FormFactors(
        np.searchsorted(row, np.arange(n_patches + 1)),
        (key % n_patches).astype(np.int32),
        (factor / exposed[row]).astype(np.float32),
        rays,
    )


def gather_radiosity(
    scene: LitScene,
    radiosity: np.ndarray,
    per_patch: np.ndarray,
    settings: BakeSettings,
    *,
    replicate: int = 0,
    progress: Callable[[int], None] = lambda _rays: None,
    block_rays: int = BLOCK_RAYS,
) -> tuple[np.ndarray, int]:
    """What receivers that are none of the patches get from them: a final gather.

    Parameters
    ----------
    scene : LitScene
        Its cells and ids are those of the r receivers, its surfaces name the patch of each triangle.
    radiosity : ndarray, (p, 3) float64
        Of the patches, W/m^2.
    per_patch : ndarray, (r,) int
        Rays of each receiver.
    settings, replicate, progress, block_rays
        As for `gather_form_factors`.

    Returns
    -------
    irradiance : ndarray, (r, 3) float64
        W/m^2, over all of each receiver.
    rays : int
    """
    cells = scene.traced.cells
    samples = PatchSamples(cells, scene.ids, per_patch, settings, replicate, block_rays)
    light = np.concatenate([radiosity, np.zeros((1, 3))]).astype(np.float32)  # the last one is that of nothing
    sums = np.zeros((len(cells.patch), 3))

    def cast(block: np.ndarray, points: np.ndarray) -> None:
        target = _patch_seen(scene, samples.origins(block, points), samples.directions(block, points))
        sums[block] += light[target].reshape(*points.shape[1:], 3).sum(1, dtype=np.float64)
        progress(len(target))

    rays = samples.run(np.arange(len(cells.patch)), cast)
    share = cells.weight / samples.count
    return np.stack([np.bincount(cells.patch, column * share, len(cells.area)) for column in sums.T], -1), rays


def solve_radiosity(
    factors: FormFactors,
    reflectance: np.ndarray,
    unshot: np.ndarray,
    check: Callable[[], None] = lambda: None,
    tolerance: float = CONVERGED,
) -> np.ndarray:
    """Indirect radiosity I = R F (U + I) by Jacobi iteration.

    Parameters
    ----------
    factors : FormFactors
    reflectance : ndarray, (p, 3) float64
        Below 1.
    unshot : ndarray, (p, 3) float64
        U, W/m^2: R H of the direct light; or the emission E itself, then I is all light but that.
    check : callable
        Called once per sweep; may raise to cancel.
    tolerance : float
        Relative change per sweep at which to stop.

    Returns
    -------
    ndarray, (p, 3) float64
        W/m^2.
    """
    indirect = np.zeros_like(unshot)
    for _ in range(MAX_SWEEPS):
        check()
        following = reflectance * factors.gather(unshot + indirect)
        change = np.abs(following - indirect).sum()
        indirect = following
        if change <= tolerance * np.abs(indirect).sum():
            break
    return indirect


def shoot_random_walks(
    scene: LitScene,
    reflectance: np.ndarray,
    unshot: np.ndarray,
    area: np.ndarray,
    valid: np.ndarray,
    walks: int,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _rays: None,
) -> tuple[np.ndarray, int]:
    """Indirect radiosity by a shooting random walk.

    Particles start on patches in proportion to what these scatter, leave cosine-distributed, and survive a hit with
    the probability of the largest reflectance; every hit deposits their power.

    Parameters
    ----------
    scene, reflectance, unshot
        As for `gather_form_factors` and `solve_radiosity`.
    area : ndarray, (p,) float64
        Outside of solids, m^2.
    valid : ndarray, (p,) float64
        Share of each patch outside of solids: what starts within is lost, so the others carry more.
    walks : int
        Number of particles.
    seed : int
    progress : callable
        Called with the number of rays just cast; may raise to cancel.

    Returns
    -------
    indirect : ndarray, (p, 3) float64
        W/m^2.
    rays : int
    """
    random = np.random.Generator(np.random.Philox(key=[seed, 0x3A1C]))
    cells, n_patches = scene.traced.cells, len(area)
    weight = area * (unshot @ LUMINANCE)
    received, rays = np.zeros((n_patches, 3)), 0
    if not weight.sum() > 0.0:
        return received, rays
    by_light = ascending_ends(np.zeros(n_patches, np.int64), weight / weight.sum())
    patch, _ = pick(by_light, 0, (np.arange(walks) + random.random(walks)) / walks)
    ends = ascending_ends(cells.patch, cells.weight)
    power = unshot[patch] * (area / np.where(weight > 0.0, weight, 1.0))[patch, None] * (weight.sum() / walks)
    more = np.where(valid > 0.0, 1.0 / np.where(valid > 0.0, valid, 1.0), 0.0)
    for _ in range(_MAX_BOUNCES):
        if not len(patch):
            break
        target = np.empty(len(patch), np.int64)
        for at in range(0, len(patch), BLOCK_RAYS):
            part = slice(at, at + BLOCK_RAYS)
            power[part] *= more[patch[part], None]
            target[part] = _patch_seen(scene, *_leave(cells, ends, patch[part], random))
            progress(len(patch[part]))
        rays += len(patch)
        met = target >= 0
        patch, power = target[met], power[met]
        received += np.stack([np.bincount(patch, column, n_patches) for column in power.T], -1)
        survival = reflectance[patch].max(1)
        alive = random.random(len(patch)) < survival
        patch = patch[alive]
        power = power[alive] * reflectance[patch] / survival[alive][:, None]
    return reflectance * received / np.where(area > 0.0, area, np.inf)[:, None], rays


def _leave(
    cells: Cells, ends: np.ndarray, patch: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (n, 3) float32 of particles that leave patches (n,); `ends` choose cells by area."""
    cell, _ = pick(ends, patch, random.random(len(patch)))
    root = np.sqrt(random.random(len(patch)))
    along = random.random(len(patch))
    frames = cells.frames[cell]
    place = np.stack([root * (1.0 - along), root * along, np.ones(len(patch))], -1)
    origins = np.einsum("ij,ijk->ik", place, frames[..., :3])
    radius, angle = np.sqrt(random.random(len(patch))), 2.0 * np.pi * random.random(len(patch))
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius * radius)], -1)
    directions = np.einsum("ij,ijk->ik", local, frames[..., 3:])
    return origins.astype(np.float32), directions.astype(np.float32)


def _patch_seen(scene: LitScene, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Patch (n,) int64 whose front each ray meets first, -1 where it meets a back, another surface or nothing."""
    hits = scene.traced.intersector.intersect(origins, directions, np.full(len(origins), FAR, np.float32))
    patch = np.where(hits.triangle >= 0, scene.traced.surfaces.patch[np.maximum(hits.triangle, 0)], -1)
    with np.errstate(all="ignore"):  # normals of misses hold anything
        from_behind = np.einsum("ij,ij->i", directions, hits.normal) >= 0.0
    patch[from_behind] = -1
    return patch.astype(np.int64)
