"""A scene made ready for casting: look-up tables beside the ray tracer, shared by every pass and every thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..falloff import Falloff
from ..scene import Cells, Normalisation, Patches, Surfaces, prepare_cells
from ..settings import BakeSettings
from .intersector import Intersector
from .transparency import Transparency

FAR = np.float32(1e30)  # stands for an infinite ray length, so that 0 x length stays 0
NEAR = np.float32(1e-30)  # the shortest ray length, so that length / length stays 1


@dataclass(frozen=True)
class TracedScene:
    """A scene and what a bake of it needs besides.

    Attributes
    ----------
    cells : Cells
    surfaces : Surfaces
        In normalised coordinates, in the order in which `intersector` numbers triangles.
    intersector : Intersector
    palette : ndarray, (t + 1, 4) float32, or None
        Reflectance and 1 of each triangle, row 0 for misses; None where hits add no colour.
    solid : ndarray, (t + 1,) bool, or None
        Triangles of closed solids, entry 0 for misses; None when there is none.
    limit : float32
        d_max in normalised units.
    scale : float32
        1 / limit, 0 for an infinite d_max.
    falloff : Falloff
    transparency : Transparency or None
        None where everything is opaque.
    """

    cells: Cells
    surfaces: Surfaces
    intersector: Intersector
    palette: np.ndarray | None
    solid: np.ndarray | None
    limit: np.float32
    scale: np.float32
    falloff: Falloff
    transparency: Transparency | None = None

    @property
    def needs_only_occlusion(self) -> bool:
        """STEP asks only whether something was hit, unless solids are told from within, or something is transparent."""
        return self.falloff is Falloff.STEP and self.solid is None and self.transparency is None


def prepare_scene(
    surfaces: Surfaces,
    patches: Patches,
    normalisation: Normalisation,
    intersector: Intersector,
    settings: BakeSettings,
    d_max: float,
) -> TracedScene:
    """Build the look-up tables of a scene.

    Parameters
    ----------
    surfaces : Surfaces
        The triangles in the order in which `intersector` numbers them.
    patches : Patches
    normalisation : Normalisation
        The one with which `intersector` was built.
    intersector : Intersector
    settings : BakeSettings
    d_max : float
        Reach of the rays in metres, above 0, may be infinite.
    """
    palette = None
    if needs_palette(settings):
        palette = np.zeros((len(surfaces.triangles) + 1, 4), np.float32)
        palette[1:, :3] = palette_colours(surfaces)
        palette[1:, 3] = 1.0
    solid = np.concatenate([[False], surfaces.solid]) if surfaces.solid.any() else None
    limit, scale = limit_and_scale(d_max, normalisation)
    return TracedScene(
        prepare_cells(patches, normalisation, settings.thread_count()),
        surfaces,
        intersector,
        palette,
        solid,
        limit,
        scale,
        settings.falloff,
        Transparency.of(surfaces.transmission, normalisation),
    )


def needs_palette(settings: BakeSettings) -> bool:
    """Whether the colour of a hit counts: a STEP hit adds nothing, whatever its colour."""
    return settings.use_bleeding and settings.falloff is not Falloff.STEP


def palette_colours(surfaces: Surfaces) -> np.ndarray:
    """Colours (t, 3) float32 of hits on each triangle: black where nothing sees it."""
    return np.nan_to_num(surfaces.reflectance, nan=0.0)


def limit_and_scale(d_max: float, normalisation: Normalisation) -> tuple[np.float32, np.float32]:
    """`TracedScene.limit` and `TracedScene.scale` for a reach of d_max metres."""
    limit = np.float32(np.clip(d_max / normalisation.scale, NEAR, FAR))
    return limit, np.float32(0.0) if limit == FAR else np.float32(1.0) / limit
