"""Where rays start and which way they go, and how many there are.

In go indices of points and patches, areas and the settings. Out come scrambled Sobol points, points and directions
mapped from the unit square, choices in proportion to shares, and numbers of rays.
"""

from .allocation import allocate_rays, split_rays
from .maps import (
    BELOW_ONE,
    DIRECTION,
    SCRAMBLES,
    UNIT,
    orthonormal_frames,
    ray_table,
    sample_cone,
    sample_cosine_hemisphere,
    sample_disc,
    sample_triangle,
    unit_points,
)
from .shares import ascending_ends, pick
from .sobol import hash32

__all__ = [
    "BELOW_ONE",
    "DIRECTION",
    "SCRAMBLES",
    "UNIT",
    "allocate_rays",
    "ascending_ends",
    "hash32",
    "orthonormal_frames",
    "pick",
    "ray_table",
    "sample_cone",
    "sample_cosine_hemisphere",
    "sample_disc",
    "sample_triangle",
    "split_rays",
    "unit_points",
]
