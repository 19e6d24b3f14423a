"""One bake from geometry to obscurances: the steps of the method, in order."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .embree import EmbreeIntersector
from .errors import GeometryError
from .filling import fill_invalid
from .obscurance import ObscuranceSums, gather_obscurances
from .patch_samples import BLOCK_RAYS
from .patches import Normalisation, Patches, Surfaces, bounding_box, slices, triangle_areas, usable_triangles
from .ray_allocation import allocate_rays
from .ray_casting import Intersector
from .settings import BakeSettings
from .sobol import hash32
from .traced_scene import TracedScene, prepare_scene

# The error is measured on a sample of the patches, baked once more with independent points: all of a small scene,
# one in 32 of a large one, where 1,000 pairs already fix the RMSE to a few percent.
ERROR_SAMPLE_MIN, ERROR_SAMPLE_FRACTION = 1024, 32
MIN_OFFSETS_PER_DISTANCE = 1e3  # d_max below this many ray offsets is lost in their rounding


class Monitor:
    """Hears how far a bake is (the base class does not care); may raise `BakeCancelledError` to stop it."""

    def phase(self, name: str, total: int) -> None:
        """A new phase ("build" or "trace") begins with `total` units of work (triangles or rays)."""

    def advance(self, amount: int) -> None:
        """That much more is done; called from any thread."""


@dataclass(frozen=True)
class Obscurances:
    """What a bake computed.

    Attributes
    ----------
    coloured : ndarray, (p, 3) float64
        W with colour bleeding (eqs. 5, 6); equal columns of `grey` without bleeding.
    grey : ndarray, (p,) float64
        W without colour (eq. 2), 0 .. 1.
    valid : ndarray, (p,) bool
        False for patches without usable surface or wholly inside of solids. Their values come from valid neighbours,
        or are those of an open patch where there is none.
    r_ave : ndarray, (3,) float64
        Mean reflectance of the scene's surfaces, patches inside of solids left out.
    use_bleeding : bool
    rmse, grey_rmse : ndarray, (3,) float64, and float
        Estimated root mean square error of `coloured` and of `grey` over patches, from independent point sets.
    d_max : float
        Reach of the rays in metres.
    rays : int
        Rays cast for the values; `error_rays` more were cast for the error estimate.
    sums : ObscuranceSums
        Hits and misses apart, for updates without rays.
    seconds : dict of str to float
        Time spent per phase: build, trace.
    warnings : list of str
    """

    coloured: np.ndarray
    grey: np.ndarray
    valid: np.ndarray
    r_ave: np.ndarray
    use_bleeding: bool
    rmse: np.ndarray
    grey_rmse: float
    d_max: float
    rays: int
    error_rays: int
    sums: ObscuranceSums
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def white(self) -> np.ndarray:
        """W / R_ave per channel, (p, 3) float64: an open patch is 1. Eq. 2 without bleeding or where R_ave is 0."""
        white = self._white()
        return np.where(white > 0.0, self.coloured / np.where(white > 0.0, white, 1.0), self.grey[:, None])

    def white_rmse(self) -> np.ndarray:
        """Estimated error of `white`, (3,) float64."""
        white = self._white()
        return np.where(white > 0.0, self.rmse / np.where(white > 0.0, white, 1.0), self.grey_rmse)

    def _white(self) -> np.ndarray:
        """Value of an open patch per channel, (3,) float64."""
        return self.r_ave if self.use_bleeding else np.ones(3)


def bake_obscurances(
    surfaces: Surfaces,
    patches: Patches,
    settings: BakeSettings,
    *,
    neighbours: tuple[np.ndarray, np.ndarray] | None = None,
    patch_reflectance: np.ndarray | None = None,
    monitor: Monitor | None = None,
    intersector: Callable[[np.ndarray, np.ndarray, Callable[[int], None]], Intersector] = EmbreeIntersector,
    block_rays: int = BLOCK_RAYS,
) -> Obscurances:
    """Compute the obscurances of patches among surfaces.

    Parameters
    ----------
    surfaces : Surfaces
        All that rays can hit, the patches' own surfaces included.
    patches : Patches
    settings : BakeSettings
    neighbours : tuple of two ndarray (m,) int, optional
        Pairs (patch, node): patches that share a node are neighbours, from which invalid patches take their value.
    patch_reflectance : ndarray, (p, 3) float, optional
        Mean reflectance of each patch; with it, R_ave leaves out what lies inside of solids.
    monitor : Monitor, optional
    intersector : callable
        Builds the ray tracer from normalised vertices, triangles and a progress callback.
    block_rays : int
        Rays per task; the result does not depend on it.

    Raises
    ------
    GeometryError
        When there is nothing to bake: no patch, or patches without extent.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    if not len(patches):
        raise GeometryError("there is no face to bake")
    began = time.perf_counter()
    scene, normalisation, d_max = build_scene(surfaces, patches, settings, monitor, intersector)
    built = time.perf_counter()

    sample = _error_sample(patches.ids)
    per_patch = allocate_rays(scene.cells.area, settings)
    monitor.phase("trace", int(per_patch.sum() + per_patch[sample].sum()))
    cast = functools.partial(
        gather_obscurances, ids=patches.ids, settings=settings, progress=monitor.advance, block_rays=block_rays
    )
    sums = cast(scene)
    second = cast(dataclasses.replace(scene, cells=scene.cells.of_patches(sample)), replicate=1)
    traced = time.perf_counter()

    r_ave = mean_reflectance(surfaces, scene.cells.area * normalisation.scale**2, sums.valid, patch_reflectance)
    values, again = (_values(s, r_ave, settings.use_bleeding) for s in (sums, second))
    difference = (values - again)[sample & (sums.valid > 0.0) & (second.valid > 0.0)]
    rmse = np.sqrt((difference**2).sum(0) / (2.0 * max(len(difference), 1)))
    valid = sums.valid > 0.0
    fill_invalid(values, valid, np.append(r_ave if settings.use_bleeding else np.ones(3), 1.0), neighbours)
    return Obscurances(
        coloured=values[:, :3],
        grey=values[:, 3],
        valid=valid,
        r_ave=r_ave,
        use_bleeding=settings.use_bleeding,
        rmse=rmse[:3],
        grey_rmse=float(rmse[3]),
        d_max=d_max,
        rays=sums.rays,
        error_rays=second.rays,
        sums=sums,
        seconds={"build": built - began, "trace": traced - built},
        warnings=_warnings(scene, d_max, normalisation.scale),
    )


def scene_diagonal(surfaces: Surfaces) -> float:
    """Diagonal of the bounding box of all finite vertices, metres."""
    low, high = bounding_box(surfaces.vertices)
    return float(np.linalg.norm(high - low))


def mean_reflectance(
    surfaces: Surfaces, patch_area: np.ndarray, exposed: np.ndarray, patch_reflectance: np.ndarray | None
) -> np.ndarray:
    """R_ave = sum A_i R_i / A_total per channel, over all surfaces but the parts of patches hidden inside of solids.

    Parameters
    ----------
    surfaces : Surfaces
    patch_area : ndarray, (p,) float64
        Square metres.
    exposed : ndarray, (p,) float64
        Share of each patch outside of solids, 0 .. 1.
    patch_reflectance : ndarray, (p, 3) float, or None
        None leaves nothing out.

    Returns
    -------
    ndarray, (3,) float64
    """
    triangles = surfaces.triangles
    area = np.empty(len(triangles))
    for part in slices(len(triangles)):
        area[part] = triangle_areas(surfaces.vertices[triangles[part]])
    area[~np.isfinite(area)] = 0.0
    total, weighted = area.sum(), area @ surfaces.reflectance.astype(np.float64)
    if patch_reflectance is not None:
        hidden = patch_area * (1.0 - exposed)
        if hidden.sum() < (1.0 - 1e-9) * total:
            total, weighted = total - hidden.sum(), weighted - hidden @ patch_reflectance
    return np.clip(weighted / total, 0.0, 1.0) if total > 0.0 else np.zeros(3)


def build_scene(
    surfaces: Surfaces,
    patches: Patches,
    settings: BakeSettings,
    monitor: Monitor | None = None,
    intersector: Callable[..., Intersector] = EmbreeIntersector,
) -> tuple[TracedScene, Normalisation, float]:
    """Keep what rays can reach and float32 can trace, and build the ray tracer over it.

    Parameters as for `bake_obscurances`.

    Returns
    -------
    scene : TracedScene
    normalisation : Normalisation
    d_max : float
        Metres.
    """
    monitor = monitor or Monitor()
    normalisation = Normalisation.of(patches.corners)
    d_max = settings.max_distance(scene_diagonal(surfaces))
    kept = _triangles_in_reach(surfaces, patches, d_max)
    vertices = normalisation.apply(surfaces.vertices)
    kept = kept[usable_triangles(vertices, surfaces.triangles[kept])]
    reached = Surfaces(vertices, surfaces.triangles[kept], surfaces.reflectance[kept], surfaces.solid[kept])
    monitor.phase("build", len(kept))
    done = 0

    def progress(count: int) -> None:
        nonlocal done
        monitor.advance(count - done)
        done = count

    finite = np.nan_to_num(vertices, nan=0.0, posinf=0.0, neginf=0.0)  # no triangle that is kept has the others
    tracer = intersector(finite, reached.triangles, progress)
    return prepare_scene(reached, patches, normalisation, tracer, settings, d_max), normalisation, d_max


def _triangles_in_reach(surfaces: Surfaces, patches: Patches, d_max: float) -> np.ndarray:
    """Indices of the triangles of objects whose bounding box comes within d_max of the patches.

    Whole objects stay, so that the inside of a solid that is larger than d_max can still be told. Vertices of an object
    stand together, so the range of their indices is enough to find its box.
    """
    low, high = bounding_box(patches.corners)
    starts = np.r_[surfaces.object_starts, len(surfaces.triangles)]
    in_reach = np.zeros(len(surfaces.triangles), bool)
    for first, end in itertools.pairwise(starts):
        used = surfaces.triangles[first:end]
        if not len(used):
            continue
        object_low, object_high = bounding_box(surfaces.vertices[used.min() : used.max() + 1])
        in_reach[first:end] = (object_low <= high + d_max).all() and (object_high >= low - d_max).all()
    return np.flatnonzero(in_reach)


def _error_sample(ids: np.ndarray) -> np.ndarray:
    """(p,) bool: the patches to bake twice, spread evenly by a hash of their identity."""
    size = max(ERROR_SAMPLE_MIN, len(ids) // ERROR_SAMPLE_FRACTION)
    sample = np.zeros(len(ids), bool)
    sample[np.argsort(hash32(ids), kind="stable")[:size]] = True
    return sample


def _values(sums: ObscuranceSums, r_ave: np.ndarray, use_bleeding: bool) -> np.ndarray:
    """(p, 4): W per channel and W without colour."""
    grey = sums.grey()[:, None]
    return np.hstack([sums.coloured(r_ave) if use_bleeding else np.repeat(grey, 3, axis=1), grey])


def _warnings(scene: TracedScene, d_max: float, scale: float) -> list[str]:
    """What the user should know about the precision of this bake."""
    cells = scene.cells
    blurred = np.bincount(cells.patch, cells.offset * scale * MIN_OFFSETS_PER_DISTANCE > d_max) > 0
    if not blurred.any():
        return []
    return [
        f"the distance of {d_max:g} is too small for {np.count_nonzero(blurred)} patches that are far from the centre "
        f"of the scene or very large: rays start up to {float(cells.offset.max()) * scale:.3g} above them; use a "
        "larger distance, or bake distant or huge objects apart"
    ]
