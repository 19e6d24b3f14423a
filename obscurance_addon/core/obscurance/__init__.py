"""The obscurances with colour bleeding of patches, as in the 2003 paper.

In go surfaces, patches and settings. Out come W per channel and without colour, which patches are hidden in solids,
and an estimate of the error.
"""

from .bake import (
    Obscurances,
    bake_obscurances,
    error_sample,
    half_difference,
    obscurances_in,
    open_values,
    patch_values,
    precision_warnings,
)
from .estimator import MOST_TIMES, Caster, ObscuranceSums, Progress
from .layers import Layered
from .objects import bake_objects
from .white import white_hits, white_warnings

__all__ = [
    "MOST_TIMES",
    "Caster",
    "Layered",
    "ObscuranceSums",
    "Obscurances",
    "Progress",
    "bake_objects",
    "bake_obscurances",
    "error_sample",
    "half_difference",
    "obscurances_in",
    "open_values",
    "patch_values",
    "precision_warnings",
    "white_hits",
    "white_warnings",
]
