"""Estimates with their standard error, from bakes with independent seeds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obscurance_addon.core.settings import BakeSettings
from tests.core.scenes import Scene

SEEDS = 16
SIGMAS = 5.0  # of Student's t with 15 degrees of freedom: a correct code exceeds it once in 6,000 comparisons
ROUNDING = 2e-6  # float32 distances and sums, and rays that start a hair above their patch


@dataclass(frozen=True)
class Estimate:
    """Mean over seeds and its standard error; any shape."""

    mean: np.ndarray
    error: np.ndarray

    def agrees_with(self, exact: object) -> bool:
        return bool(np.all(np.abs(self.mean - exact) <= SIGMAS * self.error + ROUNDING))


def bakes(s: Scene, settings: BakeSettings, seeds: int = SEEDS) -> np.ndarray:
    """(seeds, p, 4): W in colour and W without, of bakes with seeds 0, 1, ..."""
    baked = (s.bake(replace(settings, seed=seed)) for seed in range(seeds))
    return np.stack([np.column_stack([b.coloured, b.grey]) for b in baked])


def estimate(values: np.ndarray, weights: np.ndarray | None = None) -> Estimate:
    """Mean of (seeds, p, k) over patches, weighed, and over seeds."""
    per_seed = np.average(values, axis=1, weights=weights)
    return Estimate(per_seed.mean(0), per_seed.std(0, ddof=1) / np.sqrt(len(per_seed)))
