"""Secondary reflectors: the surfaces that scatter most of the direct light pass it on before the rest becomes ambient.

The bookkeeping is that of progressive radiosity (Cohen et al. 1988), stopped after one step of the most important
reflectors: what they scatter, U_j = R_j H_j, leaves the unshot light and arrives at the patches that see them, where it
is unshot again. The ambient light is computed from what is unshot at the end, so that nothing counts twice.

Form factors are means over points spread over the receiver and the reflector: near by, of the exact form factor from
the point to a whole triangle, which has no spikes, times the share of it that is visible along cosine-distributed rays;
farther away, of the kernel cos cos / (pi r^2) between two points that see each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..sampling import BELOW_ONE, ascending_ends, hash32, pick, sample_cosine_hemisphere, sample_triangle, unit_points
from ..scene import LUMINANCE
from ..settings import BakeSettings
from ..tracing import scramble_of
from ..workers import workers
from .direct import LitScene
from .form_factors import triangle_form_factors
from .lamps import TINY
from .reflectors import MAX_AUTOMATIC, Reflectors
from .visibility import visible_share

MAX_OTHER_RECEIVERS = 4096  # patches that are not baked count only in a sum, for which a sample is enough

# Samples of a pair by how much of the hemisphere the reflector covers from the nearest point of the receiver, about.
_SAMPLES = ((0.0, 1), (0.005, 2), (0.02, 4), (0.1, 8))
_MOST_SAMPLES = 16
_NEAR = 0.02  # cover from which exact form factors replace the kernel that they are integrals of, which spikes there
_POINT_SETS = 64  # independent ones; neighbours rarely share one
_TABLE_REFLECTORS = 512  # sequences of places repeat after that many reflectors
_BLOCK_PAIRS = 1 << 16


@dataclass(frozen=True)
class Redistribution:
    """What the reflectors passed on.

    Attributes
    ----------
    irradiance : ndarray, (r, 3) float64
        W/m^2 at each receiver, over its part outside of solids.
    rays : int
    """

    irradiance: np.ndarray
    rays: int


def redistribute(
    scene: LitScene,
    reflectors: Reflectors,
    exitance: np.ndarray,
    valid: np.ndarray,
    receivers: np.ndarray,
    settings: BakeSettings,
    *,
    replicate: int = 0,
    progress: Callable[[int], None] = lambda _rays: None,
) -> Redistribution:
    """What patches receive from the reflectors.

    Parameters
    ----------
    scene : LitScene
    reflectors : Reflectors
    exitance : ndarray, (p, 3) float64
        U = R H of each patch, W/m^2.
    valid : ndarray, (p,) float64
        Share of each patch outside of solids.
    receivers : ndarray, (r,) int
        Patches.
    settings : BakeSettings
        Sampler, seed and threads.
    replicate : int
    progress : callable
        Called with the number of receivers just done; may raise to cancel.
    """
    pairs = _Pairs(scene, reflectors, exitance, valid, settings, replicate)
    per_block = max(1, _BLOCK_PAIRS // (_SAMPLES[0][1] * len(reflectors)))
    blocks = [receivers[at : at + per_block] for at in range(0, len(receivers), per_block)]
    parts, rays = [], 0
    with workers(settings.thread_count()) as pool:
        for block, (part, cast) in zip(blocks, pool.map(pairs.gather, blocks), strict=True):
            parts.append(part)
            rays += cast
            progress(len(block))
    irradiance = np.concatenate(parts) if parts else np.zeros((0, 3))
    exposed = valid[receivers]
    irradiance /= np.where(exposed > 0.0, exposed, 1.0)[:, None]
    return Redistribution(irradiance, rays)


def sample_receivers(
    n_baked: int, area: np.ndarray, reflectance: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """All patches to bake, and of the others as many as a sum over the scene needs.

    Parameters
    ----------
    n_baked : int
        The first patches are those to bake.
    area : ndarray, (p,) float64
        Outside of solids.
    reflectance : ndarray, (p, 3) float64
    seed : int

    Returns
    -------
    receivers : ndarray, (r,) int64
    stands_for : ndarray, (r,) float64
        Number of patches that each stands for in the sum.
    """
    own, n_others = np.arange(n_baked), len(area) - n_baked
    if n_others <= MAX_OTHER_RECEIVERS:
        return np.arange(len(area)), np.ones(len(area))
    importance = area[n_baked:] * (reflectance[n_baked:] @ LUMINANCE)
    if not importance.sum() > 0.0:
        return own, np.ones(n_baked)
    share = importance / importance.sum()
    random = np.random.Generator(np.random.Philox(key=[seed, 0xD15C]))
    strata = (np.arange(MAX_OTHER_RECEIVERS) + random.random(MAX_OTHER_RECEIVERS)) / MAX_OTHER_RECEIVERS
    picked = np.minimum(np.searchsorted(np.cumsum(share), strata), n_others - 1)
    picked, times = np.unique(picked[share[picked] > 0.0], return_counts=True)
    stands_for = times / (MAX_OTHER_RECEIVERS * share[picked])
    return np.concatenate([own, n_baked + picked]), np.concatenate([np.ones(n_baked), stands_for])


class _Pairs:
    """Receivers x reflectors."""

    def __init__(
        self,
        scene: LitScene,
        reflectors: Reflectors,
        exitance: np.ndarray,
        valid: np.ndarray,
        settings: BakeSettings,
        replicate: int,
    ) -> None:
        cells = scene.traced.cells
        self.traced, self.reflectors, self.cells = scene.traced, reflectors, cells
        self.partly_inside = (valid < 1.0 - 1e-9) & (scene.traced.bodies is not None)
        patch = cells.patch[reflectors.cell]
        self.power = (exitance[patch] / reflectors.share[:, None]).astype(np.float32)  # of an entry, over its chance
        seed = int(hash32(np.uint32(settings.seed) ^ hash32(np.uint32(replicate ^ 0x5EC0))))
        self.scramble = scramble_of(scene.ids, seed) % _POINT_SETS
        self.boost = 1 << max(MAX_AUTOMATIC // len(reflectors), 1).bit_length() - 1  # few reflectors are sampled better
        self.rows = min(_SAMPLES[-1][1] * self.boost, _MOST_SAMPLES) * min(len(reflectors), _TABLE_REFLECTORS)
        points = unit_points(settings.sampler, seed, np.arange(_POINT_SETS), 0, self.rows)
        self.table = np.minimum(points.astype(np.float32), BELOW_ONE).reshape(-1, 4)
        frames = cells.frames
        self.normal = np.ascontiguousarray(frames[:, 2, 3:])
        self.edge1, self.edge2 = (np.ascontiguousarray(frames[:, k, :3]) for k in (0, 1))
        self.corner = np.ascontiguousarray(frames[:, 2, :3])  # one ray offset above the surface
        self.cell_area = cells.weight * cells.area[cells.patch]
        self.kernel_area = (self.cell_area / np.pi).astype(np.float32)
        self.centre, self.radius, self.size = self._balls()
        self.first_cell = np.searchsorted(cells.patch, np.arange(len(cells.area) + 1))
        self.end_weight = ascending_ends(cells.patch, cells.weight)
        cell_of = np.minimum(self.first_cell[:-1], len(cells.patch) - 1)[cells.patch]
        turned = np.einsum("ij,ij->i", self.normal, self.normal[cell_of]) < 1.0 - 1e-6
        self.is_bent = np.bincount(cells.patch, turned, len(cells.area)) > 0  # has no horizon of its own
        self.middle, self.reach = self._receiver_balls()

    def _balls(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centre (k, 3), radius (k,) and area (k,) of a ball around each reflector."""
        reflectors = self.reflectors
        first, edge1, edge2 = (part[reflectors.cell] for part in (self.corner, self.edge1, self.edge2))
        corners = np.stack([first, first + edge1, first + edge2], 1)
        low = np.minimum.reduceat(corners.min(1), reflectors.start[:-1])
        high = np.maximum.reduceat(corners.max(1), reflectors.start[:-1])
        area = self.cell_area[reflectors.cell]
        return (
            0.5 * (low + high),
            0.5 * np.linalg.norm(high - low, axis=1),
            np.add.reduceat(area, reflectors.start[:-1]),
        )

    def _receiver_balls(self) -> tuple[np.ndarray, np.ndarray]:
        """Middle (p, 3) of each patch's first cell and the distance (p,) of its farthest corner; 0 without cells."""
        cells, n_patches = self.cells, len(self.cells.area)
        middle, reach = np.zeros((n_patches, 3), np.float32), np.zeros(n_patches, np.float32)
        filled = np.flatnonzero(self.first_cell[1:] > self.first_cell[:-1])
        if len(filled):
            first = self.first_cell[filled]
            middle[filled] = self.corner[first] + (self.edge1[first] + self.edge2[first]) / 3.0
            corners = [self.corner, self.corner + self.edge1, self.corner + self.edge2]
            away = np.max([np.linalg.norm(c - middle[cells.patch], axis=1) for c in corners], axis=0)
            reach[filled] = np.maximum.reduceat(away, first)
        return middle, reach

    def gather(self, receivers: np.ndarray) -> tuple[np.ndarray, int]:
        """Irradiance (r, 3) of receivers (r,) before division by their exposed share, and the number of rays."""
        found, rays = np.zeros((len(receivers), 3)), 0
        row, reflector, cover = self._pairs_above_horizon(receivers)
        covers = [at_least for at_least, _ in _SAMPLES]
        band = np.searchsorted(covers, cover, side="right") - 1
        for index, (at_least, number) in enumerate(_SAMPLES):
            chosen = np.flatnonzero(band == index)
            if len(chosen):
                number = min(number * self.boost, _MOST_SAMPLES)
                light, cast = self._sample(receivers[row[chosen]], reflector[chosen], number, at_least >= _NEAR)
                rays += cast
                found += np.stack([np.bincount(row[chosen], column, len(receivers)) for column in light.T], -1)
        return found, rays

    def _pairs_above_horizon(self, receivers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pairs (row, reflector) that may see each other, and about the most of the hemisphere that is covered."""
        rows = np.flatnonzero(self.first_cell[receivers + 1] > self.first_cell[receivers])
        patch = receivers[rows]
        normal, middle = self.normal[self.first_cell[patch]], self.middle[patch]
        height = normal @ self.centre.T - np.einsum("ij,ij->i", normal, middle)[:, None]
        r, k = np.nonzero((height > -self.radius) | self.is_bent[patch][:, None])
        towards = self.centre[k] - middle[r]
        distance = np.maximum(np.sqrt(np.einsum("ij,ij->i", towards, towards)) - self.reach[patch[r]], 0.0)
        return rows[r], k, self.size[k] / (np.pi * distance * distance + self.size[k])

    def _sample(self, patch: np.ndarray, reflector: np.ndarray, number: int, near: bool) -> tuple[np.ndarray, int]:
        """Irradiance (q, 3) of patches from reflectors, pair by pair, from `number` places each."""
        q = len(patch)
        index = (reflector % _TABLE_REFLECTORS * number)[:, None] + np.arange(number)
        index += (self.scramble[patch] * self.rows)[:, None]
        unit = np.take(self.table, index.ravel(), axis=0)
        if number > 1:
            patch, reflector = np.repeat(patch, number), np.repeat(reflector, number)
        own, u = pick(self.end_weight, patch, unit[:, 0])
        stratum = (np.tile(np.arange(number), q) + unit[:, 2]) / number
        chosen, v = pick(self.reflectors.end_share, reflector, stratum)
        other = self.reflectors.cell[chosen]
        points, targets = self._place(own, u, unit[:, 1]), self._place(other, v, unit[:, 3])
        arrives = np.zeros(len(points), bool)
        if near:
            corner = self.corner[other]
            corners = np.stack([corner, corner + self.edge1[other], corner + self.edge2[other]], 1)
            factor = triangle_form_factors(points, self.normal[own], corners)
            arrives = self._aim(own, other, points, unit[:, 2:], targets)
        towards = targets - points
        square = np.maximum(np.einsum("ij,ij->i", towards, towards), TINY)
        distance = np.sqrt(square)
        towards /= distance[:, None]
        leaving = -np.einsum("ij,ij->i", towards, np.take(self.normal, other, axis=0))
        if not near:
            factor = np.einsum("ij,ij->i", towards, np.take(self.normal, own, axis=0))
            np.maximum(factor, 0.0, out=factor)
            factor *= leaving * np.take(self.kernel_area, other) / square
        seen = np.flatnonzero((factor > 0.0) & (leaving > 0.0))
        rays = (np.take(array, seen, axis=0) for array in (points, towards, distance))
        rooms = self.traced.rooms_of_patches(patch[seen])
        share = visible_share(self.traced, *rays, self.partly_inside[patch[seen]], rooms)
        visible = np.zeros(len(points), share.dtype)
        visible[seen] = share
        light = (factor / number).astype(np.float32)[:, None] * np.take(self.power, chosen, axis=0)
        if near:
            return _by_visible_share(light, visible, arrives, number), len(seen)
        light *= visible[:, None]
        return (light if number == 1 else light.reshape(q, number, 3).sum(1)), len(seen)

    def _aim(
        self, own: np.ndarray, other: np.ndarray, points: np.ndarray, unit: np.ndarray, targets: np.ndarray
    ) -> np.ndarray:
        """Move targets (n, 3) to where a cosine-distributed ray from each point meets the plane of its cell `other`.

        Returns (n,) bool: which rays meet the cell itself; the targets of the others stay. From close by, a large
        reflector shines by the part that is near, which points spread evenly over it would miss.
        """
        local = sample_cosine_hemisphere(unit)
        directions = np.einsum("ij,ijk->ik", local, self.cells.frames[own][..., 3:])
        normal, edge1, edge2 = self.normal[other], self.edge1[other], self.edge2[other]
        offset = points - self.corner[other]
        with np.errstate(all="ignore"):
            reach = -np.einsum("ij,ij->i", offset, normal) / np.einsum("ij,ij->i", directions, normal)
            place = offset + reach[:, None] * directions
            a, b, c = (np.einsum("ij,ij->i", x, y) for x, y in ((edge1, edge1), (edge1, edge2), (edge2, edge2)))
            d, e = (np.einsum("ij,ij->i", place, edge) for edge in (edge1, edge2))
            b1, b2 = (c * d - b * e) / (a * c - b * b), (a * e - b * d) / (a * c - b * b)
            inside = (reach > 0.0) & (b1 >= 0.0) & (b2 >= 0.0) & (b1 + b2 <= 1.0)
        targets[inside] = (self.corner[other] + place)[inside]
        return inside

    def _place(self, cell: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points (n, 3) on cells (n,), one ray offset above them."""
        b = sample_triangle(np.stack([u, v], -1)).astype(np.float32)
        place = np.take(self.edge1, cell, axis=0)
        place *= b[:, :1]
        place += b[:, 1:] * np.take(self.edge2, cell, axis=0)
        place += np.take(self.corner, cell, axis=0)
        return place


def _by_visible_share(light: np.ndarray, visible: np.ndarray, arrives: np.ndarray, number: int) -> np.ndarray:
    """Unoccluded light (q number, 3) of samples, summed over each pair's `number` and times its visible share; (q, 3).

    The share is that of the samples that a cosine-distributed ray chose, weighed by their light; of all where none was.
    """
    light, visible, arrives = (array.reshape(-1, number, *array.shape[1:]) for array in (light, visible, arrives))
    weight = light.sum(2)
    chosen = weight * arrives
    chosen = np.where((chosen.sum(1) > 0.0)[:, None], chosen, weight)
    total = chosen.sum(1)
    share = (chosen * visible).sum(1) / np.where(total > 0.0, total, 1.0)
    return light.sum(1) * share[:, None]
