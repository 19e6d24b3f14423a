"""Exact obscurances W_rho (eq. 2) of simple surroundings; what has no closed form is integrated by Gauss-Legendre.

Under the cosine measure, u = cos^2(theta) is uniform on [0, 1]. Every function takes the falloff by name; q and a are
lengths relative to d_max as said in each. M, the share of rays that meet nothing, is the obscurance for STEP.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from obscurance_addon.core.falloff import Falloff

POWERS = {Falloff.SQRT: 1 / 2, Falloff.CBRT: 1 / 3, Falloff.LINEAR: 1.0}
EXP = 1.0 / (1.0 - np.exp(-1.0))


def rho(falloff: Falloff, s: np.ndarray) -> np.ndarray:
    """The distance functions, written a second time from their definition; 1 from s = 1 on."""
    s = np.asarray(s, np.float64)
    if falloff is Falloff.STEP:
        inner = np.zeros_like(s)
    elif falloff is Falloff.EXPONENTIAL:
        inner = (1.0 - np.exp(-s)) * EXP
    else:
        inner = s ** POWERS[falloff]
    return np.where(s < 1.0, inner, 1.0)


def _nodes(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1] after x = y^4 (5 - 4 y), which tames roots at 0."""
    node, weight = np.polynomial.legendre.leggauss(n)
    y = 0.5 * (node + 1.0)
    return y**4 * (5.0 - 4.0 * y), 0.5 * weight * 20.0 * y**3 * (1.0 - y)


def integrate(f: Callable[[np.ndarray], np.ndarray], low: float, high: float, n: int = 64) -> float:
    """Integral of f over [low, high], dense at the low end."""
    node, weight = _nodes(n)
    return float((high - low) * weight @ f(low + (high - low) * node))


def sphere(falloff: Falloff, a: float) -> float:
    """Inside a sphere of radius r at any of its points; a = d_max / 2r."""
    if falloff is Falloff.STEP:
        return max(0.0, 1.0 - a * a)
    if falloff is Falloff.EXPONENTIAL:
        reach = min(1.0, a)
        s = reach / a
        return 1.0 - reach**2 + EXP * (reach**2 - 2.0 * a * a * (1.0 - np.exp(-s) * (1.0 + s)))
    p = POWERS[falloff]
    return 2.0 / (p + 2.0) * a**-p if a >= 1.0 else 1.0 - a * a * p / (p + 2.0)


def planes(falloff: Falloff, q: float) -> float:
    """Below an infinite parallel plane at height q d_max."""
    if q >= 1.0:
        return 1.0
    if falloff is Falloff.STEP:
        return q * q
    if falloff is Falloff.EXPONENTIAL:
        return q * q + integrate(lambda c: 2.0 * c * rho(falloff, q / c * (1 - 1e-16)), q, 1.0)
    p = POWERS[falloff]
    return q * q + 2.0 / (2.0 - p) * (q**p - q * q)


def wall(falloff: Falloff, q: float) -> float:
    """At distance q d_max from an infinite wall at a right angle."""
    return float(_wall(falloff, np.array([q]))[0])


def _wall(falloff: Falloff, q: np.ndarray) -> np.ndarray:
    """`wall` for several distances at once, each above 0."""
    q = np.minimum(q, 1.0)
    edge = np.arccos(q)
    blocked = (edge - q * np.sqrt(1.0 - q * q)) / np.pi
    node, slope = _nodes(64)
    # t runs down from the grazing end, acos q, where the distance varies most and the nodes are dense.
    t = edge[:, None] * (1.0 - node)
    s = np.minimum(q[:, None] / np.cos(t), 1.0 - 1e-16)
    return 1.0 - blocked + 2.0 / np.pi * edge * ((rho(falloff, s) * np.sin(t) ** 2) @ slope)


def strip(falloff: Falloff, near: float, far: float) -> float:
    """Mean of `wall` over distances near .. far (relative to d_max)."""
    if near > 0.0:
        return (far * strip(falloff, 0.0, far) - near * strip(falloff, 0.0, near)) / (far - near)
    if far > 1.0:
        return (strip(falloff, 0.0, 1.0) + far - 1.0) / far
    if falloff is Falloff.STEP:
        s = np.sqrt(1.0 - far * far)
        return 1.0 - (far * np.arccos(far) - s + s**3 / 3.0 + 2.0 / 3.0) / (np.pi * far)
    return integrate(lambda x: _wall(falloff, x), 0.0, far) / far


def wedge(angle: float) -> float:
    """STEP, infinite reach: anywhere on one of two half planes that enclose this angle."""
    return 0.5 * (1.0 - np.cos(angle))


def polygon_cover(points: np.ndarray, normals: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Lambert: share (n,) of the cosine-weighted hemisphere about each normal that a polygon above it covers."""
    rays = polygon[None] - points[:, None]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    cross = np.cross(rays, np.roll(rays, -1, axis=1))
    sine = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(sine, np.einsum("nij,nij->ni", rays, np.roll(rays, -1, axis=1)))
    axis = cross / np.where(sine > 0.0, sine, 1.0)[..., None]
    return np.abs(np.einsum("ni,nij,nj->n", angle, axis, normals)) / (2.0 * np.pi)


def mean_polygon_cover(triangles: np.ndarray, polygon: np.ndarray, n: int = 32) -> float:
    """Mean of `polygon_cover` over triangles (t, 3, 3) of equal area, by Gauss-Legendre in the collapsed square."""
    node, weight = np.polynomial.legendre.leggauss(n)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    u, v = (a.ravel() for a in np.meshgrid(node, node))
    w = 2.0 * u * np.outer(weight, weight).ravel()
    a, b, c = triangles.transpose(1, 0, 2)[:, :, None]
    points = a + u[:, None] * ((b - a) + v[:, None] * (c - b))
    normals = np.cross(b - a, c - a)
    normals = np.broadcast_to(normals / np.linalg.norm(normals, axis=-1, keepdims=True), points.shape)
    cover = polygon_cover(points.reshape(-1, 3), normals.reshape(-1, 3), polygon)
    return float(np.mean(cover.reshape(len(triangles), -1) @ w))
