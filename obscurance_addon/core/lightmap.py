"""One bake of a lightmap: each covered texel of an atlas is a patch.

Rows of a page are worked through band by band, so that memory beside the pages does not grow with them. What a texel's
value is, and when it is known, is the business of an estimator; this file finds texels, keeps pages and margins.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from .adaptive_texels import MOST_EXTRA_RAYS
from .atlas_page import AtlasPage, check_room
from .atlas_triangles import AtlasTriangles
from .errors import GeometryError
from .lightmap_settings import LightmapSettings
from .monitor import Monitor
from .patches import Normalisation
from .settings import MIN_RAYS_PER_PATCH, BakeSettings
from .texels import Texels, covered_texels

ERROR_SAMPLE = 4096  # texels, about, that are traced twice more: enough to fix the RMSE to a few percent
REPLICATES = (1, 2)  # of the points that tell the error; 0 is the bake
MOST_OVERLAPS = 1000  # pairs of faces that are told
# A texel with less outside of solids takes its value from its neighbours: where solids run into each other, rays that
# start inside of one may meet the outside of the other, which only shows by the many rays beside them that do not.
MIN_EXPOSED = 0.5
_BAND_TEXELS = 1 << 18  # at least, so that a band keeps all threads busy
_BAND_ROWS = 64  # at least, a multiple of the coarsest stride of sparse texels
_LEAST_BANDS = 4  # of a page, if it has so many rows: the texels of one are found while those of another are traced


@dataclass(frozen=True)
class AtlasLayout:
    """Where the t triangles to bake lie in an atlas.

    Attributes
    ----------
    corners : ndarray, (t, 3, 3) float64
        World positions in metres, counter-clockwise seen from outside.
    uv : ndarray, (t, 3, 2) float64
        Within the page, 0 .. 1.
    page : ndarray, (t,) int
        -1 for triangles without a place.
    chart : ndarray, (t,) int
        Numbered over all pages.
    face : ndarray, (t,) int
        The face patch of which each is a part.
    pages : int
    """

    corners: np.ndarray
    uv: np.ndarray
    page: np.ndarray
    chart: np.ndarray
    face: np.ndarray
    pages: int

    def triangles(self, size: int, normalisation: Normalisation) -> AtlasTriangles:
        """The triangles in texels of pages of this size.

        Raises
        ------
        GeometryError
            When none has a place.
        """
        found = AtlasTriangles.of(self.corners, self.uv * size, self.page, self.chart, self.face, normalisation)
        if not len(found):
            raise GeometryError(
                "no face that can be traced has an area in the UV map: unwrap anew, or choose another UV map; where "
                "there is one, a vertex may be far astray: repair the mesh"
            )
        return found


class TexelEstimator(Protocol):
    """What finds the values of texels. Four numbers stand for each until `finish` turns them into a colour."""

    def estimate(self, texels: Texels, n: int, rows: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Values (n, 4) of the first n texels, and their shares outside of solids (n,).

        `rows` are those of the page in which all texels lie; the others may help to interpolate.
        """

    def repeat(self, texels: Texels, chosen: np.ndarray, replicate: int) -> np.ndarray:
        """Values (m, 4) of the texels `chosen` (m,) from other samples."""

    def finish(self, values: np.ndarray) -> None:
        """Turn values (k, 4) into colours in place, in the first three columns; once all texels are estimated."""

    def open_color(self) -> np.ndarray:
        """(3,): the colour of a texel that nothing is known of."""


@dataclass
class TexelCounts:
    """What was found of the texels of an atlas, band by band.

    Attributes
    ----------
    texels, invalid : int
        Covered ones, and those of them that lie mostly inside of solids or have no usable surface.
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
    overlap: dict[tuple[int, int], int] = field(default_factory=dict)
    sample: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)

    def exposed(self) -> np.ndarray:
        """Share of each face outside of solids, (f,); 1 for faces without texels."""
        return 1.0 - self.hidden / np.where(self.area > 0.0, self.area, 1.0)

    def add(self, texels: Texels, valid: np.ndarray) -> None:
        """Count the first n texels of a band, with their shares outside of solids (n,)."""
        n, n_faces = len(valid), len(self.area)
        face, area = texels.face[:n], texels.area[:n]
        self.texels += n
        self.invalid += int(np.count_nonzero(valid < MIN_EXPOSED))
        self.area += np.bincount(face, area, n_faces)
        self.hidden += np.bincount(face, area * (1.0 - valid), n_faces)
        pair = np.flatnonzero((texels.overlap[1:] == texels.overlap[:-1]) & (texels.overlap[1:] < n))
        faces = np.stack([texels.overlap_face[pair], texels.overlap_face[pair + 1]], 1)
        for (one, other), count in zip(*_counted(faces), strict=True):
            if (one, other) in self.overlap or len(self.overlap) < MOST_OVERLAPS:
                self.overlap[one, other] = self.overlap.get((one, other), 0) + count

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


class TexelProgress:
    """Tells a monitor how many texels are done, from the rays cast for those of each band.

    Parameters
    ----------
    monitor : Monitor
        In a phase whose total is the number of texels.
    rays : int
        Cast from each texel, about.
    """

    def __init__(self, monitor: Monitor, rays: int) -> None:
        self._monitor, self._rays = monitor, rays
        self._lock = threading.Lock()
        self._left, self._cast = 0, 0

    def begin(self, texels: int) -> None:
        """A band of so many texels begins."""
        self._left, self._cast = texels, 0

    def cast(self, rays: int) -> None:
        """So many rays more were cast; from any thread, and may raise to cancel."""
        with self._lock:
            self._cast += rays
            done = min(self._cast // self._rays, self._left)
            self._cast -= done * self._rays
            self._left -= done
        self._monitor.advance(done)

    def end(self) -> None:
        """The band is done, however few rays it took."""
        self._monitor.advance(self._left)
        self._left = 0


def rays_per_texel(settings: BakeSettings, lightmap: LightmapSettings, texels: float) -> BakeSettings:
    """Settings without a ray budget: it is shared out over the texels, whose areas are alike.

    Sparse texels cast more rays, which is kept ready for the case that they save none.
    """
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
    counts = TexelCounts(np.zeros(n_faces), np.zeros(n_faces))
    share = ERROR_SAMPLE / max(triangles.texels(), 1.0)
    estimated = []
    for number in range(pages):
        page = AtlasPage.empty(size, on_disk=pages > 1)
        for texels, n, rows in _one_ahead(_bands(triangles, size, number)):
            progress.begin(n)
            values, valid = estimator.estimate(texels, n, rows)
            sampled = np.flatnonzero((texels.ids[:n] < share * 2.0**32) & (valid >= MIN_EXPOSED))
            if len(sampled):
                counts.sample.append((values[sampled], *(estimator.repeat(texels, sampled, k) for k in REPLICATES)))
            counts.add(texels, valid)
            page.put(texels.index[:n], values, texels.chart[:n], valid >= MIN_EXPOSED)
            progress.end()
        estimated.append(page)
    return estimated, counts


def finish_pages(
    pages: list[AtlasPage], estimator: TexelEstimator, lightmap: LightmapSettings, monitor: Monitor
) -> list[np.ndarray]:
    """The colours of pages (size, size, 4) float32, the bottom row first: holes and margins filled, alpha 1 or 0."""
    return [
        page.finish(estimator.finish, estimator.open_color(), lightmap.margin_texels, lambda: monitor.advance(0))
        for page in pages
    ]


def _one_ahead(bands: Iterator[tuple]) -> Iterator[tuple]:
    """The same bands; each is found while the one before it is traced."""
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(next, bands, None)
        while (band := following.result()) is not None:
            following = pool.submit(next, bands, None)
            yield band


def _bands(triangles: AtlasTriangles, size: int, page: int) -> Iterator[tuple[Texels, int, tuple[int, int]]]:
    """Covered texels of some rows and of the row above them, the number of those below it, and the rows."""
    height = _BAND_ROWS * max(1, min(_BAND_TEXELS // (size * _BAND_ROWS), size // (_LEAST_BANDS * _BAND_ROWS)))
    for first in range(0, size, height):
        rows = (first, min(first + height + 1, size))
        texels = covered_texels(triangles, size, page, rows)
        n = int(np.searchsorted(texels.index, (first + height) * size))
        if n:
            yield texels, n, rows


def _counted(pairs: np.ndarray) -> tuple[list[tuple[int, int]], list[int]]:
    """Distinct rows of pairs (m, 2), and how often each is there."""
    pairs, times = np.unique(pairs, axis=0, return_counts=True)
    return [(int(one), int(other)) for one, other in pairs], times.tolist()
