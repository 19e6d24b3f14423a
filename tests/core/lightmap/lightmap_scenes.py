"""Small meshes unwrapped by hand, as the arrays that a bake of a lightmap takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from obscurance_addon.core.lightmap.bake import Lightmap, bake_lightmap
from obscurance_addon.core.lightmap.layout import AtlasLayout
from obscurance_addon.core.lightmap.settings import LightmapSettings
from obscurance_addon.core.lightmap.texels import Texels, covered_texels
from obscurance_addon.core.lightmap.triangles import AtlasTriangles
from obscurance_addon.core.scene.patches import Normalisation
from obscurance_addon.core.settings import BakeSettings
from tests.core.measuring import SEEDS, Estimate
from tests.core.scenes import Mesh, Scene, box, brute_force, floor, grid, scene

SIZE = 256


@dataclass(frozen=True)
class Mapped:
    """A mesh with a place in an atlas."""

    mesh: Mesh
    uv: np.ndarray  # (t, 3, 2) in texels of its page
    chart: np.ndarray  # (t,), from 0
    page: int = 0


def flat(
    m: Mesh,
    at: Sequence[float],
    density: float,
    along_u: Sequence[float] = (1, 0, 0),
    along_v: Sequence[float] = (0, 1, 0),
    page: int = 0,
) -> Mapped:
    """One chart: the projection onto two axes, `density` texels per metre, with its lower left corner at `at`."""
    uv = density * np.stack([m.corners() @ np.asarray(axis, float) for axis in (along_u, along_v)], -1)
    return Mapped(m, uv - uv.min((0, 1)) + np.asarray(at), np.zeros(len(uv), int), page)


def six_sides(m: Mesh, at: Sequence[float], density: float, gap: int) -> Mapped:
    """The sides of a `scenes.box`, one chart each in the order of its faces, in a row from `at` on."""
    per_side = len(m.triangles) // 6
    uv = np.empty((len(m.triangles), 3, 2))
    x, y = at
    for side in range(6):
        part = slice(side * per_side, (side + 1) * per_side)
        u, v = ((side // 2 + 1) % 3, (side // 2 + 2) % 3) if side % 2 else ((side // 2 + 2) % 3, (side // 2 + 1) % 3)
        corners = density * m.corners()[part][..., [u, v]]
        uv[part] = corners - corners.min((0, 1)) + (x, y)
        x += np.ceil(np.ptp(corners[..., 0])) + gap
    return Mapped(m, uv, np.arange(len(uv)) // per_side)


def turned(mapped: Mapped, degrees: float, centre: Sequence[float]) -> Mapped:
    """The map turned about a place of the page."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return replace(mapped, uv=(mapped.uv - centre) @ np.array([[c, s], [-s, c]]) + centre)


@dataclass(frozen=True)
class MappedScene:
    """What a bake of a lightmap takes."""

    scene: Scene
    layout: AtlasLayout
    size: int = SIZE

    def bake(
        self,
        settings: BakeSettings | None = None,
        *,
        brute: bool = False,
        adaptive: bool = False,
        margin: int = 16,
        error_bound: float = 0.01,
        **kw: object,
    ) -> Lightmap:
        """Bake with Embree, or with the brute force reference; every texel on its own unless `adaptive`."""
        if brute:
            kw["intersector"] = brute_force
        s = self.scene
        lightmap = LightmapSettings(self.size, margin=margin, adaptive=adaptive, error_bound=error_bound)
        return bake_lightmap(s.surfaces, s.patches, self.layout, settings or BakeSettings(), lightmap, **kw)

    def triangles(self) -> AtlasTriangles:
        return self.layout.triangles(self.size, self.normalisation())

    def normalisation(self) -> Normalisation:
        return Normalisation.of(self.scene.patches.corners)

    def texels(self, page: int = 0) -> Texels:
        """All covered texels of a page, with areas in square metres."""
        found = covered_texels(self.triangles(), self.size, page, (0, self.size))
        return replace(found, area=found.area * self.normalisation().scale ** 2)


def mapped_scene(baked: Sequence[Mapped], others: Sequence[Mesh] = (), size: int = SIZE) -> MappedScene:
    """Every mesh is one object; charts are numbered in the order of the meshes."""
    s = scene([m.mesh for m in baked], others)
    first = np.cumsum([0] + [int(m.chart.max()) + 1 for m in baked])
    return MappedScene(
        s,
        AtlasLayout(
            s.patches.corners,
            np.concatenate([m.uv for m in baked]) / size,
            np.repeat([m.page for m in baked], [len(m.uv) for m in baked]),
            np.concatenate([m.chart + k for m, k in zip(baked, first[:-1], strict=True)]),
            s.patches.patch,
            max(m.page for m in baked) + 1,
        ),
        size,
    )


def values_at(baked: Lightmap, texels: Texels) -> np.ndarray:
    """Colours (n, 3) of texels."""
    return baked.pages[texels.page].reshape(-1, 4)[texels.index, :3].astype(np.float64)


def over_seeds(baked: Iterable[np.ndarray]) -> Estimate:
    """Mean over independent seeds, and its standard error."""
    baked = np.stack(list(baked))
    return Estimate(baked.mean(0), baked.std(0, ddof=1) / np.sqrt(len(baked)))


def bakes(s: MappedScene, texels: Texels, settings: BakeSettings, seeds: int = SEEDS, **kw: object) -> np.ndarray:
    """(seeds, n, 3): colours of texels of bakes with seeds 0, 1, ..."""
    return np.stack([values_at(s.bake(replace(settings, seed=seed), **kw), texels) for seed in range(seeds)])


def furnished(density: float = 13.0, degrees: float = 20.0, shift: float = 0.3) -> MappedScene:
    """A floor of 3 x 3 faces whose map is turned, a wall, and a crate that hovers, all mapped."""
    ground = floor((0, 0), (3, 3), 3, 3, colour=(0.2, 0.5, 0.8))
    wall = grid((0, 0, 0), (0, 3, 0), (0, 0, 1), 3, 1, colour=(0.9, 0.3, 0.1))
    crate = box((1.2, 1.1, 0.2), (1.8, 1.9, 0.7), colour=(0.1, 0.7, 0.3))
    return mapped_scene(
        [
            turned(flat(ground, (20, 20), density), degrees, (40, 40)),
            flat(wall, (100 + shift, 20 + 2 * shift), density, (0, 1, 0), (0, 0, 1)),
            six_sides(crate, (20.4, 90.7), density, 4),
        ]
    )
