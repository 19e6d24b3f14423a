"""The texels of an atlas as patches: exactly the parts of triangles that each of them covers.

A texel that lies in one triangle is a parallelogram on the surface. Others are cut along the edges of the triangles
that cross them, so that a texel at the border of a chart is just what the chart covers of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .atlas_triangles import AtlasTriangles
from .patches import Cells
from .sobol import hash32
from .texel_clipping import cut_squares, polygon_areas, ranges, spans

MIN_COVER = 1e-6  # share of a texel below which it counts as not covered
OVERLAP = 1e-3  # by how much parts may exceed a texel before they overlap


@dataclass(frozen=True)
class Texels:
    """The n covered texels of some rows of a page.

    Attributes
    ----------
    index : ndarray, (n,) int64
        row x size + column on the page, ascending.
    page : int
    size : int
        Of the page.
    chart : ndarray, (n,) int32
    face : ndarray, (n,) int64
        The face patch of the largest part of each,
    triangle : ndarray, (n,) int64
        and the triangle of the layout that it belongs to.
    cover : ndarray, (n,) float64
        Covered share, 0 .. 1.
    area : ndarray, (n,) float64
        Of the covered part on the surface, normalised units squared.
    position, normal : ndarray, (n, 3) float64
        Centre and mean unit normal of the covered part, normalised coordinates.
    whole, parts : Cells
        Parallelograms and triangles; their patches are texels, and each texel has cells of one kind only.
    overlap : ndarray, (m,) int64
        Texels that several parts of the surface cover, counted from 0 in `index`: once for each chart, or twice for a
        chart that overlaps itself,
    overlap_face : ndarray, (m,) int64
        and the face that covers most of the texel there.
    """

    index: np.ndarray
    page: int
    size: int
    chart: np.ndarray
    face: np.ndarray
    triangle: np.ndarray
    cover: np.ndarray
    area: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    whole: Cells
    parts: Cells
    overlap: np.ndarray
    overlap_face: np.ndarray

    def __len__(self) -> int:
        return len(self.index)

    @property
    def ids(self) -> np.ndarray:
        """Stable identity of each texel, (n,) uint32."""
        return hash32(self.index.astype(np.uint32) ^ hash32(np.uint32(self.page)))

    def centres(self, chosen: np.ndarray) -> np.ndarray:
        """Middles of the texels `chosen` (m,) on the page, covered or not, (m, 2) float64 texels."""
        index = self.index[chosen]
        return np.stack([index % self.size, index // self.size], -1) + 0.5


def covered_texels(triangles: AtlasTriangles, size: int, page: int, rows: tuple[int, int]) -> Texels:
    """Find the covered texels of the rows `rows[0]` .. `rows[1] - 1` of a page of `size` x `size` texels."""
    low, high = triangles.uv[..., 1].min(1), triangles.uv[..., 1].max(1)
    chosen = np.flatnonzero((triangles.page == page) & (low < rows[1]) & (high > rows[0]))
    triangles = triangles.only(chosen)
    inner, outer = spans(triangles.uv, rows, size)
    whole_triangle, whole_x, whole_y = inner
    polygon, corners, triangle, x, y = cut_squares(triangles.uv, *outer)
    cover = np.concatenate([np.ones(len(whole_x)), polygon_areas(polygon, corners)])
    triangle, x, y = (np.concatenate(pair) for pair in ((whole_triangle, triangle), (whole_x, x), (whole_y, y)))
    kept = np.flatnonzero(cover > MIN_COVER)
    texel, triangle, cover = (y * size + x)[kept], triangle[kept], cover[kept]
    index, texel = np.unique(texel, return_inverse=True)
    n = len(index)
    crowded = np.bincount(texel, cover, n) > 1.0 + OVERLAP
    entries = np.flatnonzero(crowded[texel])
    entries = entries[_overlapping(texel[entries], triangles.chart[triangle[entries]], cover[entries])]
    overlap, overlap_face = texel[entries], triangles.face[triangle[entries]]
    order = np.lexsort((overlap_face, overlap))
    is_whole = kept < len(whole_x)
    chosen = _winners(texel, triangles.chart[triangle], cover, is_whole)
    texel, triangle, cover, is_whole, kept = (a[chosen] for a in (texel, triangle, cover, is_whole, kept))
    area = cover * triangles.texel_area[triangle]
    whole = _parallelograms(triangles, triangle[is_whole], index[texel[is_whole]], size)
    part = np.flatnonzero(~is_whole)
    polygon_of = kept[part] - len(whole_x)
    fans, owner = _fans(triangles, triangle[part], polygon[polygon_of], corners[polygon_of])
    total = np.bincount(texel, area, n)
    centre = np.empty((len(texel), 3))
    centre[is_whole] = whole[:, 2] + 0.5 * (whole[:, 0] + whole[:, 1])
    centre[part] = _fan_centres(fans, owner, len(part))
    normal = triangles.frame[triangle, 2].astype(np.float64)
    mean_normal = _sums(texel, area[:, None] * normal, n)
    first = np.lexsort((-cover, texel))
    first = first[np.searchsorted(texel[first], np.arange(n))]
    return Texels(
        index=index,
        page=page,
        size=size,
        chart=triangles.chart[triangle[first]],
        face=triangles.face[triangle[first]],
        triangle=triangles.source[triangle[first]],
        cover=np.minimum(np.bincount(texel, cover, n), 1.0),
        area=total,
        position=_sums(texel, area[:, None] * centre, n) / total[:, None],
        normal=mean_normal / np.maximum(np.linalg.norm(mean_normal, axis=1), np.finfo(float).tiny)[:, None],
        whole=_cells(triangles, whole, triangle[is_whole], texel[is_whole], total, None),
        parts=_cells(triangles, fans, triangle[part][owner], texel[part][owner], total, _double_areas(fans) / 2.0),
        overlap=overlap[order],
        overlap_face=overlap_face[order],
    )


def _overlapping(texel: np.ndarray, chart: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Of entries in crowded texels, the largest of each chart, or the two largest where there is one chart only."""
    order = np.lexsort((-cover, chart, texel))
    texel, chart = texel[order], chart[order]
    new_texel = np.diff(texel, prepend=-1) != 0
    largest = new_texel | (np.diff(chart, prepend=-1) != 0)
    alone = np.bincount(texel, largest) == 1
    second = np.r_[False, largest[:-1]] & ~new_texel & alone[texel]
    return order[largest | second]


def _winners(texel: np.ndarray, chart: np.ndarray, cover: np.ndarray, is_whole: np.ndarray) -> np.ndarray:
    """Entries to keep, ascending by texel: one whole one, else those of the chart that covers most of the texel."""
    n = int(texel.max(initial=-1)) + 1
    order = np.lexsort((~is_whole, texel))
    first = order[np.searchsorted(texel[order], np.arange(n))]
    has_whole = is_whole[first]
    keep = ~has_whole[texel]
    keep[first[has_whole]] = True
    mixed = np.zeros(n, bool)
    mixed[texel[keep & (chart != chart[first][texel])]] = True
    entries = np.flatnonzero(keep & mixed[texel])
    if len(entries):
        pairs, pair = np.unique(np.stack([texel[entries], chart[entries]], 1), axis=0, return_inverse=True)
        pair = pair.ravel()
        total = np.bincount(pair, cover[entries])
        best = np.lexsort((pairs[:, 1], -total, pairs[:, 0]))
        best = best[np.unique(pairs[best, 0], return_index=True)[1]]
        keep[entries[~np.isin(pair, best)]] = False
    kept = np.flatnonzero(keep)
    return kept[np.argsort(texel[kept], kind="stable")]


def _parallelograms(triangles: AtlasTriangles, triangle: np.ndarray, index: np.ndarray, size: int) -> np.ndarray:
    """Edge, edge and corner (m, 3, 3) of whole texels."""
    at = np.stack([index % size, index // size], -1).astype(np.float64)
    return np.concatenate([triangles.step[triangle], triangles.place(triangle, at)[:, None]], 1)


def _fans(
    triangles: AtlasTriangles, triangle: np.ndarray, polygon: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Edge, edge and corner (f, 3, 3) of the triangles that polygons (m, k, 2) consist of, and the polygon of each."""
    owner, second = ranges(np.ones(len(count), np.int64), count - 1)
    corner = polygon[owner, 0]
    one, two = polygon[owner, second] - corner, polygon[owner, second + 1] - corner
    step = triangles.step[triangle[owner]]
    edges = np.einsum("mki,mij->mkj", np.stack([one, two], 1), step)
    fans = np.concatenate([edges, triangles.place(triangle[owner], corner)[:, None]], 1)
    area = _double_areas(fans)
    kept = area > 0.0  # a cell without area would get rays all the same
    return fans[kept], owner[kept]


def _double_areas(fans: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(fans[:, 0], fans[:, 1]), axis=1)


def _fan_centres(fans: np.ndarray, owner: np.ndarray, n: int) -> np.ndarray:
    """Centres of gravity (n, 3) of the polygons that own the fans."""
    area = _double_areas(fans)
    total = np.maximum(np.bincount(owner, area, n), np.finfo(float).tiny)
    return _sums(owner, area[:, None] * (fans[:, 2] + (fans[:, 0] + fans[:, 1]) / 3.0), n) / total[:, None]


def _sums(owner: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """Sums (n, k) of the values (m, k) of each owner."""
    return np.stack([np.bincount(owner, column, n) for column in values.T], -1)


def _cells(
    triangles: AtlasTriangles,
    shape: np.ndarray,
    triangle: np.ndarray,
    texel: np.ndarray,
    total: np.ndarray,
    area: np.ndarray | None,
) -> Cells:
    """Cells from edges and corners (m, 3, 3); `area` None for parallelograms, each of which is all of its texel."""
    frames = np.empty((len(shape), 3, 6), np.float32)
    offset = triangles.offset[triangle]
    frames[:, :2, :3] = shape[:, :2]
    frames[:, 2, :3] = shape[:, 2] + offset[:, None] * triangles.frame[triangle, 2]
    frames[:, :, 3:] = triangles.frame[triangle]
    weight = np.ones(len(shape)) if area is None else area / np.bincount(texel, area, len(total))[texel]
    return Cells(frames, offset.astype(np.float32), texel, weight, total, are_parallelograms=area is None)
