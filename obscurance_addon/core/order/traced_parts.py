"""What rays meet of one object: its triangles but for those that let all light through. numpy only, any thread."""

from __future__ import annotations

import numpy as np

from ..scene import LEAST_TRANSMISSION, Surfaces, Transmission, windowless_shells
from ..shading import PlaceLookup
from .patch_parts import WorldObject
from .snapshot import ObjectSnapshot


def material_slots(ob: ObjectSnapshot) -> np.ndarray:
    """Which of the shadings each face has, (f,); the last one stands for faces of objects without slots."""
    slots = len(ob.shadings) - 1
    return np.clip(ob.mesh.face_material, 0, max(slots - 1, 0))  # beyond the slots the last one counts, as in Cycles


def traced_surfaces(
    ob: ObjectSnapshot, world: WorldObject, solid: np.ndarray, face_patch: np.ndarray | None
) -> Surfaces:
    """The triangles of one object that rays can hit; reflectance is NaN where others do not see it.

    Parameters
    ----------
    ob : ObjectSnapshot
    world : WorldObject
    solid : ndarray, (t,) bool
        Of closed shells, by their shape alone.
    face_patch : ndarray, (f,) int, or None
        The patch of each face, -1 for none.
    """
    face = ob.mesh.triangle_face
    vertices, triangles = world.vertices, world.triangles
    transmission = None
    if world.transmission is not None:
        transmission = _transmission(ob, world)
        if transmission is not None and solid.any():
            solid = solid & windowless_shells(ob.mesh.positions, triangles, transmission.mean.any(1))
    if (gone := world.is_absent()).any():
        kept = np.flatnonzero(~gone[face])
        vertices = vertices if len(kept) else vertices[:0]
        triangles, solid, face = triangles[kept], solid[kept], face[kept]
        transmission = transmission.only(kept)
    return Surfaces(
        vertices=vertices,
        triangles=triangles,
        reflectance=world.reflectance[face] if ob.gives_color else np.full((len(face), 3), np.nan, np.float32),
        solid=solid,
        emission=world.emission[face] * np.float32(ob.gives_color),
        patch=None if face_patch is None else face_patch[face].astype(np.int32),
        occludes=None if ob.occludes else np.zeros(len(triangles), bool),
        transmission=transmission,
    )


def _transmission(ob: ObjectSnapshot, world: WorldObject) -> Transmission | None:
    """What passes the triangles of an object."""
    face = ob.mesh.triangle_face
    mean = world.transmission[face]
    mean[mean.max(1) < LEAST_TRANSMISSION] = 0.0
    varies = np.array([shading.transmission_varies() for shading in ob.shadings])
    slot = material_slots(ob)[face]
    local = np.flatnonzero(varies[slot] & mean.any(1))
    found = Transmission.uniform(mean)
    if found is None or not len(local):
        return found
    textured = np.full(len(face), -1, np.int32)
    textured[local] = np.arange(len(local), dtype=np.int32)
    return Transmission(
        mean,
        textured,
        world.vertices[ob.mesh.corner_vertex[ob.surface.triangle_corners[local]]],
        local.astype(np.int32),
        slot[local].astype(np.int32),
        tuple(PlaceLookup(shading.transmission, ob.surface) for shading in ob.shadings),
    )
