"""A scene made ready for casting: look-up tables beside the ray tracer, shared by every pass and every thread."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..falloff import Falloff
from ..scene import Cells, Normalisation, Patches, Surfaces, prepare_cells
from ..settings import BakeSettings
from .bodies import FAR, Bodies, BodyShapes
from .facing import looking_away
from .intersector import Hits, Intersector
from .rooms import Rooms, ShellPoints, settle_rooms
from .transparency import Transparency

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
    bodies : Bodies or None
        What is solid; None when nothing is.
    rooms : ndarray, (p, depth) int32, or None
        Bodies that are rooms for each patch, 0 for none; None where no patch is in a room.
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
    bodies: Bodies | None
    rooms: np.ndarray | None
    limit: np.float32
    scale: np.float32
    falloff: Falloff
    transparency: Transparency | None = None

    def rooms_of_patches(self, patches: np.ndarray) -> np.ndarray | None:
        """Rooms (m, depth) of some patches (m,) int; None where no patch is in a room."""
        return None if self.rooms is None else self.rooms[patches]

    def rooms_of(self, cells: np.ndarray, n: int) -> np.ndarray | None:
        """Rooms (m n, depth) of the rays of cells (m,), n of each; None where no patch is in a room."""
        return None if self.rooms is None else np.repeat(self.rooms[self.cells.patch[cells]], n, axis=0)

    def meets_inside(self, directions: np.ndarray, hits: Hits, rooms: np.ndarray | None) -> np.ndarray:
        """(n,) bool: rays whose first hit is the inside of a body that is no room of theirs; there is a body."""
        inside = self.bodies.left_first(directions, hits)
        self.bodies.spare_rooms(inside, hits, rooms)
        return inside

    @property
    def needs_only_occlusion(self) -> bool:
        """STEP asks only whether something was hit, unless solids are told from within, or something is transparent."""
        return self.falloff is Falloff.STEP and self.bodies is None and self.transparency is None


def prepare_scene(
    surfaces: Surfaces,
    patches: Patches,
    normalisation: Normalisation,
    intersector: Intersector,
    settings: BakeSettings,
    d_max: float,
) -> tuple[TracedScene, Rooms]:
    """Build the look-up tables of a scene, and find its rooms.

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
    bodies, body = None, surfaces.shells.body
    if body.any():
        shapes = BodyShapes.of(surfaces.vertices, surfaces.triangles, body)
        bodies = Bodies(np.append(np.int32(0), body), shapes)
    bodies, rooms = settle_rooms(ShellPoints.of(surfaces.vertices, surfaces.triangles, surfaces.shells), bodies)
    cells = prepare_cells(patches, normalisation, settings.thread_count())
    if patches.shell is not None and len(surfaces.triangles):
        rooms = replace(rooms, away=looking_away(cells, patches.shell, surfaces, intersector))
    limit, scale = limit_and_scale(d_max, normalisation)
    return TracedScene(
        cells,
        surfaces,
        intersector,
        palette,
        bodies,
        None if patches.shell is None else rooms.of(patches.shell),
        limit,
        scale,
        settings.falloff,
        Transparency.of(surfaces.transmission, normalisation),
    ), rooms


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
