"""From surfaces and patches to a scene that rays can be cast in: what float32 can trace, and the ray tracer over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import GeometryError
from ..monitor import Monitor
from ..scene import Normalisation, Patches, Surfaces, bounding_box, usable_triangles
from ..settings import AUTO_DISTANCE_FRACTION, BakeSettings
from .embree import EmbreeIntersector
from .intersector import Intersector
from .reach import object_boxes, scene_size
from .rooms import Rooms
from .splitting import make_intersector
from .traced_scene import TracedScene, prepare_scene


@dataclass(frozen=True)
class Held:
    """What a bake derives from the scene as a whole, held fixed while parts of the scene change.

    Attributes
    ----------
    normalisation : Normalisation
    d_max : float
        Reach of the rays in metres.
    rays : ndarray, (p,) int, or None
        Rays of each patch; None for those that the settings say.
    """

    normalisation: Normalisation
    d_max: float
    rays: np.ndarray | None = None


class BuiltScene(NamedTuple):
    """What `build_scene` makes of a scene.

    Attributes
    ----------
    traced : TracedScene
        With rays leaving the patches.
    normalisation : Normalisation
    d_max : float
        Reach of the rays in metres.
    rooms : Rooms
    """

    traced: TracedScene
    normalisation: Normalisation
    d_max: float
    rooms: Rooms


def reach_of(surfaces: Surfaces, patches: Patches, settings: BakeSettings) -> float:
    """d_max in metres: what the settings say, or a share of the size of what is baked and stands by it."""
    if settings.distance is not None:
        return float(settings.distance)
    return AUTO_DISTANCE_FRACTION * scene_size(surfaces, patches).diagonal


def build_scene(
    surfaces: Surfaces,
    patches: Patches,
    settings: BakeSettings,
    monitor: Monitor | None = None,
    intersector: Callable[..., Intersector] = EmbreeIntersector,
    whole: bool = False,
    held: Held | None = None,
) -> BuiltScene:
    """Keep what rays can reach and float32 can trace, and build the ray tracer over it.

    Parameters as for `bake_obscurances`; `whole` keeps what is farther than d_max too.

    Raises
    ------
    GeometryError
        When there is nothing to bake: no patch, or patches without extent.
    BakeCancelledError
        When the monitor says so.
    """
    monitor = monitor or Monitor()
    if not len(patches):
        raise GeometryError("there is no face to bake: give objects with faces")
    if held is None:
        held = Held(Normalisation.of(patches.corners), reach_of(surfaces, patches, settings))
    normalisation, d_max = held.normalisation, held.d_max
    kept = np.arange(len(surfaces.triangles)) if whole else _triangles_in_reach(surfaces, patches, d_max)
    vertices = normalisation.apply(surfaces.vertices)
    if surfaces.occludes is not None:
        kept = kept[surfaces.occludes[kept]]
    usable, slender = usable_triangles(vertices, surfaces.triangles[kept])
    kept, slender = kept[usable], slender[usable]
    reached = surfaces.only(kept, vertices)
    monitor.phase("build", len(kept))
    done = 0

    def progress(count: int) -> None:
        nonlocal done
        monitor.advance(count - done)
        done = count

    finite = np.nan_to_num(vertices, nan=0.0, posinf=0.0, neginf=0.0)  # no triangle that is kept has the others
    tracer = make_intersector(intersector, finite, reached.triangles, slender, progress)
    traced, rooms = prepare_scene(reached, patches, normalisation, tracer, settings, d_max)
    return BuiltScene(traced, normalisation, d_max, rooms)


def _triangles_in_reach(surfaces: Surfaces, patches: Patches, d_max: float) -> np.ndarray:
    """Indices of the triangles of objects whose bounding box comes within d_max of the patches.

    Whole objects stay, so that the inside of a solid that is larger than d_max can still be told.
    """
    boxes = object_boxes(surfaces)
    with np.errstate(invalid="ignore"):  # of objects without triangles
        in_reach = boxes_in_reach(boxes, bounding_box(patches.corners), d_max)
    counts = np.diff(np.r_[surfaces.object_starts, len(surfaces.triangles)])
    return np.flatnonzero(np.repeat(in_reach, counts))


def boxes_in_reach(
    boxes: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], d_max: float
) -> np.ndarray:
    """Which boxes, lowest and highest corners (..., 3), come within d_max of the other box along every axis."""
    return ((boxes[0] <= other[1] + d_max) & (boxes[1] >= other[0] - d_max)).all(-1)
