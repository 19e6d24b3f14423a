"""Where the faces of the objects to bake lie in a lightmap: unwrapped anew, or as a UV map says. Any thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import GeometryError
from ..lightmap import (
    AtlasLayout,
    LightmapSettings,
    TooManyChartsError,
    UnwrapMesh,
    UvMode,
    charts_of,
    unwrap,
)
from ..notes import Notes, named
from ..shading import FaceShading
from .arrays import ObjectRange
from .patch_parts import WorldObject
from .snapshot import ObjectSnapshot, SceneSnapshot

_COLUMNS, MOST_PAGES = 10, 100  # of UDIM tiles: ten in a row, and as many rows as fit into memory
_ON_BORDER = 1e-5  # how far UVs may stand out of their tile


@dataclass(frozen=True)
class LaidOut:
    """A layout, and what to tell and to write of it.

    Attributes
    ----------
    layout : AtlasLayout
    uv : list of ndarray, (c, 2) float32, or None
        The UV map to write on each object; None where the objects keep theirs.
    texels_per_metre : float or None
        Where faces were unwrapped.
    seconds : float
        Spent by the unwrapper.
    notes : list of str
    """

    layout: AtlasLayout
    uv: list[np.ndarray] | None
    texels_per_metre: float | None
    seconds: float
    notes: list[str] = field(default_factory=list)


def lay_out(
    snapshot: SceneSnapshot,
    ranges: list[ObjectRange],
    lightmap: LightmapSettings,
    metres_per_unit: float,
    check: Callable[[], None],
    progress: Callable[[float], None],
) -> LaidOut:
    """Find the place of every face to bake.

    Parameters
    ----------
    snapshot : SceneSnapshot
        Taken for this lightmap.
    ranges : list of ObjectRange
        Of the faces of its objects.
    lightmap : LightmapSettings
    metres_per_unit : float
    check : callable
        Raises when the bake is cancelled.
    progress : callable
        Told the share that is done, 0 .. 1.

    Raises
    ------
    GeometryError
        When no face can be laid out, or not all of them on as many pages as there may be.
    BackendError
        When the unwrapper is missing or fails.
    """
    objects = [baked.snapshot for baked in snapshot.baked]
    worlds = [WorldObject.of(ob, FaceShading(np.zeros((0, 3)), np.zeros((0, 3)), None)) for ob in objects]
    if lightmap.uv_mode is UvMode.KEEP:
        places, notes = _kept(objects, worlds)
        pages = 1 + int(max(of.page.max(initial=-1) for of in places))
        return LaidOut(_join(objects, worlds, ranges, places, pages), None, None, 0.0, notes)
    density = lightmap.texels_per_metre
    meshes = [
        UnwrapMesh(
            ob.name,
            world.vertices,
            ob.mesh.corner_vertex,
            ob.mesh.face_start,
            world.triangle_corners,
            ob.mesh.triangle_face,
        )
        for ob, world in zip(objects, worlds, strict=True)
    ]
    try:
        atlas = unwrap(
            meshes,
            size=lightmap.size,
            padding=lightmap.padding,
            unwrapper=lightmap.unwrapper,
            texels_per_metre=None if density is None else density * metres_per_unit,
            check=check,
            progress=progress,
        )
    except TooManyChartsError as error:
        raise GeometryError(f"{error}; {lightmap.cure_for(error.charts)}") from error
    places = [
        _Places(uv[world.triangle_corners].astype(np.float64), page[face], chart[face])
        for uv, page, chart, world, face in zip(
            atlas.uv, atlas.page, atlas.chart, worlds, (ob.mesh.triangle_face for ob in objects), strict=True
        )
    ]
    return LaidOut(
        _join(objects, worlds, ranges, places, atlas.pages),
        [_in_tiles(uv, page, ob) for uv, page, ob in zip(atlas.uv, atlas.page, objects, strict=True)],
        atlas.texels_per_metre / metres_per_unit,
        atlas.seconds,
        atlas.notes,
    )


@dataclass(frozen=True)
class _Places:
    """Where the triangles of one object lie: within their page (t, 3, 2), and page and chart (t,) of each."""

    uv: np.ndarray
    page: np.ndarray
    chart: np.ndarray


def _kept(objects: list[ObjectSnapshot], worlds: list[WorldObject]) -> tuple[list[_Places], list[str]]:
    """Places of the triangles of objects that keep their UV map, and what to tell of them."""
    found, notes, charts = [], Notes(), 0
    for ob, world in zip(objects, worlds, strict=True):
        mesh = ob.mesh
        with np.errstate(invalid="ignore"):
            uv = mesh.uv.astype(np.float64)[world.triangle_corners]
            tile = np.floor(uv.mean(1))
            uv -= tile[:, None]
            page = tile[:, 0] + _COLUMNS * tile[:, 1]
            inside = (tile >= 0.0).all(1) & (tile[:, 0] < _COLUMNS) & (page < MOST_PAGES)
            inside &= (np.abs(uv - 0.5) <= 0.5 + _ON_BORDER).all((1, 2))
        if not inside.all():
            where = f"outside of the image tiles in UV map '{mesh.uv_map}', or across their borders"
            notes.add(f"faces lie {where}, so they got nothing", ob.name, cure="move them, or let the bake unwrap")
        chart = charts_of(mesh.corner_vertex, mesh.uv, world.triangle_corners) + charts
        charts = int(chart.max(initial=-1)) + 1
        found.append(_Places(uv, np.where(inside, page, -1).astype(np.int32), chart))
    if not any((places.page >= 0).any() for places in found):
        maps = named(ob.mesh.uv_map for ob in objects)
        raise GeometryError(
            f"no face lies within an image tile in the UV map {maps}; move them, or let the bake unwrap"
        )
    return found, notes.lines()


def _join(
    objects: list[ObjectSnapshot],
    worlds: list[WorldObject],
    ranges: list[ObjectRange],
    places: list[_Places],
    pages: int,
) -> AtlasLayout:
    return AtlasLayout(
        corners=np.concatenate([world.vertices[world.triangles] for world in worlds]),
        uv=np.concatenate([of.uv for of in places]),
        page=np.concatenate([of.page for of in places]),
        chart=np.concatenate([of.chart for of in places]),
        face=np.concatenate(
            [ob.mesh.triangle_face.astype(np.int64) + part.first for ob, part in zip(objects, ranges, strict=True)]
        ),
        pages=pages,
    )


def _in_tiles(uv: np.ndarray, page: np.ndarray, ob: ObjectSnapshot) -> np.ndarray:
    """UVs (c, 2) float32 as Blender has them for image tiles, from those within the page (f,) of each face."""
    tile = np.repeat(np.maximum(page, 0), np.diff(ob.mesh.face_start))
    return (uv + np.stack([tile % _COLUMNS, tile // _COLUMNS], -1)).astype(np.float32)
