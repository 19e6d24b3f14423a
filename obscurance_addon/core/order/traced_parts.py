"""What rays meet of one object: its triangles but for those that let all light through. numpy only, any thread."""

from __future__ import annotations

import numpy as np

from ..scene import LEAST_TRANSMISSION, Surfaces, Transmission
from ..shading import PlaceLookup
from .patch_parts import WorldObject
from .snapshot import ObjectSnapshot


def material_slots(ob: ObjectSnapshot) -> np.ndarray:
    """Which of the shadings each face has, (f,); the last one stands for faces of objects without slots."""
    slots = len(ob.shadings) - 1
    return np.clip(ob.mesh.face_material, 0, max(slots - 1, 0))  # beyond the slots the last one counts, as in Cycles


def traced_surfaces(ob: ObjectSnapshot, world: WorldObject, face_patch: np.ndarray | None) -> Surfaces:
    """The triangles of one object whose mesh has its shells; reflectance is NaN where others do not see it.

    Rays do not meet those that let all light through; an object with nothing else has no triangles. `face_patch` is the
    patch of each face (f,) int, -1 for none.
    """
    shells = ob.mesh.shells
    transmission = None if world.transmission is None else _transmission(ob, world)
    if transmission is not None:
        shells = shells.without_windows(transmission.mean.any(1))
    absent = world.is_absent()[ob.mesh.triangle_face]
    kept = np.arange(0 if absent.all() else len(absent))
    face, occludes = ob.mesh.triangle_face[kept], ob.occludes & ~absent[kept]
    return Surfaces(
        vertices=world.vertices if len(kept) else world.vertices[:0],
        triangles=world.triangles[kept],
        reflectance=world.reflectance[face] if ob.gives_color else np.full((len(face), 3), np.nan, np.float32),
        shells=shells.only(kept),
        emission=world.emission[face] * np.float32(ob.gives_color),
        patch=None if face_patch is None else face_patch[face].astype(np.int32),
        occludes=None if occludes.all() else occludes,
        transmission=None if transmission is None else transmission.only(kept),
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
