"""Triangles laid out in the pages of an atlas, and how each maps texels back onto the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..sampling import orthonormal_frames
from ..scene import OFFSET, Normalisation, connected_components, usable_triangles

MIN_UV_AREA = 1e-9  # of a triangle, in texels squared: smaller ones have no map back onto the surface


@dataclass(frozen=True)
class AtlasTriangles:
    """The t triangles that have a place in an atlas.

    Attributes
    ----------
    uv : ndarray, (t, 3, 2) float64
        Corners in texels from the lower left of their page, counter-clockwise.
    page, chart : ndarray, (t,) int32
    face : ndarray, (t,) int64
        The face patch of which each is a part.
    source : ndarray, (t,) int64
        The triangle of the layout that each is.
    corner : ndarray, (t, 3) float64
        Normalised position of the first corner of `uv`.
    step : ndarray, (t, 2, 3) float64
        What one texel to the right, and one up, is on the surface.
    frame : ndarray, (t, 3, 3) float32
        Tangent, bitangent and normal; the normal points out of the surface also where the UV map mirrors it.
    offset : ndarray, (t,) float64
        How far above the surface rays start.
    texel_area : ndarray, (t,) float64
        Area of a texel on the surface, normalised units squared.
    """

    uv: np.ndarray
    page: np.ndarray
    chart: np.ndarray
    face: np.ndarray
    source: np.ndarray
    corner: np.ndarray
    step: np.ndarray
    frame: np.ndarray
    offset: np.ndarray
    texel_area: np.ndarray

    @classmethod
    def of(
        cls,
        corners: np.ndarray,
        uv: np.ndarray,
        page: np.ndarray,
        chart: np.ndarray,
        face: np.ndarray,
        normalisation: Normalisation,
    ) -> AtlasTriangles:
        """Keep what can be traced and has an area in the atlas.

        Parameters
        ----------
        corners : ndarray, (n, 3, 3) float64
            World positions in metres, counter-clockwise seen from outside.
        uv : ndarray, (n, 3, 2) float64
            In texels of their page.
        page, chart, face : ndarray, (n,) int
            Triangles of a negative page have no place.
        normalisation : Normalisation
            Of the scene.
        """
        points = normalisation.apply(corners)
        with np.errstate(invalid="ignore", over="ignore"):
            edge = uv[:, 1:] - uv[:, :1]
            signed = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
            usable, _ = usable_triangles(points.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))
            kept = np.flatnonzero((page >= 0) & usable & np.isfinite(uv).all((1, 2)) & (abs(signed) > 2 * MIN_UV_AREA))
        points, uv, edge, signed = points[kept], uv[kept], edge[kept], signed[kept]
        side = points[:, 1:] - points[:, :1]
        normal = np.cross(side[:, 0], side[:, 1])
        length = np.linalg.norm(normal, axis=1)
        inverse = np.stack([edge[:, 1, 1], -edge[:, 0, 1], -edge[:, 1, 0], edge[:, 0, 0]], -1).reshape(-1, 2, 2)
        mirrored = signed < 0.0
        turned = np.where(mirrored[:, None, None], uv[:, [0, 2, 1]], uv)
        return cls(
            uv=turned,
            page=page[kept].astype(np.int32),
            chart=chart[kept].astype(np.int32),
            face=face[kept].astype(np.int64),
            source=kept,
            corner=points[:, 0],
            step=inverse @ side / signed[:, None, None],
            frame=orthonormal_frames(normal / length[:, None]).astype(np.float32),
            offset=OFFSET * np.abs(points).max((1, 2)),
            texel_area=length / np.abs(signed),
        )

    def __len__(self) -> int:
        return len(self.page)

    def origins(self) -> np.ndarray:
        """Where rays of the place (0, 0) of the page would start, (t, 3) float64: on the surface but for the offset."""
        to_first = np.einsum("ti,tij->tj", self.uv[:, 0], self.step)
        return self.corner - to_first + self.offset[:, None] * self.frame[:, 2]

    def frames(self) -> np.ndarray:
        """As of `Cells` for texels wholly in each triangle, but for the row of the origin, (t, 3, 6) float32."""
        frames = np.zeros((len(self), 3, 6), np.float32)
        frames[:, :2, :3], frames[:, :, 3:] = self.step, self.frame
        return frames

    def only(self, kept: np.ndarray) -> AtlasTriangles:
        """Some of the triangles, (k,) int."""
        return AtlasTriangles(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))

    def texels(self) -> float:
        """Number of texels that all of them cover."""
        edge = self.uv[:, 1:] - self.uv[:, :1]
        return float(0.5 * np.sum(edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]))


def charts_of(corner_vertex: np.ndarray, uv: np.ndarray, triangle_corners: np.ndarray) -> np.ndarray:
    """Charts of a UV map: triangles that hang together by corners at one vertex and at one place of the map.

    Parameters
    ----------
    corner_vertex : ndarray, (c,) int
    uv : ndarray, (c, 2) float
    triangle_corners : ndarray, (t, 3) int

    Returns
    -------
    ndarray, (t,) int64
        0, 1, ... for each triangle.
    """
    keys = np.stack([corner_vertex, *np.rint(uv.T * 2.0**20)], -1)  # closer than a millionth is one place
    node = np.unique(np.nan_to_num(keys), axis=0, return_inverse=True)[1].ravel()
    corners = node[triangle_corners]
    label = connected_components(int(node.max(initial=-1)) + 1, np.concatenate([corners[:, :2], corners[:, 1:]]))
    return np.unique(label[corners[:, 0]], return_inverse=True)[1].ravel()
