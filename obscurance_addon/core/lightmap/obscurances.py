"""Obscurances of chosen texels, in a form that waits for R_ave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..obscurance import MOST_TIMES, Caster, ObscuranceSums, white_hits
from ..scene import Cells, as_triangles
from ..settings import BakeSettings
from ..tracing import TracedScene
from .texels import Texels


@dataclass(frozen=True)
class TexelValues:
    """What rays from m texels met, over the part of each outside of solids.

    Attributes
    ----------
    values : ndarray, (m, 4) float64
        What hits add per RGB channel, and the share of rays that missed: the obscurance is the first three plus the
        fourth times that of an open texel. 0 for texels inside of solids.
    valid : ndarray, (m,) float64
        Share of each texel outside of solids.
    rays : int
        Cast for them.
    traced : int
        How many of the texels cast rays of their own.
    nearness, nearest : ndarray, (m,) float64, or None
        As of `ObscuranceSums`.
    """

    values: np.ndarray
    valid: np.ndarray
    rays: int
    traced: int
    nearness: np.ndarray | None = None
    nearest: np.ndarray | None = None


# A texel with less outside of solids takes its value from its neighbours.
MIN_EXPOSED = 0.5
_CLOSE = 0.3  # to it, for the usual number of rays


class _TexelCaster(Caster):
    keeps_tables = True  # every band asks for the same ones
    favours_directions = True

    @staticmethod
    def more_rays(exposed: np.ndarray) -> np.ndarray:
        """As of `Caster`, and as many as may be where it is close whether a texel counts as inside."""
        close = np.abs(exposed - MIN_EXPOSED) < _CLOSE
        return np.where(close, MOST_TIMES, Caster.more_rays(exposed))


@dataclass(frozen=True)
class TexelTracer:
    """Casts the rays of texels; from several threads at once, if need be.

    Parameters
    ----------
    scene : TracedScene
        Its own cells are not used.
    settings : BakeSettings
        `rays` for each texel.
    as_grey : ndarray, (3,) bool
        Channels for which rho stands alone, without a colour.
    progress : callable
        Called with the number of rays just cast.
    block_rays : int
    white_reference : float, optional
        As of `white_hits`, for the obscurances of a white layer; else they are W.
    open_value : ndarray, (3,), optional
        Of a texel whose rays all miss, as well as it is known: what light is worth that coloured transparent surfaces
        let through.
    """

    scene: TracedScene
    settings: BakeSettings
    as_grey: np.ndarray
    progress: Callable[[int], None]
    block_rays: int
    white_reference: float | None = None
    open_value: np.ndarray | None = None

    def trace(
        self, texels: Texels, chosen: np.ndarray, *, factor: int = 1, replicate: int = 0, with_distances: bool = False
    ) -> TexelValues:
        """Values of the texels `chosen` (m,) int, ascending, from `factor` times the usual number of rays."""
        settings = replace(self.settings, rays=self.settings.rays * factor)
        rest = (texels.ids[chosen], settings, replicate, self.progress, self.block_rays, with_distances)
        rooms = self.scene.rooms_of_patches(texels.face[chosen])
        sums = []
        for cells in texels.cells_of(chosen):
            caster = _TexelCaster(replace(self.scene, cells=cells, rooms=rooms), *rest)
            caster.cast_all()
            sums.append(caster.patch_sums())
        return self._joined(*sums)

    def _joined(self, whole: ObscuranceSums, parts: ObscuranceSums) -> TexelValues:
        hit, miss, valid = whole.hit + parts.hit, whole.miss + parts.miss, whole.valid + parts.valid
        share = np.where(valid > 0.0, valid, np.inf)
        hit = hit / share[:, None]
        added = np.where(self.as_grey, hit[:, 3:], hit[:, :3])
        if self.white_reference is not None:
            added = white_hits(hit, self.white_reference)
        if whole.tint is not None and self.open_value is not None:
            tint = (whole.tint + parts.tint) / share[:, None]
            added = added + np.where(self.as_grey, 0.0, tint * self.open_value)
        values = np.column_stack([added, miss / share])
        found = TexelValues(values, valid, whole.rays + parts.rays, len(valid))
        if whole.nearness is None:
            return found
        nearest = np.minimum(whole.nearest, parts.nearest)
        return replace(found, nearness=whole.nearness + parts.nearness, nearest=nearest)


def texel_triangles(texels: Texels, chosen: np.ndarray) -> Cells:
    """All cells of the texels `chosen` (m,) int, which are numbered anew, as triangles."""
    whole, parts = texels.cells_of(chosen)
    whole = as_triangles(whole)
    patch = np.concatenate([whole.patch, parts.patch])
    order = np.argsort(patch, kind="stable")
    frames, offset, weight = (
        np.concatenate([getattr(whole, name), getattr(parts, name)])[order] for name in ("frames", "offset", "weight")
    )
    return Cells(frames, offset, patch[order], weight, whole.area)
