"""The open file as arrays of light, for the benchmarks and the figures."""

from __future__ import annotations

import bpy
import numpy as np

from obscurance_addon.blender.reading.scene import snapshot_scene
from obscurance_addon.blender.reading.visibility import rendered_meshes
from obscurance_addon.core.light.bake import bake_light
from obscurance_addon.core.light.direct import LitScene
from obscurance_addon.core.light.radiosity import shoot_random_walks
from obscurance_addon.core.light.records import BakedLight
from obscurance_addon.core.light.settings import LightSettings
from obscurance_addon.core.order.arrays import BakeArrays, prepare_arrays
from obscurance_addon.core.order.output import Target
from obscurance_addon.core.order.snapshot import SceneSnapshot
from obscurance_addon.core.scene.patches import triangle_areas
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene

RAYS = 64


class LightScene:
    """All meshes of the open file, every face a patch.

    Attributes
    ----------
    objects : list of bpy.types.Object
    area : ndarray, (p,) float64
        Of each patch, square metres.
    """

    def __init__(self) -> None:
        self.objects = rendered_meshes(bpy.context)
        self.snapshot: SceneSnapshot = snapshot_scene(bpy.context, self.objects, needs_light=True)
        self.arrays: BakeArrays = prepare_arrays(self.snapshot, Target.FACE, needs_light=True)
        patches = self.arrays.patches
        self.area = np.bincount(patches.patch, triangle_areas(patches.corners), len(patches))

    def bake(
        self,
        rays: int = RAYS,
        seed: int = 0,
        bleeding: bool = True,
        distance: float | None = None,
        **light: object,
    ) -> BakedLight:
        """A bake of light of all patches."""
        arrays = self.arrays
        return bake_light(
            arrays.surfaces,
            arrays.patches,
            arrays.others,
            arrays.materials,
            self.snapshot.sources,
            BakeSettings(rays, seed=seed, use_bleeding=bleeding, distance=distance),
            LightSettings(**light),
            neighbours=arrays.neighbours,
        )

    def walk(self, walks: int) -> tuple[np.ndarray, int]:
        """Direct light by the bake, then a shooting random walk from what it makes surfaces scatter."""
        arrays, settings = self.arrays, BakeSettings(RAYS)
        direct = self.bake(quantity="DIRECT")
        traced, normalisation, *_ = build_scene(arrays.surfaces, arrays.patches, settings, whole=True)
        scene = LitScene(traced, arrays.patches.ids, (), None, np.zeros(3))
        unshot = direct.radiance * np.pi * direct.valid[:, None]
        area = traced.cells.area * normalisation.scale**2 * direct.exposed
        indirect, rays = shoot_random_walks(scene, arrays.materials.reflectance, unshot, area, direct.exposed, walks)
        return indirect / np.pi, rays + direct.rays + direct.error_rays
