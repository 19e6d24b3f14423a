"""How far a solution is from a reference, over patches: shared by tests and benchmarks."""

from __future__ import annotations

import numpy as np


def relative_rmse(found: np.ndarray, reference: np.ndarray, weight: np.ndarray) -> float:
    """Weighted root mean square difference, relative to the weighted root mean square of the reference.

    Parameters
    ----------
    found, reference : ndarray, (p, k) float64
        Values of p patches in k channels, of the same unit.
    weight : ndarray, (p,) float64
        Usually areas; 0 leaves a patch out.
    """
    return float(np.sqrt((weight @ (found - reference) ** 2).sum() / (weight @ reference**2).sum()))


def energy_ratio(found: np.ndarray, reference: np.ndarray, weight: np.ndarray) -> float:
    """Weighted sum relative to that of the reference; parameters as for `relative_rmse`."""
    return float((weight @ found).sum() / (weight @ reference).sum())


def shape_error(found: np.ndarray, reference: np.ndarray, weight: np.ndarray) -> float:
    """`relative_rmse` after the best common factor: what no exposure could mend."""
    square = (weight @ found**2).sum()
    factor = (weight @ (found * reference)).sum() / square if square > 0.0 else 0.0
    return relative_rmse(factor * found, reference, weight)
