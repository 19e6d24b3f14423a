"""What a material scatters, emits and lets through, and its values on the faces of a mesh. numpy only; any thread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
    """What a material scatters, emits and lets through, free of bpy.

    Attributes
    ----------
    reflectance : Expression
        Diffuse reflectance, linear colour, not yet clamped.
    radiance : Expression
        Emitted radiance, W/(m^2 sr), not yet clamped.
    transmission : Expression
        Share of the light that goes on straight behind the surface, not yet clamped; 0 for opaque ones. What the
        surface scatters and emits is what is seen of it: that of its opaque part times its opacity.
    """

    reflectance: Expression = BLACK
    radiance: Expression = BLACK
    transmission: Expression = BLACK

    def expressions(self) -> tuple[Expression, Expression, Expression]:
        """Reflectance, radiance and transmission."""
        return self.reflectance, self.radiance, self.transmission

    def uv_maps(self) -> set[str]:
        """Names of the UV maps needed; '' is the active one."""
        found = walk(*self.expressions())
        return {e.projection.name for e in found if isinstance(e, ImageSample) and e.projection is not None}

    def color_attributes(self) -> set[str]:
        """Names of the colour attributes needed; '' is the active one."""
        found = walk(*self.expressions())
        return {e.name for e in found if isinstance(e, AttributeSample)}

    def varies(self) -> bool:
        """Whether faces differ; otherwise no mesh data is needed."""
        return bool(self.uv_maps() or self.color_attributes())

    def transmission_varies(self) -> bool:
        """Whether it has to be looked up where a ray meets a face."""
        return any(isinstance(e, ImageSample | AttributeSample) for e in walk(self.transmission))


class FaceShading(NamedTuple):
    """Values of faces.

    Attributes
    ----------
    reflectance : ndarray, (f, 3) float32
        Linear colour, 0 .. MAX_REFLECTANCE.
    emission : ndarray, (f, 3) float32
        Radiant exitance, W/m^2, finite and not negative.
    transmission : ndarray, (f, 3) float32, or None
        0 .. 1; None where all materials are opaque.
    """

    reflectance: np.ndarray
    emission: np.ndarray
    transmission: np.ndarray | None


def shade_faces(shadings: Sequence[Shading], face_material: np.ndarray, surface: SurfaceArrays) -> FaceShading:
    """Diffuse reflectance, emission and transmission of every face.

    Parameters
    ----------
    shadings : sequence of Shading
    face_material : ndarray of int, (F,)
        Index into `shadings` for each face.
    surface : SurfaceArrays
        As from `read_surface` with the same shadings.

    Raises
    ------
    IndexError
        A face names a shading that is not there.
    """
    varies = np.array([shading.varies() for shading in shadings], bool)
    constant = np.zeros((len(shadings), 3, 3), np.float32)
    for index in np.flatnonzero(~varies):
        for column, expression in enumerate(shadings[index].expressions()):
            constant[index, column] = expression.at(None)[0, 0]
    found = FaceShading(*(values.take(face_material, axis=0) for values in _physical(constant)[:2]), None)
    if constant[:, 2].any() or any(shading.transmission_varies() for shading in shadings):
        found = found._replace(transmission=_physical(constant).transmission.take(face_material, axis=0))
    if varies.any():
        triangle_material = face_material[surface.triangle_face]
        for index in np.unique(triangle_material[varies[triangle_material]]):
            triangles = np.flatnonzero(triangle_material == index)
            faces, values = face_means(shadings[index].expressions(), surface, triangles)
            for of_faces, of_these in zip(found, _physical(values), strict=True):
                if of_faces is not None:
                    of_faces[faces] = of_these
    return found


def _physical(values: np.ndarray) -> FaceShading:
    """What (n, 3, 3) reflectance, radiance and transmission are once they are clamped."""
    values = np.nan_to_num(values, nan=0.0, posinf=MAX_EMISSION, neginf=0.0)
    reflectance = np.clip(values[:, 0], 0.0, MAX_REFLECTANCE)
    radiance = np.clip(values[:, 1], 0.0, MAX_EMISSION / np.pi)
    transmission = np.clip(values[:, 2], 0.0, 1.0)
    return FaceShading(*(x.astype(np.float32) for x in (reflectance, np.pi * radiance, transmission)))
