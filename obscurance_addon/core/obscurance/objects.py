"""The obscurances of objects."""

from __future__ import annotations

from collections.abc import Iterable

from ..monitor import Monitor
from ..scene import SceneObject, join_objects
from ..settings import BakeSettings
from .bake import Obscurances, bake_obscurances


def bake_objects(
    objects: Iterable[SceneObject], settings: BakeSettings | None = None, *, monitor: Monitor | None = None
) -> Obscurances:
    """Compute the obscurances of all patches of objects that stand in one scene.

    Parameters
    ----------
    objects : iterable of SceneObject
        As `mesh_object` makes them.
    settings : BakeSettings, optional
    monitor : Monitor, optional
        Hears how far the bake is, and may stop it.

    Returns
    -------
    Obscurances
        The patches of the first object, then those of the second, and so on.

    Raises
    ------
    GeometryError
        When no object has patches, or they have no extent.
    BackendError
        When the ray tracer is missing.
    BakeCancelledError
        When the monitor says so.
    """
    joined = join_objects(objects)
    return bake_obscurances(
        joined.surfaces,
        joined.patches,
        settings or BakeSettings(),
        neighbours=joined.neighbours,
        patch_reflectance=joined.patch_reflectance,
        patch_opacity=joined.patch_opacity,
        monitor=monitor,
    )
