"""Reflectance and emission at the texels of a lightmap, where materials vary over a face. numpy only, any thread."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..lightmap import AtlasLayout
from ..shading import SurfaceArrays, shade_faces
from .arrays import BakeArrays
from .snapshot import ObjectSnapshot
from .traced_parts import material_slots

# A triangle of half a texel about the middle of each, over which textures are averaged; in texels.
_AROUND = np.array([[-0.5, -1.0 / 3.0], [0.5, -1.0 / 3.0], [0.0, 2.0 / 3.0]])


class TexelMaterials:
    """Looks materials up, as `core.lightmap.light.bake_light_map` asks for them.

    Parameters
    ----------
    objects : list of ObjectSnapshot
        In the order in which their triangles stand in the layout.
    layout : AtlasLayout
    arrays : BakeArrays
        With whole faces as patches: what does not vary over a face comes from there.
    size : int
        Texels along the side of a page.
    """

    def __init__(self, objects: list[ObjectSnapshot], layout: AtlasLayout, arrays: BakeArrays, size: int) -> None:
        self._objects, self._layout, self._arrays, self._size = objects, layout, arrays, size
        self._first = np.cumsum([0] + [len(ob.mesh.triangle_corners) for ob in objects])

    def __call__(self, triangle: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reflectance and emission (m, 3) float64 of triangles (m,) of the layout at places (m, 2) in texels."""
        face = self._layout.face[triangle]
        materials = self._arrays.materials
        reflectance, emission = materials.reflectance[face], materials.emission[face]
        owner = np.searchsorted(self._first, triangle, side="right") - 1
        for number in np.unique(owner):
            ob = self._objects[number]
            if not len(ob.surface.triangle_corners):  # nothing varies
                continue
            of = np.flatnonzero(owner == number)
            own = triangle[of] - self._first[number]
            corners = self._barycentric(triangle[of], place[of])
            # The layout may have their corners the other way round.
            turned = ob.mesh.triangle_corners[own, 0] != ob.surface.triangle_corners[own, 0]
            turned ^= np.linalg.det(ob.matrix[:3, :3]) < 0.0
            corners = np.where(turned[:, None, None], corners[..., ::-1], corners)
            surface = _small_triangles(ob.surface, own, corners.astype(np.float32))
            shaded = shade_faces(ob.shadings, material_slots(ob)[ob.mesh.triangle_face[own]], surface)
            reflectance[of], emission[of] = shaded.reflectance, shaded.emission
        return reflectance, emission

    def _barycentric(self, triangle: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Coordinates (m, 3, 3) of the three places around each, in terms of the corners of triangles (m,)."""
        uv = self._layout.uv[triangle] * self._size
        edges = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], 1)
        offset = place[:, None] + _AROUND - uv[:, :1]
        b = offset @ np.linalg.inv(edges)
        return np.concatenate([1.0 - b.sum(2, keepdims=True), b], 2)


def _small_triangles(surface: SurfaceArrays, triangle: np.ndarray, corners: np.ndarray) -> SurfaceArrays:
    """A surface of one face for each triangle (m,), with corners (m, 3, 3) in barycentric coordinates on it."""
    m = len(triangle)
    of = surface.triangle_corners[triangle]

    def at_corners(values: np.ndarray) -> np.ndarray:
        return np.matmul(corners, values).reshape(3 * m, -1)

    def color(domain: str, values: np.ndarray) -> np.ndarray:
        if domain == "FACE":
            return np.repeat(values[surface.triangle_face[triangle]], 3, axis=0)
        return at_corners(values[of if domain == "CORNER" else surface.corner_vertex[of]])

    colors: Mapping = {name: ("CORNER", color(*stored)) for name, stored in surface.color.items()}
    return SurfaceArrays(
        triangle_corners=np.arange(3 * m, dtype=np.int32).reshape(-1, 3),
        triangle_face=np.arange(m, dtype=np.int32),
        triangle_area=np.ones(m, np.float32),
        corner_vertex=np.zeros(3 * m, np.int32),
        uv={name: at_corners(values[of]) for name, values in surface.uv.items()},
        color=colors,
        active_uv=surface.active_uv,
        active_color=surface.active_color,
    )
