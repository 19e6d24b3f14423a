"""Maps from the unit square to what is sampled; the density and the inverse stand beside each map.

The table of rays at the end is what the estimator uses: many independent scramblings of the same 4D points, mapped once
and shared by all patches, so that a ray costs one look-up and two small products.
"""

from __future__ import annotations

import numpy as np

from ..settings import Sampler
from . import sobol

DIRECTION = ("x", "y", "z")  # what a ray table tells beside the place: a direction about the normal,
UNIT = ("u", "v")  # or the two coordinates that are left, for what is not a hemisphere
BELOW_ONE = np.nextafter(np.float32(1.0), np.float32(0.0))  # for numbers that single precision rounded up to 1
SCRAMBLES = 256  # independent point sets; neighbours rarely share one, and a table of 64 rays stays in the L2 cache


def sample_triangle(u: np.ndarray) -> np.ndarray:
    """Uniform points on a triangle: unit square -> barycentric coordinates.

    The low-distortion map of Heitz, "A Low-Distortion Map Between Triangle and Square" (2019).

    Parameters
    ----------
    u : ndarray, (..., 2) float64
        Points of the unit square.

    Returns
    -------
    ndarray, (..., 2) float64
        Weights (b1, b2) of the second and third corner; the first corner has 1 - b1 - b2.
    """
    x, y = u[..., 0], u[..., 1]
    above = y > x
    b1 = np.where(above, 0.5 * x, x - 0.5 * y)
    b2 = np.where(above, y - 0.5 * x, 0.5 * y)
    return np.stack([b1, b2], -1)


def triangle_pdf(area: float) -> float:
    """Density of `sample_triangle` with respect to surface area: 1 / area."""
    return 1.0 / area


def invert_triangle_sample(b: np.ndarray) -> np.ndarray:
    """Inverse of `sample_triangle`: (..., 2) barycentric weights (b1, b2) -> (..., 2) points of the unit square."""
    b1, b2 = b[..., 0], b[..., 1]
    above = b2 > b1
    return np.stack([np.where(above, 2.0 * b1, b1 + b2), np.where(above, b1 + b2, 2.0 * b2)], -1)


def sample_disc(u: np.ndarray) -> np.ndarray:
    """Uniform points on the unit disc: Shirley and Chiu's concentric map (1997); (..., 2) -> (..., 2), any float."""
    x, y = 2.0 * u[..., 0] - 1.0, 2.0 * u[..., 1] - 1.0
    by_x = np.abs(x) > np.abs(y)
    radius = np.where(by_x, x, y)
    ratio = np.where(by_x, y, x) / np.where(radius == 0.0, 1.0, radius)
    angle = np.where(by_x, 0.25 * np.pi * ratio, 0.5 * np.pi - 0.25 * np.pi * ratio)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def disc_pdf() -> float:
    """Density of `sample_disc`: 1 / pi."""
    return 1.0 / np.pi


def sample_cosine_hemisphere(u: np.ndarray) -> np.ndarray:
    """Cosine-distributed directions about +z: the disc, lifted to the hemisphere.

    Parameters
    ----------
    u : ndarray, (..., 2) float64
        Points of the unit square.

    Returns
    -------
    ndarray, (..., 3) float64
        Unit vectors with z >= 0.
    """
    disc = sample_disc(u)
    z = np.sqrt(np.maximum(0.0, 1.0 - (disc * disc).sum(-1)))
    return np.concatenate([disc, z[..., None]], -1)


def cosine_hemisphere_pdf(cosine: np.ndarray) -> np.ndarray:
    """Density of `sample_cosine_hemisphere` with respect to solid angle: cos(theta) / pi."""
    return cosine / np.pi


def invert_cosine_hemisphere_sample(directions: np.ndarray) -> np.ndarray:
    """Inverse of `sample_cosine_hemisphere`: (..., 3) unit vectors, z >= 0 -> (..., 2) points of the unit square."""
    x, y = directions[..., 0], directions[..., 1]
    by_x = np.abs(x) > np.abs(y)
    minor, major = np.where(by_x, y, x), np.where(by_x, x, y)
    radius = np.copysign(np.hypot(x, y), major)
    ratio = np.arctan(minor / np.where(major == 0.0, 1.0, major)) * (4.0 / np.pi)
    square = np.where(by_x, [radius, radius * ratio], [radius * ratio, radius])
    return 0.5 * (np.moveaxis(square, 0, -1) + 1.0)


def sample_cone(axis: np.ndarray, cosine: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions spread evenly over cones.

    Parameters
    ----------
    axis : ndarray, (n, 3) float32
        Unit vectors.
    cosine : ndarray, (n,) float32, or float
        Of half the opening angle, -1 .. 1.
    u : ndarray, (n, 2) float32
        Points of the unit square.

    Returns
    -------
    directions : ndarray, (n, 3) float32
    along : ndarray, (n,) float32
        Their cosine with the axis.
    """
    disc = sample_disc(u)
    along = 1.0 - (1.0 - cosine) * (disc * disc).sum(-1)
    stretch = np.sqrt(np.maximum((1.0 - cosine) * (1.0 + along), 0.0))
    local = np.concatenate([disc * stretch[:, None], along[:, None]], -1).astype(np.float32)
    return np.einsum("ij,ijk->ik", local, orthonormal_frames(axis).astype(np.float32)), along.astype(np.float32)


def cone_pdf(cosine: float) -> float:
    """Density of `sample_cone` with respect to solid angle."""
    return 1.0 / (2.0 * np.pi * (1.0 - cosine))


def orthonormal_frames(normals: np.ndarray) -> np.ndarray:
    """Right-handed frames about unit normals, without a branch (Duff et al., JCGT 2017).

    Parameters
    ----------
    normals : ndarray, (n, 3) float64
        Unit vectors.

    Returns
    -------
    ndarray, (n, 3, 3) float64
        Rows tangent, bitangent, normal: local coordinates times this matrix are world directions.
    """
    x, y, z = normals.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    frames = np.empty((len(normals), 3, 3))
    frames[:, 0] = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], -1)
    frames[:, 1] = np.stack([b, sign + y * y * a, -y], -1)
    frames[:, 2] = normals
    return frames


def ray_table(
    sampler: Sampler,
    seed: int,
    scrambles: np.ndarray,
    first: int,
    count: int,
    columns: tuple[str, ...] = DIRECTION,
    on_triangle: bool = True,
    favours_directions: bool = False,
) -> np.ndarray:
    """Samples `first` .. `first + count - 1` of the point sets named by `scrambles`, mapped to cell and hemisphere.

    Parameters
    ----------
    sampler : Sampler
        Sobol points, or independent random numbers.
    seed : int
        The bake's seed.
    scrambles : ndarray, (s,) integer
        Which of the independent point sets, each in 0 .. SCRAMBLES - 1.
    first, count : int
        Range of the sequence.
    columns : tuple of str
        DIRECTION or UNIT.
    on_triangle : bool
        Cells are triangles; else parallelograms, of which b1 and b2 cover the whole unit square.
    favours_directions : bool
        Directions take the two dimensions that are spread best together, not places.

    Returns
    -------
    ndarray, (5 or 4, s, count) float32
        b1, b2 (place on the cell) and x, y, z (direction about the normal), or u, v in 0 .. 1.
    """
    unit = unit_points(sampler, seed, scrambles, first, count)
    place, direction = unit[..., 0:2], unit[..., 2:4]
    if favours_directions:
        place, direction = direction, place
    place = sample_triangle(place) if on_triangle else place
    direction = direction if columns is UNIT else sample_cosine_hemisphere(direction)
    return np.stack([*np.moveaxis(place, -1, 0), *np.moveaxis(direction, -1, 0)]).astype(np.float32)


def unit_points(sampler: Sampler, seed: int, scrambles: np.ndarray, first: int, count: int) -> np.ndarray:
    """Points of the four-dimensional unit cube, (s, count, 4) float64; parameters as for `ray_table`."""
    if sampler is Sampler.SOBOL:
        keys = sobol.DIMENSIONS * scrambles[:, None] + np.arange(sobol.DIMENSIONS)
        seeds = sobol.hash32(keys.astype(np.uint32) ^ sobol.hash32(np.uint32(seed)))
        return sobol.to_unit(sobol.owen_scramble(sobol.sobol_points(first, count), seeds[:, None, :]))
    streams = [np.random.Philox(key=[seed, int(i)], counter=[0, 0, 0, first]) for i in scrambles]
    return np.stack([np.random.Generator(stream).random((count, sobol.DIMENSIONS)) for stream in streams])
