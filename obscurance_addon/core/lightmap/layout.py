"""Where faces lie in an atlas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import GeometryError
from ..scene import Normalisation
from .triangles import AtlasTriangles


@dataclass(frozen=True)
class AtlasLayout:
    """Where the t triangles to bake lie in an atlas.

    Attributes
    ----------
    corners : ndarray, (t, 3, 3) float64
        World positions in metres, counter-clockwise seen from outside.
    uv : ndarray, (t, 3, 2) float64
        Within the page, 0 .. 1.
    page : ndarray, (t,) int
        -1 for triangles without a place.
    chart : ndarray, (t,) int
        Numbered over all pages.
    face : ndarray, (t,) int
        The face patch of which each is a part.
    pages : int
    """

    corners: np.ndarray
    uv: np.ndarray
    page: np.ndarray
    chart: np.ndarray
    face: np.ndarray
    pages: int

    def triangles(self, size: int, normalisation: Normalisation) -> AtlasTriangles:
        """The triangles in texels of pages of this size.

        Raises
        ------
        GeometryError
            When none has a place.
        """
        found = AtlasTriangles.of(self.corners, self.uv * size, self.page, self.chart, self.face, normalisation)
        if not len(found):
            raise GeometryError(
                "no face that can be traced has an area in the UV map: unwrap anew, or choose another UV map; where "
                "there is one, a vertex may be far astray: repair the mesh"
            )
        return found
