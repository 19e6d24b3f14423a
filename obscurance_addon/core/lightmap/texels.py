"""The texels of an atlas as patches: exactly the parts of triangles that each of them covers.

A texel that lies in one triangle is a parallelogram on the surface. Others are cut along the edges of the triangles
that cross them, so that a texel at the border of a chart is just what the chart covers of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..sampling import hash32
from ..scene import Cells
from .clipping import Fans, cut_squares, ranges, spans
from .triangles import AtlasTriangles

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
    whole: Cells
    parts: Cells
    overlap: np.ndarray
    overlap_face: np.ndarray

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def ids(self) -> np.ndarray:
        """Stable identity of each texel, (n,) uint32."""
        return hash32(self.index.astype(np.uint32) ^ hash32(np.uint32(self.page)))

    @cached_property
    def normal(self) -> np.ndarray:
        """Mean unit normal of the covered part of each, (n, 3) float32."""
        normal = _means(self.whole, self.parts, lambda cells: cells.frames[:, 2, 3:])
        parts = self.parts.patch[np.diff(self.parts.patch, prepend=-1) != 0]
        length = np.linalg.norm(normal[parts], axis=1)
        normal[parts] /= np.maximum(length, np.finfo(np.float32).tiny)[:, None]
        return normal

    def positions(self, chosen: np.ndarray) -> np.ndarray:
        """Centres of the covered parts of the texels `chosen` (m,) int, ascending, (m, 3) float32 normalised."""
        return _means(*self.cells_of(chosen), _centres)

    def cells_of(self, chosen: np.ndarray) -> tuple[Cells, Cells]:
        """The parallelograms and the triangles of the texels `chosen` (m,) int, ascending, which are numbered anew."""
        found = []
        for cells in (self.whole, self.parts):
            if len(chosen) and chosen[-1] - chosen[0] + 1 == len(chosen):  # needs no copy
                kept = slice(*np.searchsorted(cells.patch, [chosen[0], chosen[-1] + 1]))
                patch = cells.patch[kept] - chosen[0]
            else:
                patch, kept = ranges(*(np.searchsorted(cells.patch, chosen, side) for side in ("left", "right")))
            arrays = {name: getattr(cells, name)[kept] for name in ("frames", "offset", "weight")}
            found.append(replace(cells, patch=patch, area=cells.area[chosen], **arrays))
        return found[0], found[1]

    def centres(self, chosen: np.ndarray) -> np.ndarray:
        """Middles of the texels `chosen` (m,) on the page, covered or not, (m, 2) float64 texels."""
        index = self.index[chosen]
        return np.stack([index % self.size, index // self.size], -1) + 0.5


def covered_texels(triangles: AtlasTriangles, size: int, page: int, rows: tuple[int, int]) -> Texels:
    """Find the covered texels of the rows `rows[0]` .. `rows[1] - 1` of a page of `size` x `size` texels."""
    low, high = triangles.uv[..., 1].min(1), triangles.uv[..., 1].max(1)
    chosen = np.flatnonzero((triangles.page == page) & (low < rows[1]) & (high > rows[0]))
    triangles = triangles.only(chosen)
    (whole_triangle, x, y), outer = spans(triangles.uv, rows, size)
    whole_place = (y - rows[0]) * size + x
    polygons, part_triangle, x, y = cut_squares(triangles.uv, *outer)
    part_place = (y - rows[0]) * size + x
    fans = polygons.fans()
    part_cover = fans.areas_of_polygons()
    kept = np.flatnonzero(part_cover > MIN_COVER)
    place = np.concatenate([whole_place, part_place[kept]])
    cover = np.concatenate([np.ones(len(whole_place)), part_cover[kept]])
    cover_of_place = np.bincount(place, cover, (rows[1] - rows[0]) * size)
    is_covered = cover_of_place > 0.0
    number, n = np.cumsum(is_covered) - 1, int(np.count_nonzero(is_covered))

    crowded = np.flatnonzero(cover_of_place[place] > 1.0 + OVERLAP)
    triangle = np.concatenate([whole_triangle, part_triangle[kept]])[crowded]
    overlap, overlap_face = _overlaps(triangles, triangle, number[place[crowded]], cover[crowded])

    first_whole = np.full(len(is_covered), -1)
    first_whole[whole_place[::-1]] = np.arange(len(whole_place))[::-1]  # of several the first is written last
    kept = kept[first_whole[part_place[kept]] < 0]
    kept = kept[np.argsort(part_place[kept], kind="stable")]
    kept = kept[_of_main_charts(part_place[kept], triangles.chart[part_triangle[kept]], part_cover[kept])]
    whole = first_whole[first_whole >= 0]
    whole_texel, whole_triangle = number[whole_place[whole]], whole_triangle[whole]
    part_texel, part_triangle, part_cover = number[part_place[kept]], part_triangle[kept], part_cover[kept]
    fans, owner = fans.of_polygons(kept)

    area = np.bincount(part_texel, part_cover * triangles.texel_area[part_triangle], n)
    area[whole_texel] = triangles.texel_area[whole_triangle]
    share = np.bincount(part_texel, part_cover, n)
    share[whole_texel] = 1.0
    main = np.empty(n, np.int64)
    main[whole_texel] = whole_triangle
    largest = _largest(part_texel, part_cover)
    main[part_texel[largest]] = part_triangle[largest]
    index = np.flatnonzero(is_covered) + rows[0] * size
    y, x = np.divmod(index[whole_texel], size)
    return Texels(
        index=index,
        page=page,
        size=size,
        chart=triangles.chart[main],
        face=triangles.face[main],
        triangle=triangles.source[main],
        cover=np.minimum(share, 1.0),
        area=area,
        whole=_parallelograms(triangles, whole_triangle, whole_texel, x, y, area),
        parts=_triangles(triangles, part_triangle[owner], part_texel[owner], fans, area),
        overlap=overlap,
        overlap_face=overlap_face,
    )


def _means(whole: Cells, parts: Cells, values: Callable[[Cells], np.ndarray]) -> np.ndarray:
    """Means (n, 3) float32 over the cells of each texel."""
    means = np.empty((len(whole.area), 3), np.float32)
    for axis, column in enumerate(values(parts).T):
        means[:, axis] = np.bincount(parts.patch, column * parts.weight, len(means))
    means[whole.patch] = values(whole)
    return means


def _centres(cells: Cells) -> np.ndarray:
    """(c, 3)."""
    edge1, edge2, corner = cells.frames[:, :, :3].transpose(1, 0, 2)
    share = np.float32(0.5 if cells.are_parallelograms else 1.0 / 3.0)
    return corner - cells.offset[:, None] * cells.frames[:, 2, 3:] + share * (edge1 + edge2)


def _overlaps(
    triangles: AtlasTriangles, triangle: np.ndarray, texel: np.ndarray, cover: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`overlap` and `overlap_face` of `Texels`, from all entries in crowded texels."""
    most = _overlapping(texel, triangles.chart[triangle], cover)
    texel, face = texel[most], triangles.face[triangle[most]]
    order = np.lexsort((face, texel))
    return texel[order], face[order]


def _overlapping(texel: np.ndarray, chart: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Of entries in crowded texels, the largest of each chart, or the two largest where there is one chart only."""
    order = np.lexsort((-cover, chart, texel))
    texel, chart = texel[order], chart[order]
    new_texel = np.diff(texel, prepend=-1) != 0
    largest = new_texel | (np.diff(chart, prepend=-1) != 0)
    alone = np.bincount(texel, largest) == 1
    second = np.r_[False, largest[:-1]] & ~new_texel & alone[texel]
    return order[largest | second]


def _largest(texel: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """The entry of each texel that covers most of it, of entries (m,) ascending by texel."""
    first = np.flatnonzero(np.diff(texel, prepend=-1))
    if not len(first):
        return first
    most = np.maximum.reduceat(cover, first)
    largest = np.flatnonzero(cover == np.repeat(most, np.diff(first, append=len(texel))))
    return largest[np.diff(texel[largest], prepend=-1) != 0]


def _of_main_charts(place: np.ndarray, chart: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """(m,) bool: entries, ascending by place, of the chart that covers most of it."""
    keep = np.ones(len(place), bool)
    is_first = np.diff(place, prepend=-1) != 0
    mixed = np.zeros(np.count_nonzero(is_first), bool)
    of = np.cumsum(is_first) - 1
    mixed[of[chart != chart[is_first][of]]] = True
    entries = np.flatnonzero(mixed[of])
    if len(entries):
        pairs, pair = np.unique(np.stack([place[entries], chart[entries]], 1), axis=0, return_inverse=True)
        pair = pair.ravel()
        total = np.bincount(pair, cover[entries])
        best = np.lexsort((pairs[:, 1], -total, pairs[:, 0]))
        best = best[np.unique(pairs[best, 0], return_index=True)[1]]
        keep[entries[~np.isin(pair, best)]] = False
    return keep


def _parallelograms(
    triangles: AtlasTriangles, triangle: np.ndarray, texel: np.ndarray, x: np.ndarray, y: np.ndarray, area: np.ndarray
) -> Cells:
    """Cells (m,) that are all of a texel, whose lower left is (x, y)."""
    frames = np.take(triangles.frames(), triangle, axis=0)
    _place_origins(frames, triangles, triangle, x, y)
    offset = triangles.offset[triangle].astype(np.float32)
    return Cells(frames, offset, texel, np.ones(len(texel)), area, are_parallelograms=True)


def _triangles(
    triangles: AtlasTriangles, triangle: np.ndarray, texel: np.ndarray, fans: Fans, area: np.ndarray
) -> Cells:
    """Cells (f,) that together are a part of a texel."""
    frames = np.take(triangles.frames(), triangle, axis=0)
    for axis, (right, up) in enumerate(triangles.step.T):
        right, up = right[triangle], up[triangle]
        frames[:, 0, axis] = fans.edges[0] * right + fans.edges[1] * up
        frames[:, 1, axis] = fans.edges[2] * right + fans.edges[3] * up
    _place_origins(frames, triangles, triangle, fans.x, fans.y)
    offset = triangles.offset[triangle].astype(np.float32)
    own = fans.area * triangles.texel_area[triangle]
    return Cells(frames, offset, texel, own / np.bincount(texel, own, len(area))[texel], area)


def _place_origins(
    frames: np.ndarray, triangles: AtlasTriangles, triangle: np.ndarray, x: np.ndarray, y: np.ndarray
) -> None:
    """Let the rays of cells with frames (m, 3, 6) on triangles (m,) start at the places (x, y) of the page.

    Column by column: rows of three numbers take numpy several times as long.
    """
    for axis, (origin, (right, up)) in enumerate(zip(triangles.origins().T, triangles.step.T, strict=True)):
        frames[:, 2, axis] = origin[triangle] + x * right[triangle] + y * up[triangle]
