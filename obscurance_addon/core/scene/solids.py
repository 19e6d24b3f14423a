"""Which triangles bound solids, seen from outside, and which look the other way than the rest of their surface.

A shell is a set of triangles connected over edges, corners in one place being one corner. It is closed if each of its
edges is shared by two triangles, or nearly so if its holes, covered by fans around their centres, are small. A closed
shell around a positive volume bounds a body, together with its cavities, the closed shells around negative volumes in
it: only its outside can be lit, so a ray that leaves a body which it has not entered started within it. Open sheets,
and closed shells around negative volumes that are no cavities (rooms modelled with normals inwards), are ordinary
two-sided surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from .components import EdgeUses, connected_components, places, sides

MAX_CAPS = 0.25  # area of the fans over the holes of a nearly closed shell, as a share of its own
_NO_HOLES = 1e-9  # area of fans, likewise, that is none: an edge that meets several shorter ones
_MIN_VOLUME = 1e-6  # of a nearly closed shell, as a share of its area to the power of 3/2: less is a sheet


@dataclass(frozen=True)
class Shells:
    """What the triangles of a mesh, or of several, belong to.

    Attributes
    ----------
    shell : ndarray, (t,) int32
        Number of the shell of each triangle: 1 + its lowest triangle.
    body : ndarray, (t,) int32
        Number of the body that each triangle bounds, that of its outer shell; 0 for none.
    has_holes : ndarray, (t,) bool
        Triangles of nearly closed shells that bound a body.
    inward : ndarray, (t,) bool
        Triangles of closed shells around negative volumes that are no cavities: rooms, or solids turned inside out.
    """

    shell: np.ndarray
    body: np.ndarray
    has_holes: np.ndarray
    inward: np.ndarray

    @classmethod
    def none(cls, n: int) -> Shells:
        """Those of n triangles that bound nothing, each a shell of its own."""
        return cls(np.arange(1, n + 1, dtype=np.int32), np.zeros(n, np.int32), *np.zeros((2, n), bool))

    @property
    def solid(self) -> np.ndarray:
        """(t,) bool: triangles that bound a body."""
        return self.body > 0

    def only(self, kept: np.ndarray) -> Shells:
        """Those of some triangles (k,) int; numbers stay."""
        return Shells(*(getattr(self, field.name)[kept] for field in fields(self)))

    def without_windows(self, transparent: np.ndarray) -> Shells:
        """The same where light passes some of the triangles (t,) bool: what these bound is no body."""
        body = np.where(np.isin(self.body, np.unique(self.body[transparent])), 0, self.body)
        return Shells(self.shell, body, self.has_holes & (body > 0), self.inward)

    def numbered_from(self, first: int) -> Shells:
        """The same where the first triangle is number `first` of a larger scene."""
        first = np.int32(first)
        return Shells(self.shell + first, np.where(self.solid, self.body + first, 0), self.has_holes, self.inward)

    @classmethod
    def joined(cls, parts: Sequence[Shells]) -> Shells:
        """Those of several meshes, one after the other."""
        first = np.cumsum([0, *(len(part.shell) for part in parts)])
        parts = [cls.none(0), *(part.numbered_from(at) for part, at in zip(parts, first, strict=False))]
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def find_shells(vertices: np.ndarray, triangles: np.ndarray) -> tuple[Shells, np.ndarray]:
    """Find the shells of a mesh, and the triangles that look the wrong way.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float
    triangles : ndarray, (t, 3) int

    Returns
    -------
    shells : Shells
        Flipped triangles are taken as turned.
    flipped : ndarray, (t,) bool
        Triangles that look to the other side of their shell than most of its area does. Where both sides have the same
        area: those that look inwards, if the shell is closed, else none.
    """
    vertices, shells, flipped = finite_or_nan(vertices), Shells.none(len(triangles)), np.zeros(len(triangles), bool)
    usable = np.isfinite(vertices[:, 0])[triangles].all(1)
    a, b, c = triangles.T
    usable &= (a != b) & (b != c) & (c != a)
    kept = np.flatnonzero(usable)
    if len(kept):
        with np.errstate(over="ignore", invalid="ignore"):  # of shells beyond all numbers, which bound nothing
            found = _Connected.of(vertices, triangles[kept])
        flipped[kept] = found.flipped
        shells.shell[kept] = kept[found.component] + 1
        _name_bodies(shells, vertices, np.where(flipped[:, None], triangles[:, ::-1], triangles), kept, found)
    return shells, flipped


def finite_or_nan(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) as float64, wholly NaN where a coordinate is not finite: differences of NaN raise no warning."""
    points = np.array(points, np.float64)
    points[~np.isfinite(points).all(1)] = np.nan
    return points


@dataclass(frozen=True)
class _Connected:
    """Triangles (t, 3) by the shells that they make up.

    Attributes
    ----------
    component : ndarray, (t,) int64
        The lowest triangle of each shell.
    flipped : ndarray, (t,) bool
    closed : ndarray, (t,) bool
        Triangles of shells that are closed, or nearly so.
    has_holes : ndarray, (t,) bool
        Which of these, at the lowest triangle of each.
    volume : ndarray, (t,) float64
        Six times the volume of each, there.
    area : ndarray, (t,) float64
        Of each, there.
    """

    component: np.ndarray
    flipped: np.ndarray
    closed: np.ndarray
    has_holes: np.ndarray
    volume: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, triangles: np.ndarray) -> _Connected:
        n, edges = len(triangles), EdgeUses.of(vertices, triangles)
        area = _areas(vertices[triangles])
        component, other_side, kind = sides(edges, area)
        total, origin = np.bincount(component, area, n), vertices[triangles[:, 0]]
        is_bad = np.zeros(n, bool)
        is_bad[component[np.concatenate([edges.crowded // 3, np.flatnonzero(kind == 0)])]] = True
        owner = edges.single // 3
        ends = np.where(
            other_side[owner],
            (edges.tail[edges.single], edges.head[edges.single]),
            (edges.head[edges.single], edges.tail[edges.single]),
        )
        caps, volume = _caps(vertices, ends, component[owner], origin)
        is_bad |= caps > MAX_CAPS * total
        closed = np.flatnonzero(~is_bad[component])
        oriented = np.where(other_side[closed, None], triangles[closed, ::-1], triangles[closed])
        volume += _volumes(vertices[oriented], component[closed], origin)
        is_even = (kind == 1)[component]
        turn_back = is_even & (~is_bad & (volume < 0.0))[component]
        flipped = np.where(is_even & is_bad[component], False, other_side ^ turn_back)
        volume[turn_back] *= -1.0
        return cls(component, flipped, ~is_bad[component], caps > _NO_HOLES * total, volume, total)


def _caps(
    vertices: np.ndarray, ends: np.ndarray, component: np.ndarray, origin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Area of the fans over the holes of each shell, and six times the volume that they add, (t,) each.

    Parameters
    ----------
    vertices : ndarray, (v, 3) float64
    ends : ndarray, (2, s) int
        Vertices where the edges of fans at the border of a shell begin and end.
    component : ndarray, (s,) int
        The shell of each.
    origin : ndarray, (t, 3) float64
        Points to which the volumes of shells are related.
    """
    if not len(component):
        return np.zeros(len(origin)), np.zeros(len(origin))
    used, number = np.unique(ends, return_inverse=True)
    place = places(vertices[used])[number.reshape(2, -1)]
    nodes, links = np.unique(component * len(used) + place, return_inverse=True)
    links = links.reshape(2, -1).T
    hole = connected_components(len(nodes), links)[links[:, 0]]
    a, b = vertices[ends]
    length = np.linalg.norm(b - a, axis=1)
    middle = np.stack([np.bincount(hole, length * column) for column in (0.5 * (a + b)).T], -1)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = (middle / np.bincount(hole, length)[:, None])[hole]
    fans = np.stack([a, b, centre], 1)
    return np.bincount(component, _areas(fans), len(origin)), _volumes(fans, component, origin)


def _name_bodies(
    shells: Shells, vertices: np.ndarray, triangles: np.ndarray, kept: np.ndarray, found: _Connected
) -> None:
    """Enter the bodies of triangles (t, 3), of which `found` is about those `kept` (k,) int."""
    with np.errstate(invalid="ignore", over="ignore"):  # areas beyond all numbers
        least = np.where(found.has_holes, 6.0 * _MIN_VOLUME * found.area**1.5, 0.0)
        is_shell = (np.abs(found.volume) > least) & np.isfinite(found.volume) & found.closed
    is_shell &= found.component == np.arange(len(kept))
    outer, inner = np.flatnonzero(is_shell & (found.volume > 0.0)), np.flatnonzero(is_shell & (found.volume < 0.0))
    body = np.zeros(len(kept), np.int32)
    body[outer] = kept[outer] + 1
    if len(outer) and len(inner):
        outer = outer[np.argsort(found.volume[outer], kind="stable")]
        around = _around(vertices[triangles[kept]], found.component, outer, inner)
        body[inner] = np.where(around >= 0, kept[around] + 1, 0)
    is_inward = np.zeros(len(kept), bool)
    is_inward[inner] = body[inner] == 0
    shells.body[kept], shells.inward[kept] = body[found.component], is_inward[found.component]
    shells.has_holes[kept] = found.has_holes[found.component] & shells.solid[kept]


def _around(corners: np.ndarray, component: np.ndarray, outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The first of the shells `outer` that is around each of the shells `inner` (m,) int64; -1 for none."""
    order = np.argsort(component, kind="stable")
    first, end = (np.searchsorted(component[order], outer, side) for side in ("left", "right"))
    parts = [corners[order[a:b]] for a, b in zip(first, end, strict=True)]
    low, high = (np.array([f(part, axis=(0, 1)) for part in parts]) for f in (np.min, np.max))
    found = np.full(len(inner), -1)
    for i, point in enumerate(corners[inner].mean(1)):
        for candidate in np.flatnonzero(((low <= point) & (point <= high)).all(1)):
            if _winding(point, parts[candidate]) > 0.5:
                found[i] = outer[candidate]
                break
    return found


def _winding(point: np.ndarray, corners: np.ndarray) -> float:
    """Winding number of triangles (t, 3, 3) around a point: the share of the sphere that they cover, seen from inside.

    Van Oosterom and Strackee, "The Solid Angle of a Plane Triangle" (1983).
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    dots = [np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a))]
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    return float(np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum() / (2.0 * np.pi))


def _areas(corners: np.ndarray) -> np.ndarray:
    """Areas (t,) of triangles (t, 3, 3)."""
    (ax, ay, az), (bx, by, bz) = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
    return 0.5 * np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)


def _volumes(corners: np.ndarray, component: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Six times the volume (n,) between triangles (t, 3, 3) and the origin (n, 3) of the shell of each, summed."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corners - origin[component][:, None]).transpose(1, 2, 0)  # keeps digits
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return np.bincount(component, volume, len(origin))
