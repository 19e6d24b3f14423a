"""Which bodies are rooms of what they enclose, and which closed shells are turned inside out.

A body is the room of a shell if it holds at least half of its area, and holds at least one shell wholly. Rays from what
is in a room take its walls for ordinary surfaces; for everything else the body stays solid. A body that closes but for
small holes, and is a room, is solid for nobody.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields

import numpy as np

from ..scene import OFFSET, Shells
from .bodies import Bodies

HALF, WHOLE = 0.5, 0.999  # shares of area
_POINTS = 16  # of each shell at most
_SMALL, _LARGE = 4.0 * OFFSET, 0.01  # steps off the surface, of its largest coordinate and of the shell's diagonal
_PAIRS = 1 << 20  # of a box and a shell that are looked at together, about
_POKES = 0.002  # share of the diagonal of a body by which a box may stand out of its own


@dataclass(frozen=True)
class ShellPoints:
    """The u shells of a scene or of an object, and points on them, normalised.

    Attributes
    ----------
    number : ndarray, (u,) int32
        Ascending, above 0.
    body : ndarray, (u,) int32
        That the shell bounds, 0 for none.
    has_holes, inward : ndarray, (u,) bool
        As of `Shells`.
    low, high : ndarray, (u, 3) float64
        Corners of their boxes.
    start : ndarray, (u,) int64
        The first point of each.
    weight : ndarray, (q,) float64
        Share of the shell's area for which a point stands.
    points : ndarray, (q, 2, 3) float32
        Two places next to each: off an open sheet, or within a closed shell nearby and farther away, so that it may
        touch the walls of a room, or poke through them a little.
    """

    number: np.ndarray
    body: np.ndarray
    has_holes: np.ndarray
    inward: np.ndarray
    low: np.ndarray
    high: np.ndarray
    start: np.ndarray
    weight: np.ndarray
    points: np.ndarray

    @classmethod
    def of(
        cls, vertices: np.ndarray, triangles: np.ndarray, shells: Shells, apply: Callable = lambda points: points
    ) -> ShellPoints:
        """Those of triangles (t, 3); `apply` normalises some of the vertices (v, 3) float64."""
        if not len(triangles):
            return cls.none()
        order = np.argsort(shells.shell, kind="stable")
        number, first, count = np.unique(shells.shell[order], return_index=True, return_counts=True)
        corners = apply(vertices)[triangles[order]]
        low, high = np.minimum.reduceat(corners.min(1), first), np.maximum.reduceat(corners.max(1), first)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        total, before = np.add.reduceat(area, first), np.cumsum(area) - area
        per_shell = np.minimum(count, _POINTS)
        start = np.cumsum(per_shell) - per_shell
        owner, rank = (
            np.repeat(np.arange(len(number)), per_shell),
            np.arange(per_shell.sum()) - np.repeat(start, per_shell),
        )
        spread = before[first][owner] + (rank + 0.5) / _POINTS * total[owner]
        many = (count > _POINTS)[owner]
        picked = np.where(many, np.searchsorted(before, spread, side="right") - 1, first[owner] + rank)
        picked = np.clip(picked, first[owner], (first + count - 1)[owner])
        weight = np.where(many, 1.0 / _POINTS, area[picked] / np.maximum(total[owner], 1e-300))
        normal = across[picked] / np.maximum(area[picked], 1e-300)[:, None]
        middle = corners[picked].mean(1)
        closed = (shells.body > 0)[order[first]] | shells.inward[order[first]]
        extent = high - low
        deep = np.minimum(_LARGE * np.linalg.norm(extent, axis=1), 0.5 * extent.min(1))[owner, None]
        near = _SMALL * np.abs(corners[picked]).max((1, 2))[:, None]
        side = np.where(shells.inward[order[first]], 1.0, -1.0)[owner, None]  # where the inside of a closed shell is
        is_closed = closed[owner, None]
        points = np.stack(
            [
                middle + np.where(is_closed, side * near, near) * normal,
                middle + np.where(is_closed, side * np.maximum(deep, near), near) * normal,
            ],
            1,
        )
        of_first = shells.only(order[first])
        kinds = of_first.body, of_first.has_holes, of_first.inward
        return cls(number.astype(np.int32), *kinds, low, high, start, weight, points.astype(np.float32))

    @classmethod
    def none(cls) -> ShellPoints:
        """Those of nothing."""
        numbers, flags, corners = np.zeros((2, 0), np.int32), np.zeros((2, 0), bool), np.zeros((2, 0, 3))
        return cls(*numbers, *flags, *corners, np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2, 3), np.float32))

    def numbered_from(self, first: int) -> ShellPoints:
        """The same where the first triangle is number `first` of a larger scene."""
        first = np.int32(first)
        rest = (getattr(self, field.name) for field in fields(self)[2:])
        return ShellPoints(self.number + first, np.where(self.body > 0, self.body + first, 0), *rest)

    @classmethod
    def joined(cls, parts: Iterable[ShellPoints]) -> ShellPoints:
        """Those of several objects, of ascending numbers."""
        parts = [cls.none(), *parts]
        first = np.cumsum([0, *(len(part.weight) for part in parts)])
        columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(cls)}
        columns["start"] = [start + at for start, at in zip(columns["start"], first, strict=False)]
        return cls(**{name: np.concatenate(column) for name, column in columns.items()})


@dataclass(frozen=True)
class Rooms:
    """Who is in which room.

    Attributes
    ----------
    shell, body : ndarray, (k,) int32
        Pairs of a shell and a body that is a room for it, ascending by shell.
    turned : ndarray, (j,) int32
        Closed shells with normals inwards that hold nothing, though there is something else.
    away : ndarray, (i,) int32
        Sheets that look away from the scene, where that was asked for.
    """

    shell: np.ndarray
    body: np.ndarray
    turned: np.ndarray
    away: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))

    def of(self, shells: np.ndarray) -> np.ndarray | None:
        """Rooms of shells (p,) int32, (p, depth) int32, filled up with 0; None where nobody is in a room."""
        tenants, first, count = np.unique(self.shell, return_index=True, return_counts=True)
        if not np.isin(shells, tenants).any():
            return None
        table = np.zeros((len(tenants) + 1, count.max()), np.int32)
        row = np.repeat(np.arange(len(tenants)), count)
        table[row, np.arange(len(row)) - first[row]] = self.body
        at = np.minimum(np.searchsorted(tenants, shells), len(tenants) - 1)
        return table[np.where(tenants[at] == shells, at, len(tenants))]


def settle_rooms(shells: ShellPoints, bodies: Bodies | None) -> tuple[Bodies | None, Rooms]:
    """The bodies that are solid for somebody, and the rooms."""
    rooms = find_rooms(shells, bodies)
    if bodies is None:
        return None, rooms
    return bodies.without(np.intersect1d(shells.body[shells.has_holes], rooms.body)), rooms


def find_rooms(shells: ShellPoints, bodies: Bodies | None) -> Rooms:
    """Find the rooms among bodies."""
    by_place = _ByPlace(shells)
    tenants, rooms = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    if bodies is not None:
        row, fit = by_place.fitting(*bodies.boxes)
        other = shells.body[fit] != bodies.numbers[row]
        row, fit = row[other], fit[other]
        for candidate in np.unique(row):
            number, (low, high) = bodies.numbers[candidate], bodies.boxes[:, candidate]
            if (_shares(shells, np.sort(fit[row == candidate]), bodies, candidate) < WHOLE).all():
                continue
            others = np.flatnonzero((shells.low <= high).all(1) & (shells.high >= low).all(1) & (shells.body != number))
            inside = others[_shares(shells, others, bodies, candidate) >= HALF]
            tenants.append(shells.number[inside])
            rooms.append(np.full(len(inside), number, np.int32))
    tenant, room = np.concatenate(tenants), np.concatenate(rooms)
    order = np.argsort(tenant, kind="stable")
    return Rooms(tenant[order], room[order], _turned(shells, by_place))


class _ByPlace:
    """Shells in the order in which they begin along the axis where they are spread most, so that few are looked at."""

    def __init__(self, shells: ShellPoints) -> None:
        self._shells = shells
        self._axis = int(np.argmax(np.ptp(shells.low, axis=0))) if len(shells.low) else 0
        self._order = np.argsort(shells.low[:, self._axis], kind="stable")
        self._begin = shells.low[self._order, self._axis]

    def fitting(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of a box, of those from `low` to `high` (k, 3) each, and a shell in it, but for a little; (m,) int."""
        pokes = _POKES * np.linalg.norm(high - low, axis=1)
        first = np.searchsorted(self._begin, low[:, self._axis] - pokes)
        count = np.searchsorted(self._begin, high[:, self._axis] + pokes) - first
        low, high, shells = low - pokes[:, None], high + pokes[:, None], self._shells
        pairs = [np.zeros((2, 0), np.int64)]
        ends = np.cumsum(count)
        parts = np.flatnonzero(np.diff(ends // _PAIRS, prepend=-1))  # where boxes begin that are looked at together
        for begin, end in itertools.pairwise([*parts, len(low)]):
            box = np.repeat(np.arange(begin, end), count[begin:end])
            place = np.arange(len(box)) - np.repeat((ends - count)[begin:end] - (ends - count)[begin], count[begin:end])
            row = self._order[first[box] + place]
            fits = ((shells.low[row] >= low[box]) & (shells.high[row] <= high[box])).all(1)
            pairs.append(np.stack([box[fits], row[fits]]))
        return tuple(np.concatenate(pairs, axis=1))


def _shares(shells: ShellPoints, which: np.ndarray, bodies: Bodies, row: int) -> np.ndarray:
    """Share of the area of shells (m,) int that is inside of a body."""
    count = np.diff(np.append(shells.start, len(shells.weight)))[which]
    owner = np.repeat(np.arange(len(which)), count)
    at = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + shells.start[which][owner]
    inside = bodies.contains(row, shells.points[at].reshape(-1, 3)).reshape(-1, 2).any(1)
    return np.bincount(owner, shells.weight[at] * inside, len(which))


def _turned(shells: ShellPoints, by_place: _ByPlace) -> np.ndarray:
    """Numbers of the closed shells with normals inwards that hold no other shell, though there is one."""
    inward = np.flatnonzero(shells.inward)
    if len(shells.number) == 1:
        return shells.number[:0]
    box, _ = by_place.fitting(shells.low[inward], shells.high[inward])
    return shells.number[inward[np.bincount(box, minlength=len(inward)) <= 1]]  # one is itself
