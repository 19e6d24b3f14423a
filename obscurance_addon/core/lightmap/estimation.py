"""Estimates every covered texel of an atlas, each of which is a patch.

Rows of a page are worked through band by band, so that memory beside the pages does not grow with them. What a texel's
value is, and when it is known, is the business of an estimator; this file finds texels, keeps pages and margins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ..monitor import Monitor
from ..settings import MIN_RAYS_PER_PATCH, BakeSettings
from ..workers import workers
from .adaptive import MOST_EXTRA_RAYS
from .obscurances import MIN_EXPOSED, TexelValues
from .page import AtlasPage, check_room
from .progress import TexelProgress
from .settings import LightmapSettings
from .texels import Texels, covered_texels
from .triangles import AtlasTriangles

ERROR_SAMPLE = 4096  # texels, about, that are traced twice more: enough to fix the RMSE to a few percent
REPLICATES = (1, 2)  # of the points that tell the error; 0 is the bake
MOST_OVERLAPS = 1000  # pairs of faces that are told
_BAND_TEXELS = 1 << 18  # at least, if a page has so many: what Python does for each band is then little
_BAND_ROWS = 64  # at least, a multiple of the coarsest stride of sparse texels
_LEAST_BANDS = 4  # of a page, if it has so many rows
_MOST_BANDS_AT_ONCE = 4  # each takes memory


class TexelEstimator(Protocol):
    """What finds the values of texels. Four numbers stand for each until `finish` turns them into a colour."""

    def estimate(self, texels: Texels, n: int, rows: tuple[int, int]) -> TexelValues:
        """Values of the first n texels.

        `rows` are those of the page in which all texels lie; the others may help to interpolate. Called from several
        threads at once, each with its own rows.
        """

    def repeat(self, texels: Texels, chosen: np.ndarray, replicate: int) -> TexelValues:
        """Values of the texels `chosen` (m,) from other samples; from several threads at once as well."""

    def finish(self, values: np.ndarray) -> None:
        """Turn values (k, 4) into colours in place, in the first three columns; once all texels are estimated."""

    def open_color(self) -> np.ndarray:
        """(3,): the colour of a texel that nothing is known of."""


@dataclass
class TexelCounts:
    """What was found of the texels of an atlas, or of a band of it.

    Attributes
    ----------
    texels, invalid : int
        Covered ones, and those of them that lie mostly inside of solids or have no usable surface.
    traced : int
        Those that cast rays of their own.
    rays, error_rays : int
        Cast for the values, and to tell their error.
    area, hidden : ndarray, (f,) float64
        Covered area of each face patch, and what of it lies inside of solids; normalised units squared.
    overlap : dict of tuple of int to int
        Number of texels that two faces cover, by their patches.
    sample : list of tuple of three ndarray, (m, 4)
        Values of some texels, and twice from other samples.
    """

    area: np.ndarray
    hidden: np.ndarray
    texels: int = 0
    invalid: int = 0
    traced: int = 0
    rays: int = 0
    error_rays: int = 0
    overlap: dict[tuple[int, int], int] = field(default_factory=dict)
    sample: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)

    def exposed(self) -> np.ndarray:
        """Share of each face outside of solids, (f,); 1 for faces without texels."""
        return 1.0 - self.hidden / np.where(self.area > 0.0, self.area, 1.0)

    @classmethod
    def none(cls, n_faces: int) -> TexelCounts:
        """Those of nothing."""
        return cls(np.zeros(n_faces), np.zeros(n_faces))

    @classmethod
    def of(cls, texels: Texels, found: TexelValues, n_faces: int) -> TexelCounts:
        """Those of the first n texels of a band, from what was found of them."""
        n, face, area = len(found.valid), texels.face, texels.area
        pair = np.flatnonzero((texels.overlap[1:] == texels.overlap[:-1]) & (texels.overlap[1:] < n))
        faces = np.stack([texels.overlap_face[pair], texels.overlap_face[pair + 1]], 1)
        return cls(
            area=np.bincount(face[:n], area[:n], n_faces),
            hidden=np.bincount(face[:n], area[:n] * (1.0 - found.valid), n_faces),
            texels=n,
            invalid=int(np.count_nonzero(found.valid < MIN_EXPOSED)),
            traced=found.traced,
            rays=found.rays,
            overlap=_counted(faces),
        )

    def add(self, band: TexelCounts) -> None:
        """Count those of a band as well."""
        for name in ("area", "hidden", "texels", "invalid", "traced", "rays", "error_rays", "sample"):
            setattr(self, name, getattr(self, name) + getattr(band, name))
        for faces, count in band.overlap.items():
            if faces in self.overlap or len(self.overlap) < MOST_OVERLAPS:
                self.overlap[faces] = self.overlap.get(faces, 0) + count

    def rmse(self, finish: Callable[[np.ndarray], None]) -> np.ndarray:
        """Root mean square error (3,) of the colours that `finish` makes of values, interpolation included.

        The two repetitions are independent of the value and of each other, so that the mean of the product of the
        differences is free of their own noise.
        """
        if not self.sample:
            return np.zeros(3)
        value, one, other = (np.concatenate(part) for part in zip(*self.sample, strict=True))
        for part in (value, one, other):
            finish(part)
        return np.sqrt(np.maximum(((value - one) * (value - other)).mean(0)[:3], 0.0))


def bands_at_once(settings: BakeSettings) -> int:
    """How many bands to work through at once: threads share out bands better than the blocks of one."""
    return min(settings.thread_count(), _MOST_BANDS_AT_ONCE)


def texel_settings(settings: BakeSettings, lightmap: LightmapSettings, texels: float) -> BakeSettings:
    """Settings for each band: with its part of the threads, and without a ray budget.

    The budget is shared out over the texels, whose areas are alike. Sparse texels cast more rays, which is kept ready
    for the case that they save none.
    """
    settings = replace(settings, threads=math.ceil(settings.thread_count() / bands_at_once(settings)))
    if settings.ray_budget is None:
        return settings
    most = texels * (1.0 + MOST_EXTRA_RAYS) if lightmap.adaptive else texels
    share = max(settings.ray_budget / max(most, 1.0), MIN_RAYS_PER_PATCH)
    return replace(settings, rays=2 ** int(np.log2(share)), ray_budget=None)


def estimate_pages(
    triangles: AtlasTriangles,
    pages: int,
    n_faces: int,
    lightmap: LightmapSettings,
    estimator: TexelEstimator,
    progress: TexelProgress,
    at_once: int,
) -> tuple[list[AtlasPage], TexelCounts]:
    """Find the colour of every texel of an atlas.

    Parameters
    ----------
    triangles : AtlasTriangles
    pages, n_faces : int
        Numbers of pages and of face patches.
    lightmap : LightmapSettings
    estimator : TexelEstimator
    progress : TexelProgress
    at_once : int
        Bands to work through in threads of their own.

    Returns
    -------
    pages : list of AtlasPage
        Unfinished.
    counts : TexelCounts

    Raises
    ------
    GeometryError
        When several pages have no room on the disk.
    """
    size = lightmap.size
    if pages > 1:
        check_room(pages, size)
    found = [AtlasPage.empty(size, on_disk=pages > 1) for _ in range(pages)]
    share = ERROR_SAMPLE / max(triangles.texels(), 1.0)

    def estimate(page: int, rows: tuple[int, int]) -> TexelCounts:
        texels, n = _band(triangles, size, page, rows)
        if not n:
            return TexelCounts.none(n_faces)
        progress.begin(n)
        values = estimator.estimate(texels, n, (rows[0], min(rows[1] + 1, size)))
        counts = TexelCounts.of(texels, values, n_faces)
        has_value = values.valid >= MIN_EXPOSED
        sampled = np.flatnonzero((texels.ids[:n] < share * 2.0**32) & has_value)
        if len(sampled):
            again = [estimator.repeat(texels, sampled, k) for k in REPLICATES]
            counts.sample.append((values.values[sampled], *(one.values for one in again)))
            counts.error_rays = sum(one.rays for one in again)
        found[page].put(texels.index[:n], values.values, texels.chart[:n], has_value)
        progress.end(n)
        return counts

    counts = TexelCounts.none(n_faces)
    bands = [(page, rows) for page in range(pages) for rows in _rows_of_bands(size)]
    with workers(at_once) as pool:
        for band in pool.map(estimate, *zip(*bands, strict=True)):
            counts.add(band)
    return found, counts


def finish_pages(
    pages: list[AtlasPage], estimator: TexelEstimator, lightmap: LightmapSettings, monitor: Monitor
) -> list[np.ndarray]:
    """The colours of pages (size, size, 4) float32, the bottom row first: holes and margins filled, alpha 1 or 0."""
    return [
        page.finish(estimator.finish, estimator.open_color(), lightmap.margin_texels, lambda: monitor.advance(0))
        for page in pages
    ]


def _rows_of_bands(size: int) -> list[tuple[int, int]]:
    """The first row of each band of a page, and the one behind its last."""
    height = _BAND_ROWS * max(1, min(_BAND_TEXELS // (size * _BAND_ROWS), size // (_LEAST_BANDS * _BAND_ROWS)))
    return [(first, min(first + height, size)) for first in range(0, size, height)]


def _band(triangles: AtlasTriangles, size: int, page: int, rows: tuple[int, int]) -> tuple[Texels, int]:
    """Covered texels of some rows and of the row above them, and the number of those below it."""
    texels = covered_texels(triangles, size, page, (rows[0], min(rows[1] + 1, size)))
    return texels, int(np.searchsorted(texels.index, rows[1] * size))


def _counted(pairs: np.ndarray) -> dict[tuple[int, int], int]:
    """Distinct rows of pairs (m, 2), and how often each is there."""
    pairs, times = np.unique(pairs, axis=0, return_counts=True)
    return {(int(one), int(other)): int(count) for (one, other), count in zip(pairs, times, strict=True)}
