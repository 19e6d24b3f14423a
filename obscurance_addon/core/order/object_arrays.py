"""Snapshots of single objects made ready for the core. numpy only, any thread."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..scene import Patches, SceneObject, join_objects, solid_triangles
from .arrays import shade
from .output import Target
from .patch_parts import WorldObject, baked_part
from .snapshot import BakedObject, MeshArrays, ObjectSnapshot
from .traced_parts import traced_surfaces


class ObjectArrays:
    """Turns snapshots into objects of the core; what only depends on a mesh is found once.

    Parameters
    ----------
    target : Target
        What values belong to; not LIGHTMAP.
    """

    def __init__(self, target: Target) -> None:
        self._target = target
        self._solid: dict[int, tuple[MeshArrays, np.ndarray]] = {}  # by the mesh, which stays alive with its entry

    def occluder(self, ob: ObjectSnapshot) -> SceneObject:
        """An object that only occludes."""
        surfaces = traced_surfaces(ob, WorldObject.of(ob, shade(ob)), self._solid_triangles(ob.mesh), None)
        return SceneObject(surfaces, Patches.none(), np.zeros((0, 3)), None)

    def baked(self, baked: BakedObject) -> tuple[SceneObject, np.ndarray]:
        """An object that receives values, and the patch (n,) int of each element of its unmodified mesh."""
        world = WorldObject.of(baked.snapshot, shade(baked.snapshot))
        part = baked_part(baked, world, self._target)
        surfaces = traced_surfaces(baked.snapshot, world, self._solid_triangles(baked.snapshot.mesh), part.face_patch)
        if baked.beside is not None:
            own = SceneObject(surfaces, Patches.none(), np.zeros((0, 3)))
            surfaces = join_objects([own, self.occluder(baked.beside)]).surfaces
        return (
            SceneObject(
                surfaces,
                Patches(part.cells, part.patch, part.ids),
                part.reflectance if baked.snapshot.gives_color else np.full_like(part.reflectance, np.nan),
                (part.element_patch_of_node, part.node),
                part.opacity,
            ),
            part.element_patch,
        )

    def keep(self, meshes: Iterable[MeshArrays]) -> None:
        """Forget all other meshes."""
        kept = {id(mesh) for mesh in meshes}
        self._solid = {key: found for key, found in self._solid.items() if key in kept}

    def _solid_triangles(self, mesh: MeshArrays) -> np.ndarray:
        if id(mesh) not in self._solid:
            triangles = mesh.corner_vertex[mesh.triangle_corners]
            self._solid[id(mesh)] = mesh, solid_triangles(mesh.positions, triangles)
        return self._solid[id(mesh)][1]
