"""One bake from geometry to obscurances: the steps of the method, in order."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..monitor import Monitor
from ..sampling import allocate_rays, hash32
from ..scene import LUMINANCE, Patches, Surfaces, fill_invalid, hidden_sums, mean_of_sums, scattering_mean, surface_sums
from ..settings import BakeSettings
from ..tracing import BLOCK_RAYS, BuiltScene, EmbreeIntersector, Held, Intersector, Rooms, build_scene
from .estimator import ObscuranceSums, gather_obscurances
from .white import white_hits

# The error is measured on a sample of the patches, baked once more with independent points: all of a small scene,
# one in 32 of a large one, where 1,000 pairs already fix the RMSE to a few percent.
ERROR_SAMPLE_MIN, ERROR_SAMPLE_FRACTION = 1024, 32
MIN_OFFSETS_PER_DISTANCE = 1e3  # d_max below this many ray offsets is lost in their rounding


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
    white : ndarray, (p, 3) float64
        The obscurances as a white layer: exactly 1 for an open patch, 0 .. 2; `grey` without bleeding.
    scattering : ndarray, (3,) float64
        Mean reflectance of the surfaces that scatter light; `white` relates to its luminance.
    use_bleeding : bool
    repeated : ndarray, (p, 7) float64
        `coloured`, `grey` and `white` from independent points for the sample of patches that tells the error; else NaN.
    rmse, grey_rmse, white_rmse : ndarray, (3,) float64, float, and (3,)
        Estimated root mean square error of `coloured`, `grey` and `white` over patches, from independent point sets.
    d_max : float
        Reach of the rays in metres.
    rays : int
        Rays cast for the values; `error_rays` more were cast for the error estimate.
    sums : ObscuranceSums
        Hits and misses apart, for updates without rays.
    seconds : dict of str to float
        Time spent per phase: build, trace.
    warnings : list of str
    rooms : Rooms or None
        Who is in which room.
    """

    coloured: np.ndarray
    grey: np.ndarray
    valid: np.ndarray
    white: np.ndarray
    r_ave: np.ndarray
    scattering: np.ndarray
    use_bleeding: bool
    repeated: np.ndarray
    rmse: np.ndarray
    grey_rmse: float
    white_rmse: np.ndarray
    d_max: float
    rays: int
    error_rays: int
    sums: ObscuranceSums
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    rooms: Rooms | None = None

    @property
    def exposed(self) -> np.ndarray:
        """Share of each patch outside of solids, (p,) float64."""
        return self.sums.valid

    def relative(self) -> np.ndarray:
        """W / R_ave per channel, (p, 3) float64, without a bound; eq. 2 without bleeding or where R_ave is 0."""
        return self._relative(self.coloured, self.grey)

    def relative_again(self) -> np.ndarray:
        """`relative` of the repeated estimates, (p, 3) float64, NaN where there is none."""
        return self._relative(self.repeated[:, :3], self.repeated[:, 3])

    def _relative(self, coloured: np.ndarray, grey: np.ndarray) -> np.ndarray:
        of_open = self.r_ave if self.use_bleeding else np.ones(3)
        return np.where(of_open > 0.0, coloured / np.where(of_open > 0.0, of_open, 1.0), grey[:, None])


def bake_obscurances(
    surfaces: Surfaces,
    patches: Patches,
    settings: BakeSettings,
    *,
    neighbours: tuple[np.ndarray, np.ndarray] | None = None,
    patch_reflectance: np.ndarray | None = None,
    patch_opacity: np.ndarray | None = None,
    monitor: Monitor | None = None,
    intersector: Callable[[np.ndarray, np.ndarray, Callable[[int], None]], Intersector] = EmbreeIntersector,
    block_rays: int = BLOCK_RAYS,
    held: Held | None = None,
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
    patch_opacity : ndarray, (p,) float, optional
        Mean opacity of each patch; 1 by default.
    monitor : Monitor, optional
    intersector : callable
        Builds the ray tracer from normalised vertices, triangles and a progress callback.
    block_rays : int
        Rays per task; the result does not depend on it.
    held : Held, optional
        Takes the place of what is otherwise derived from the whole scene, so that bakes before and after a change can
        be compared bit for bit.

    Raises
    ------
    GeometryError
        When there is nothing to bake: no patch, or patches without extent.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    began = time.perf_counter()
    scene = build_scene(surfaces, patches, settings, monitor, intersector, held=held)
    built = time.perf_counter()
    result = obscurances_in(
        scene,
        surfaces,
        patches.ids,
        settings,
        neighbours=neighbours,
        patch_reflectance=patch_reflectance,
        patch_opacity=patch_opacity,
        monitor=monitor,
        block_rays=block_rays,
        rays=None if held is None else held.rays,
    )
    result.seconds["build"] = built - began
    return result


def obscurances_in(
    scene: BuiltScene,
    surfaces: Surfaces,
    ids: np.ndarray,
    settings: BakeSettings,
    *,
    neighbours: tuple[np.ndarray, np.ndarray] | None,
    patch_reflectance: np.ndarray | None,
    patch_opacity: np.ndarray | None,
    monitor: Monitor,
    block_rays: int,
    rays: np.ndarray | None = None,
) -> Obscurances:
    """`bake_obscurances` once the scene is built: its results first, then `Held.rays`."""
    began = time.perf_counter()
    traced, normalisation, d_max, rooms = scene
    sample = error_sample(ids)
    per_patch = allocate_rays(traced.cells.area, settings) if rays is None else rays
    monitor.phase("trace", int(per_patch.sum() + per_patch[sample].sum()))
    cast = functools.partial(
        gather_obscurances,
        ids=ids,
        settings=settings,
        progress=monitor.advance,
        block_rays=block_rays,
        rays=per_patch,
    )
    sums = cast(traced)
    second = cast(dataclasses.replace(traced, cells=traced.cells.of_patches(sample)), replicate=1)
    trace_seconds = time.perf_counter() - began

    of_all, hidden = surface_sums(surfaces), np.zeros(4)
    if patch_reflectance is not None:
        area = traced.cells.area * normalisation.scale**2
        hidden = hidden_sums(area, sums.valid, patch_reflectance, patch_opacity)
    r_ave, scattering = mean_of_sums(of_all[:4], hidden), scattering_mean(of_all[4:])
    values, again = (patch_values(s, r_ave, scattering, settings.use_bleeding) for s in (sums, second))
    again[~(sample & (sums.valid > 0.0) & (second.valid > 0.0))] = np.nan
    rmse = half_difference(values, again)
    valid = sums.valid > 0.0
    fill_invalid(values, valid, open_values(r_ave, settings.use_bleeding), neighbours)
    return Obscurances(
        coloured=values[:, :3],
        grey=values[:, 3],
        white=values[:, 4:],
        valid=valid,
        r_ave=r_ave,
        scattering=scattering,
        use_bleeding=settings.use_bleeding,
        repeated=again,
        rmse=rmse[:3],
        grey_rmse=float(rmse[3]),
        white_rmse=rmse[4:],
        d_max=d_max,
        rays=sums.rays,
        error_rays=second.rays,
        sums=sums,
        seconds={"build": 0.0, "trace": trace_seconds},
        warnings=precision_warnings(scene),
        rooms=rooms,
    )


def half_difference(values: np.ndarray, again: np.ndarray) -> np.ndarray:
    """Root mean square error (k,) of values (p, k), from independent estimates of some; NaN rows of `again` are out."""
    difference = (values - again)[~np.isnan(again).any(1)]
    return np.sqrt((difference**2).sum(0) / (2.0 * max(len(difference), 1)))


def error_sample(ids: np.ndarray) -> np.ndarray:
    """(p,) bool: the patches to bake twice, spread evenly by a hash of their identity."""
    size = max(ERROR_SAMPLE_MIN, len(ids) // ERROR_SAMPLE_FRACTION)
    sample = np.zeros(len(ids), bool)
    sample[np.argsort(hash32(ids), kind="stable")[:size]] = True
    return sample


def patch_values(sums: ObscuranceSums, r_ave: np.ndarray, scattering: np.ndarray, use_bleeding: bool) -> np.ndarray:
    """(p, 7) float64: W per channel, W without colour, and the white layer; NaN for invalid patches."""
    grey = sums.grey()[:, None]
    if not use_bleeding:
        return np.repeat(grey, 7, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        white = white_hits(sums.hit / sums.valid[:, None], scattering @ LUMINANCE)
        white += sums.missed() / sums.valid[:, None]
    return np.hstack([sums.coloured(r_ave), grey, white])


def open_values(r_ave: np.ndarray, use_bleeding: bool) -> np.ndarray:
    """`patch_values` of an open patch, (7,) float64."""
    return np.concatenate([r_ave if use_bleeding else np.ones(3), np.ones(4)])


def precision_warnings(scene: BuiltScene) -> list[str]:
    """What the user should know about the precision of this bake."""
    cells, scale, d_max = scene.traced.cells, scene.normalisation.scale, scene.d_max
    blurred = np.bincount(cells.patch, cells.offset * scale * MIN_OFFSETS_PER_DISTANCE > d_max) > 0
    if not blurred.any():
        return []
    return [
        f"the distance of {d_max:g} is too small for {np.count_nonzero(blurred)} patches that are far from the centre "
        f"of the scene or very large: rays start up to {float(cells.offset.max()) * scale:.3g} above them; use a "
        "larger distance, or bake distant or huge objects apart"
    ]
