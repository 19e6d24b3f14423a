"""Quadrilaterals, how they are cut into grids of patches, and how an exact number of patches is reached.

Plain Python and numpy: nothing here knows Blender.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

Vector = tuple[float, float, float]
Divisions = tuple[tuple[float, ...], ...]

WELD_DISTANCE = 1e-6
"""Vertices of one body that agree to a micrometre are one vertex; the smallest patch side here is five millimetres."""

CANDIDATE_MARGIN = 2
"""Around the ideal number of cells along a side, this many smaller and larger numbers are tried as well."""


@dataclass(frozen=True)
class Quad:
    """A four-sided polygon before meshing.

    Parameters
    ----------
    corners : tuple of 4 vectors
        Counter-clockwise as seen from the side that the polygon faces.
    axes : tuple of int
        Labels of the first side (corner 0 to 1) and of the second side (corner 0 to 3). Sides with the same label
        within a body are cut at the same fractions, which is what lets the grids of neighbours meet vertex to vertex.
    material : str
        Name of the material.
    opening : tuple of float, optional
        (u0, u1, v0, v1) fractions of a hole; grid cells with their centre in it are left out.
    """

    corners: tuple[Vector, Vector, Vector, Vector]
    axes: tuple[int, int]
    material: str
    opening: tuple[float, float, float, float] | None = None

    @property
    def side_lengths(self) -> tuple[float, float]:
        """Mean length of the two sides along the first label and of the two along the second."""
        c0, c1, c2, c3 = self.corners
        return (math.dist(c0, c1) + math.dist(c3, c2)) / 2, (math.dist(c0, c3) + math.dist(c1, c2)) / 2

    @property
    def area(self) -> float:
        """Area of the two triangles (0, 1, 2) and (0, 2, 3)."""
        c = np.array(self.corners)
        return 0.5 * float(sum(np.linalg.norm(np.cross(c[k] - c[0], c[k + 1] - c[0])) for k in (1, 2)))

    def flipped(self) -> Quad:
        """Return the same polygon facing the other way."""
        c0, c1, c2, c3 = self.corners
        hole = self.opening and (*self.opening[2:], *self.opening[:2])
        return replace(self, corners=(c0, c3, c2, c1), axes=self.axes[::-1], opening=hole)

    def point(self, u: float, v: float) -> Vector:
        """Return the bilinear point at the fractions u and v of the two sides."""
        c0, c1, c2, c3 = self.corners
        x, y, z = (_between(_between(a, b, u), _between(d, c, u), v) for a, b, c, d in zip(c0, c1, c2, c3, strict=True))
        return x, y, z


@dataclass(frozen=True)
class Body:
    """Quads that are welded together where their grids meet: a solid, a room shell or a single sheet.

    Parameters
    ----------
    name : str
        For messages and look-ups.
    quads : tuple of Quad
        The polygons before meshing.
    divisions : tuple of tuples of float
        For each axis label the increasing fractions, from 0 to 1, at which sides with that label are cut.
    """

    name: str
    quads: tuple[Quad, ...]
    divisions: Divisions = ()

    def divided(self, *counts: int) -> Body:
        """Return this body with label k cut into counts[k] equal lengths."""
        return replace(self, divisions=tuple(uniform(count) for count in counts))

    def axis_lengths(self) -> tuple[float, ...]:
        """Return for each axis label the mean length of the sides that carry it."""
        sides: dict[int, list[float]] = {}
        for quad in self.quads:
            for axis, length in zip(quad.axes, quad.side_lengths, strict=True):
                sides.setdefault(axis, []).append(length)
        return tuple(sum(sides[axis]) / len(sides[axis]) for axis in sorted(sides))

    def mesh(self) -> tuple[list[Vector], list[tuple[int, ...]], list[str]]:
        """Return welded vertices, faces as vertex numbers, and the material name of each face."""
        vertices: list[Vector] = []
        number_of: dict[tuple[int, ...], int] = {}
        faces: list[tuple[int, ...]] = []
        materials: list[str] = []

        def vertex(point: Vector) -> int:
            key = tuple(round(x / WELD_DISTANCE) for x in point)
            if key not in number_of:
                number_of[key] = len(vertices)
                vertices.append(point)
            return number_of[key]

        for quad in self.quads:
            for u0, u1, v0, v1 in _cells(quad, self.divisions):
                corners = (quad.point(u0, v0), quad.point(u1, v0), quad.point(u1, v1), quad.point(u0, v1))
                faces.append(tuple(vertex(point) for point in corners))
                materials.append(quad.material)
        return vertices, faces, materials

    def patch_count(self) -> int:
        """Return the number of grid cells over all quads."""
        return sum(1 for quad in self.quads for _ in _cells(quad, self.divisions))


def uniform(count: int) -> tuple[float, ...]:
    """Return the count + 1 fractions that cut a side into equal lengths."""
    return tuple(k / count for k in range(count + 1))


def piecewise(stops: Sequence[float], counts: Sequence[int]) -> tuple[float, ...]:
    """Return fractions that pass through all stops, with counts[k] equal cells between stops k and k + 1."""
    fractions = [stops[0]]
    for (start, stop), count in zip(itertools.pairwise(stops), counts, strict=True):
        fractions += [_between(start, stop, k / count) for k in range(1, count + 1)]
    return tuple(fractions)


def hexahedron(bottom: Sequence[Vector], top: Sequence[Vector], material: str) -> dict[str, Quad]:
    """Return the six outward facing sides of a solid.

    Parameters
    ----------
    bottom, top : sequences of 4 vectors
        Corners, counter-clockwise as seen from above; top[k] lies over bottom[k].
    material : str
        Name of the material of every side.

    Returns
    -------
    dict of str to Quad
        Sides bottom, top, front (corners 0-1), right (1-2), back (2-3), left (3-0). Axis labels: 0 from corner 0 to 1,
        1 from corner 1 to 2, 2 from bottom to top; fractions on every side grow in these directions.
    """
    b0, b1, b2, b3 = bottom
    t0, t1, t2, t3 = top
    return {
        "bottom": Quad((b0, b3, b2, b1), (1, 0), material),
        "top": Quad((t0, t1, t2, t3), (0, 1), material),
        "front": Quad((b0, b1, t1, t0), (0, 2), material),
        "right": Quad((b1, b2, t2, t1), (1, 2), material),
        "back": Quad((b3, t3, t2, b2), (2, 0), material),
        "left": Quad((b0, t0, t3, b3), (2, 1), material),
    }


def box_sides(lower: Vector, upper: Vector, material: str) -> dict[str, Quad]:
    """Return the six outward facing sides of an axis-aligned box, named as in `hexahedron`."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    footprint = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return hexahedron([(x, y, z0) for x, y in footprint], [(x, y, z1) for x, y in footprint], material)


def box(name: str, lower: Vector, upper: Vector, material: str) -> Body:
    """Return a solid axis-aligned box, not yet divided."""
    return Body(name, tuple(box_sides(lower, upper, material).values()))


def choose_divisions(bodies: Iterable[Body], total: int) -> list[Body]:
    """Divide bodies so that they have exactly `total` patches, as square and as equal in size as possible.

    The ideal patch is a square with side h = sqrt(area of all bodies / total). A quad cut into patches with sides s and
    t costs its area times ln(s/h)^2 + ln(t/h)^2. Each axis of each body may be cut into a number of cells near
    length / h. Among all choices whose patches add up to the total, the one with the least summed cost is taken, found
    exactly by dynamic programming over the running number of patches. Bodies with equal axis lengths (the legs of a
    table) get equal divisions.

    Parameters
    ----------
    bodies : iterable of Body
        Their present divisions are ignored.
    total : int
        Wanted number of patches.

    Returns
    -------
    list of Body
        The bodies in the given order, with uniform divisions.

    Raises
    ------
    ValueError
        If no choice adds up to the total.
    """
    bodies = list(bodies)
    edge = math.sqrt(sum(quad.area for body in bodies for quad in body.quads) / total)
    groups: dict[tuple[float, ...], list[Body]] = {}
    for body in bodies:
        groups.setdefault(tuple(round(length, 6) for length in body.axis_lengths()), []).append(body)

    cost = np.full(total + 1, np.inf)
    cost[0] = 0.0
    steps: list[tuple[list[tuple[tuple[int, ...], int]], np.ndarray]] = []
    for members in groups.values():
        options = [
            (counts, patches * len(members), price * len(members))
            for counts, patches, price in _options(members[0], edge)
        ]
        best, chosen = np.full(total + 1, np.inf), np.full(total + 1, -1)
        for index, (_, patches, price) in enumerate(options):
            if patches > total:
                continue
            reached = cost[: total + 1 - patches] + price
            better = np.flatnonzero(reached < best[patches:])
            best[patches + better], chosen[patches + better] = reached[better], index
        steps.append(([(counts, patches) for counts, patches, _ in options], chosen))
        cost = best
    if not np.isfinite(cost[total]):
        raise ValueError(f"no choice of grids gives exactly {total} patches")

    counts_of: dict[str, tuple[int, ...]] = {}
    remaining = total
    for members, (options, chosen) in zip(reversed(groups.values()), reversed(steps), strict=True):
        counts, patches = options[chosen[remaining]]
        counts_of |= {body.name: counts for body in members}
        remaining -= patches
    return [body.divided(*counts_of[body.name]) for body in bodies]


def _options(body: Body, edge: float) -> list[tuple[tuple[int, ...], int, float]]:
    """List (cells per axis, patches, cost) of every division of a body that is worth trying."""
    ranges = []
    for length in body.axis_lengths():
        ideal = length / edge
        ranges.append(range(max(1, math.floor(ideal) - CANDIDATE_MARGIN + 1), math.ceil(ideal) + CANDIDATE_MARGIN))
    options = []
    for counts in itertools.product(*ranges):
        patches, price = 0, 0.0
        for quad in body.quads:
            cells = [counts[axis] for axis in quad.axes]
            error = sum(math.log(side / (n * edge)) ** 2 for side, n in zip(quad.side_lengths, cells, strict=True))
            patches += cells[0] * cells[1]
            price += quad.area * error
        options.append((counts, patches, price))
    return options


def _cells(quad: Quad, divisions: Divisions) -> Iterable[tuple[float, float, float, float]]:
    """Yield the fractions (u0, u1, v0, v1) of the grid cells of a quad, without those in its opening."""
    us, vs = (divisions[axis] for axis in quad.axes)
    for v0, v1 in itertools.pairwise(vs):
        for u0, u1 in itertools.pairwise(us):
            if quad.opening:
                left, right, low, high = quad.opening
                if left < (u0 + u1) / 2 < right and low < (v0 + v1) / 2 < high:
                    continue
            yield u0, u1, v0, v1


def _between(a: float, b: float, fraction: float) -> float:
    """Interpolate so that both ends, and a side with a == b, come out without rounding."""
    return b if fraction == 1.0 else a + (b - a) * fraction
