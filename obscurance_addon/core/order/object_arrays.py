"""Snapshots of single objects made ready for the core. numpy only, any thread."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..scene import Patches, SceneObject, join_objects
from .arrays import shade
from .output import Target
from .patch_parts import WorldObject, baked_part
from .snapshot import BakedObject, MeshArrays, ObjectSnapshot
from .solid_meshes import with_shells
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
        self._shells: dict[int, tuple[MeshArrays, MeshArrays]] = {}  # by the mesh, which stays alive with its entry

    def occluder(self, ob: ObjectSnapshot) -> SceneObject:
        """An object that only occludes."""
        ob = self._with_shells(ob)
        surfaces = traced_surfaces(ob, WorldObject.of(ob, shade(ob)), None)
        return SceneObject(surfaces, Patches.none(), np.zeros((0, 3)), None)

    def baked(self, baked: BakedObject) -> tuple[SceneObject, np.ndarray]:
        """An object that receives values, and the patch (n,) int of each element of its unmodified mesh."""
        baked = replace(baked, snapshot=self._with_shells(baked.snapshot))
        world = WorldObject.of(baked.snapshot, shade(baked.snapshot))
        part = baked_part(baked, world, self._target)
        surfaces = traced_surfaces(baked.snapshot, world, part.face_patch)
        if baked.beside is not None:
            own = SceneObject(surfaces, Patches.none(), np.zeros((0, 3)))
            surfaces = join_objects([own, self.occluder(baked.beside)]).surfaces
        return (
            SceneObject(
                surfaces,
                Patches(part.cells, part.patch, part.ids, part.shell),
                part.reflectance if baked.snapshot.gives_color else np.full_like(part.reflectance, np.nan),
                (part.element_patch_of_node, part.node),
                part.opacity,
            ),
            part.element_patch,
        )

    def keep(self, meshes: Iterable[MeshArrays]) -> None:
        """Forget all other meshes."""
        kept = {id(mesh) for mesh in meshes}
        self._shells = {key: found for key, found in self._shells.items() if key in kept}

    def _with_shells(self, ob: ObjectSnapshot) -> ObjectSnapshot:
        mesh = ob.mesh
        if id(mesh) not in self._shells:
            self._shells[id(mesh)] = mesh, with_shells(mesh)
        return replace(ob, mesh=self._shells[id(mesh)][1])
