"""What a material scatters and emits, and its values on the faces of a mesh. numpy only; any thread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .expressions import BLACK, AttributeSample, Expression, ImageSample, walk
from .means import face_means
from .surfaces import SurfaceArrays

# The ambient term grows with 1 / (1 - R): brighter surfaces than any real one make it explode (theory, section 4.9).
MAX_REFLECTANCE = 0.95
# Cycles' albedo for surfaces without a material.
DEFAULT_REFLECTANCE = 0.8
# Radiant exitance at which emission stops, W/m^2: sums over a scene stay finite in float32.
MAX_EMISSION = 1e12


@dataclass(frozen=True, eq=False)
class Shading:
    """What a material scatters and emits, free of bpy.

    Attributes
    ----------
    reflectance : Expression
        Diffuse reflectance, linear colour, not yet clamped.
    radiance : Expression
        Emitted radiance, W/(m^2 sr), not yet clamped.
    """

    reflectance: Expression = BLACK
    radiance: Expression = BLACK

    def uv_maps(self) -> set[str]:
        """Names of the UV maps needed; '' is the active one."""
        found = walk(self.reflectance, self.radiance)
        return {e.projection.name for e in found if isinstance(e, ImageSample) and e.projection is not None}

    def color_attributes(self) -> set[str]:
        """Names of the colour attributes needed; '' is the active one."""
        return {e.name for e in walk(self.reflectance, self.radiance) if isinstance(e, AttributeSample)}

    def varies(self) -> bool:
        """Whether faces differ; otherwise no mesh data is needed."""
        return bool(self.uv_maps() or self.color_attributes())


def shade_faces(
    shadings: Sequence[Shading], face_material: np.ndarray, surface: SurfaceArrays
) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse reflectance and emission of every face.

    Parameters
    ----------
    shadings : sequence of Shading
    face_material : ndarray of int, (F,)
        Index into `shadings` for each face.
    surface : SurfaceArrays
        As from `read_surface` with the same shadings.

    Returns
    -------
    reflectance : ndarray, (F, 3) float32
        Linear colour, 0 .. MAX_REFLECTANCE.
    emission : ndarray, (F, 3) float32
        Radiant exitance, W/m^2, finite and not negative.

    Raises
    ------
    IndexError
        A face names a shading that is not there.
    """
    varies = np.array([shading.varies() for shading in shadings], bool)
    constant = np.zeros((len(shadings), 2, 3), np.float32)
    for index in np.flatnonzero(~varies):
        constant[index, 0] = shadings[index].reflectance.at(None)[0, 0]
        constant[index, 1] = shadings[index].radiance.at(None)[0, 0]
    reflectance, emission = (values.take(face_material, axis=0) for values in _physical(constant))
    if varies.any():
        triangle_material = face_material[surface.triangle_face]
        for index in np.unique(triangle_material[varies[triangle_material]]):
            shading, triangles = shadings[index], np.flatnonzero(triangle_material == index)
            faces, values = face_means((shading.reflectance, shading.radiance), surface, triangles)
            reflectance[faces], emission[faces] = _physical(values)
    return reflectance, emission


def _physical(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2, 3) reflectance and radiance -> clamped reflectance (n, 3) and radiant exitance (n, 3), both float32."""
    values = np.nan_to_num(values, nan=0.0, posinf=MAX_EMISSION, neginf=0.0)
    reflectance = np.clip(values[:, 0], 0.0, MAX_REFLECTANCE)
    radiance = np.clip(values[:, 1], 0.0, MAX_EMISSION / np.pi)
    return reflectance.astype(np.float32), (np.pi * radiance).astype(np.float32)
