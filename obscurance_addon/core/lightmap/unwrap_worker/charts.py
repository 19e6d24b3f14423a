"""Cuts a mesh into flat charts of even scale that do not overlap: xatlas makes them, what it gets wrong is cut anew.

Faces that xatlas leaves out or tears, and those that overlap themselves, are laid flat one by one. Other charts that
overlap, lost faces or are wider than a page grow again from their faces.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from .planar import FLAT, bounds_of, overlapping, overlaps_itself, projected, twice_areas, unfolded
from .retired import retire

BOX = 1000.0  # side of the box that a mesh is scaled to: xatlas hangs on huge coordinates, drops areas below 1e-7
CHARTS_AT_LEAST = 8  # per mesh, and ...
TRIANGLES_PER_CHART = 600  # ... no more of these in one on average, for the time goes with their square
FINE_TEXELS = 1.0e4  # per unit of the box: xatlas stretches charts to whole texels, which is nothing on such a grid
SHRUNK_TO, SCRATCH = 9, 512  # then it shrinks each chart evenly to this, so that its own packing costs nothing
GENTLE = 3.5e-4, 1.5e-2  # radians between normals: more than rounding, and up to what xatlas takes for flat
ROUGH = 0.05  # of the shortest edge; bends neighbours by a few degrees; areas are set right afterwards
NONE = 0xFFFFFFFF  # what xatlas has for no chart


class Unplaceable(Exception):  # noqa: N818 - an answer, not a fault
    """No atlas; the text is the line for the parent."""


@dataclass
class Cut:
    """One mesh cut into charts: `uv` in metres, each chart with its lowest corner at 0."""

    face_start: np.ndarray  # (f + 1,) int64
    corners: np.ndarray  # (t, 3) int64 corners of the triangles that count
    face: np.ndarray  # (t,) int64
    points: np.ndarray  # (c, 3) float64 metres
    uv: np.ndarray = field(init=False)  # (c, 2) float64, nan where there is none
    chart: np.ndarray = field(init=False)  # (f,) int64, -1 for none
    folded: set[int] = field(default_factory=set)  # faces that overlap themselves
    unchecked: bool = False  # too entangled to be searched for overlaps

    def __post_init__(self) -> None:
        self.uv = np.full((len(self.points), 2), np.nan)
        self.chart = np.full(len(self.face_start) - 1, -1)

    def loop(self, face: int) -> slice:
        return slice(self.face_start[face], self.face_start[face + 1])


def run_xatlas(xatlas: object, cut: Cut, largest: float) -> set[int]:
    """Fills `uv` and `chart`; faces left out or torn between charts get none; those charts are returned."""
    corner = np.unique(cut.corners)
    low, high = cut.points[corner].min(0), cut.points[corner].max(0)
    metre = BOX / max(float((high - low).max()), np.finfo(float).tiny)
    vertices, index = np.unique(((cut.points - 0.5 * (low + high)) * metre)[corner], axis=0, return_inverse=True)
    triangles = index.reshape(-1)[np.searchsorted(corner, cut.corners)]
    area = 0.5 * float(twice_areas(vertices[triangles]).sum())
    options, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    options.max_chart_area = min(
        area / max(CHARTS_AT_LEAST, len(triangles) / TRIANGLES_PER_CHART), (largest * metre) ** 2
    )
    packing.resolution, packing.max_chart_size, packing.texels_per_unit = SCRATCH, SHRUNK_TO, FINE_TEXELS
    atlas = xatlas.Atlas()
    vertices = roughened(vertices, triangles)
    atlas.add_mesh(vertices.astype(np.float32), triangles.astype(np.uint32))
    atlas.generate(chart_options=options, pack_options=packing)
    retire(atlas)
    if atlas.atlas_count == 0:
        return set()
    _, index, uv = atlas.get_mesh(0)
    chart = atlas.get_mesh_vertex_assignment(0)[1].astype(np.int64)[index[:, 0]]
    chart[chart == NONE] = -1
    found = uv[index].astype(np.float64)
    cut.uv[cut.corners.ravel()] = found.reshape(-1, 2)
    cut.chart[cut.face] = chart
    torn = (cut.chart[cut.face] != chart) | (chart < 0) | (cut.uv[cut.corners] != found).any((1, 2))
    of = np.repeat(np.arange(len(cut.chart)), np.diff(cut.face_start))
    torn |= np.bincount(of, np.isnan(cut.uv[:, 0]), len(cut.chart))[cut.face] > 0
    lost = np.isin(cut.face, cut.face[torn])
    cut.chart[cut.face[lost]] = -1
    return set(chart[lost].tolist()) - {-1}


def roughened(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Vertices (v, 3) moved a little where the surface bends so gently that xatlas would take all of it for flat.

    It never cuts between neighbours whose normals differ by less than 0.8 degrees: a fine sphere would be one chart.
    """
    shape = vertices[triangles]
    normal = np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, 1)], -1).reshape(-1, 2), 1)
    order = np.lexsort(ends.T)
    same = np.flatnonzero((ends[order[1:]] == ends[order[:-1]]).all(1))
    bend = np.linalg.norm(normal[order[same] // 3] - normal[order[same + 1] // 3], axis=1)
    gentle = np.unique(ends[order[same[(bend > GENTLE[0]) & (bend < GENTLE[1])]]])
    shortest = np.full(len(vertices), np.inf)
    np.minimum.at(shortest, ends, np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)[:, None])
    noise = np.random.default_rng(0).uniform(-ROUGH, ROUGH, vertices.shape)
    vertices[gentle] += noise[gentle] * shortest[gentle, None]
    return vertices


def lay_flat(cut: Cut, face: int, corners: np.ndarray) -> None:
    """Lays a face flat, turned to its smallest rectangle: on its own plane, or unfolded where that would fold it."""
    flat = projected(cut.points[cut.loop(face)], cut.points[corners])
    own = corners - cut.face_start[face]
    if overlaps_itself(flat[own]):
        flat = unfolded(cut.points[cut.loop(face)], own)
        if overlaps_itself(flat[own]):
            cut.folded.add(face)
    side = np.roll(flat, -1, 0) - flat
    length = np.linalg.norm(side, axis=1)
    c, s = (side[length > 0.0] / length[length > 0.0, None]).T
    turned = [np.outer(c, flat[:, 0]) + np.outer(s, flat[:, 1]), np.outer(c, flat[:, 1]) - np.outer(s, flat[:, 0])]
    width, height = np.ptp(turned[0], 1), np.ptp(turned[1], 1)
    best = (width * height + FLAT * (width + height) ** 2).argmin()
    cut.uv[cut.loop(face)] = np.stack([turned[0][best], turned[1][best]], 1)


def to_world_scale(cut: Cut) -> np.ndarray:
    """Scales each chart to the area of its faces and moves its lowest corner to 0; numbers of those without area."""
    placed = cut.chart[cut.face] >= 0
    corners, chart = cut.corners[placed], cut.chart[cut.face[placed]]
    count = int(chart.max(initial=-1)) + 1
    flat = np.bincount(chart, np.abs(twice_areas(cut.uv[corners])), count).astype(float)
    real = np.bincount(chart, twice_areas(cut.points[corners]), count).astype(float)
    low, high = bounds_of(cut.uv[corners], chart, count)
    thin = ~(flat > FLAT * (high - low).max(1) ** 2)
    scale = np.sqrt(np.divide(real, flat, out=np.ones(count), where=~thin))
    of = np.repeat(cut.chart, np.diff(cut.face_start))
    cut.uv[of >= 0] = (cut.uv[of >= 0] - low[of[of >= 0]]) * scale[of[of >= 0], None]
    return np.flatnonzero(thin)


def grow_again(cut: Cut, faces: np.ndarray, clash: dict[int, set[int]], limit: float) -> None:
    """Cuts charts anew, given all their faces: no two that clash, none wider than `limit`, each connected."""
    at, users = {}, defaultdict(list)
    for face in faces.tolist():
        at[face] = [(int(cut.chart[face]), *point) for point in cut.uv[cut.loop(face)].tolist()]
        for node in at[face]:
            users[node].append(face)
    bounds = {face: (cut.uv[cut.loop(face)].min(0), cut.uv[cut.loop(face)].max(0)) for face in at}
    left, number = dict.fromkeys(at), int(cut.chart.max())
    while left:
        number += 1
        first = next(iter(left))
        members, waiting, (low, high) = set(), [first], bounds[first]
        tried = {first}
        for face in waiting:
            new_low, new_high = np.minimum(low, bounds[face][0]), np.maximum(high, bounds[face][1])
            if members and ((new_high - new_low).max() > limit or not members.isdisjoint(clash.get(face, ()))):
                continue
            members.add(face)
            low, high = new_low, new_high
            del left[face]
            cut.chart[face] = number
            beside = dict.fromkeys(other for node in at[face] for other in users[node])
            waiting += [other for other in beside if other in left and other not in tried]
            tried.update(beside)


def cut_mesh(xatlas: object, cut: Cut, limit: float) -> None:
    """Charts of one mesh; `limit` is the greatest extent of a chart in metres."""
    broken = run_xatlas(xatlas, cut, 0.5 * limit)
    cut.chart[np.isin(cut.chart, to_world_scale(cut))] = -1
    broken |= drop_turned_over(cut)
    of = cut.chart[cut.face]
    placed = np.flatnonzero(of >= 0)
    pairs, complete = overlapping(cut.uv[cut.corners[placed]], of[placed])
    cut.unchecked = not complete
    broken |= set(of[placed[pairs]].ravel().tolist())  # also those that lost a face: they may have fallen apart
    pairs = cut.face[placed[pairs]]
    cut.chart[pairs[pairs[:, 0] == pairs[:, 1], 0]] = -1
    clash = defaultdict(set)
    for a, b in pairs[pairs[:, 0] != pairs[:, 1]].tolist():
        clash[a].add(b)
        clash[b].add(a)
    lost = np.unique(cut.face[cut.chart[cut.face] < 0])
    grow_again(cut, np.flatnonzero(np.isin(cut.chart, sorted(broken))), clash, limit)
    lay_flat_all(cut, lost)
    to_world_scale(cut)
    flat = set(lost.tolist())
    while (wide := too_wide(cut, limit)).size:
        faces = np.flatnonzero(np.isin(cut.chart, wide))
        single = faces[np.bincount(cut.chart[faces])[cut.chart[faces]] == 1]
        if not flat.isdisjoint(single.tolist()):
            raise Unplaceable(float(max(cut.uv[cut.loop(face)].max() for face in single)))
        grow_again(cut, np.setdiff1d(faces, single), clash, limit)
        lay_flat_all(cut, single)
        flat |= set(single.tolist())
        to_world_scale(cut)
    unmirror(cut)


def drop_turned_over(cut: Cut) -> set[int]:
    """Takes faces that are turned over beside the others out of their charts; those charts are returned."""
    placed = cut.chart[cut.face] >= 0
    of, shape = cut.chart[cut.face[placed]], cut.uv[cut.corners[placed]]
    count = int(of.max(initial=-1)) + 1
    signed = twice_areas(shape)
    extent = bounds_of(shape, of, count)[1].max(1)
    signed *= np.where(np.bincount(of, signed, count) < 0.0, -1.0, 1.0)[of]
    faces = np.unique(cut.face[placed][signed < -FLAT * extent[of] ** 2])
    broken = set(cut.chart[faces].tolist())
    cut.chart[faces] = -1
    return broken


def unmirror(cut: Cut) -> None:
    """Flips the charts that show their faces from behind, each in its own box, before anything is packed."""
    of = cut.chart[cut.face]
    placed = of >= 0
    count = int(of.max(initial=-1)) + 1
    signed = np.bincount(of[placed], twice_areas(cut.uv[cut.corners[placed]]), count)
    width = bounds_of(cut.uv[cut.corners[placed]], of[placed], count)[1][:, 0]
    of = np.repeat(cut.chart, np.diff(cut.face_start))
    mirrored = (of >= 0) & (signed < 0.0)[of]
    cut.uv[mirrored, 0] = width[of[mirrored]] - cut.uv[mirrored, 0]


def lay_flat_all(cut: Cut, faces: np.ndarray) -> None:
    """Makes each face a chart of its own and notes those that overlap themselves."""
    cut.chart[faces] = int(cut.chart.max(initial=-1)) + 1 + np.arange(len(faces))
    order = np.argsort(cut.face, kind="stable")
    first = np.searchsorted(cut.face[order], faces)
    last = np.searchsorted(cut.face[order], faces, "right")
    for face, a, b in zip(faces.tolist(), first, last, strict=True):
        lay_flat(cut, face, cut.corners[order[a:b]])


def too_wide(cut: Cut, limit: float) -> np.ndarray:
    """Numbers of the charts wider or higher than `limit`."""
    of = cut.chart[cut.face]
    placed = of >= 0
    extent = bounds_of(cut.uv[cut.corners[placed]], of[placed], int(of.max(initial=-1)) + 1)[1].max(1)
    return np.flatnonzero(extent > limit)
