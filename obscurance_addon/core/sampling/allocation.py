"""How many rays each patch gets, and how its cells share them."""

from __future__ import annotations

import numpy as np

from ..settings import MAX_RAYS_PER_PATCH, MIN_RAYS_PER_PATCH, BakeSettings


def allocate_rays(area: np.ndarray, settings: BakeSettings) -> np.ndarray:
    """Rays per patch.

    Parameters
    ----------
    area : ndarray, (p,) float64
        Areas of the patches in any unit.
    settings : BakeSettings
        With `ray_budget`, rays go by area (the 2003 paper's way), rounded to powers of two, from
        `MIN_RAYS_PER_PATCH` to `MAX_RAYS_PER_PATCH` each; the sum stays within the budget wherever that floor allows.
        Without, all get `rays`.

    Returns
    -------
    ndarray, (p,) int64
    """
    if settings.ray_budget is None:
        return np.full(len(area), settings.rays, np.int64)
    share = area / max(float(area.sum()), np.finfo(float).tiny)
    low, high = 0.0, 4.0 * settings.ray_budget  # rounding loses at most half, so the factor lies within
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _powers_of_two(share * middle).sum() <= settings.ray_budget:
            low = middle
        else:
            high = middle
    return _powers_of_two(share * low)


def _powers_of_two(ideal: np.ndarray) -> np.ndarray:
    exponent = np.floor(np.log2(np.clip(ideal, MIN_RAYS_PER_PATCH, MAX_RAYS_PER_PATCH)))
    return 2 ** exponent.astype(np.int64)


def split_rays(patch: np.ndarray, weight: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share the ray sequence of each patch out over its cells.

    One cell takes all, two take half each (so do the triangles of a quad, whose areas rarely differ much), more take
    the power of two nearest to their share of the area, at least one. Each cell reads its own range of the sequence,
    so that the cells of a patch together use one point set.

    Parameters
    ----------
    patch : ndarray, (c,) int64, ascending
    weight : ndarray, (c,) float64
        Share of the patch's area.
    rays : ndarray, (p,) int64

    Returns
    -------
    start, count : ndarray, (c,) int64
        Range of the sequence that each cell reads.
    """
    if not len(patch):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    cells_per_patch = np.bincount(patch, minlength=len(rays))[patch]
    total = rays[patch]
    ladder = 2 ** np.rint(np.log2(np.maximum(total * weight, 1.0))).astype(np.int64)
    count = np.select([cells_per_patch == 1, cells_per_patch == 2], [total, total // 2], ladder)
    count = np.clip(count, 1, total)
    is_first = np.r_[True, patch[1:] != patch[:-1]]
    before = np.cumsum(count) - count
    before -= np.maximum.accumulate(np.where(is_first, before, 0))
    # Ranges begin at multiples of their own length and wrap at the end of the sequence.
    return before // count % (total // count) * count, count
