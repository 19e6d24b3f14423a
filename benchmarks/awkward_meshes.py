"""Seeded meshes to try unwrappers on (with Blender): usual shapes, and what is wrong with meshes that people have."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import bpy
import numpy as np

from obscurance_addon.core.lightmap import UnwrapMesh

MOST = 10_000  # triangles, about
Shape = tuple[np.ndarray, list]  # vertices (v, 3), and faces as lists of them
Random = np.random.Generator


def mesh_of(number: int, most: int = MOST) -> tuple[str, UnwrapMesh]:
    """The kind and the mesh of a number; equal numbers give equal meshes."""
    random = np.random.default_rng([17, number])
    kinds = list(KINDS)
    kind = kinds[number % len(kinds)]
    size = int(np.exp(random.uniform(0.0, np.log(most))))
    points, faces = KINDS[kind](random, size)
    return kind, polygons(kind, points, faces)


def polygons(name: str, points: np.ndarray, faces: list) -> UnwrapMesh:
    """A mesh of polygons, cut into triangles by Blender."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(points, float).tolist(), [], faces)
    mesh.calc_loop_triangles()
    corners, owner = np.zeros(3 * len(mesh.loop_triangles), np.int32), np.zeros(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    mesh.loop_triangles.foreach_get("polygon_index", owner)
    bpy.data.meshes.remove(mesh)
    start = np.cumsum([0, *map(len, faces)])
    vertex = np.concatenate(faces).astype(int)
    return UnwrapMesh(
        name, np.asarray(points, float), vertex, start, corners.reshape(-1, 3).astype(int), owner.astype(int)
    )


def grid(rows: int, columns: int, around: bool = False, both: bool = False) -> list:
    """Quads of a grid of vertices; closed along its columns, or along both ways."""
    wide, high = columns + (not around), rows + (not both)
    return [
        [i * wide + j, i * wide + (j + 1) % wide, (i + 1) % high * wide + (j + 1) % wide, (i + 1) % high * wide + j]
        for i in range(rows)
        for j in range(columns)
    ]


def _sides(size: int, least: int = 1) -> tuple[int, int]:
    side = max(least, int(np.sqrt(size / 2)))
    return side, side


def _flat(rows: int, columns: int) -> np.ndarray:
    y, x = np.mgrid[: rows + 1, : columns + 1].reshape(2, -1)
    return np.stack([x / columns, y / rows, 0.0 * x], 1)


def box(random: Random, size: int) -> Shape:
    side = max(1, int(np.sqrt(size / 12)))
    points, faces = [], []
    flat = 2.0 * _flat(side, side) - [1.0, 1.0, -1.0]
    for turn in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for sign in (1.0, -1.0):
            one = flat[:, turn] * sign
            faces += [[v + len(points) * len(flat) for v in face[:: int(sign)]] for face in grid(side, side)]
            points.append(one)
    points, index = np.unique(np.concatenate(points).round(9), axis=0, return_inverse=True)
    return points * random.uniform(0.1, 3.0, 3), [index.reshape(-1)[face].tolist() for face in faces]


def ball(random: Random, size: int) -> Shape:
    rows, columns = _sides(size, 3)
    points = _flat(rows, columns)[: (rows + 1) * (columns + 1)]
    u, v = 2.0 * np.pi * points[:, 0], np.pi * points[:, 1]
    points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), -np.cos(v)], 1).round(9) + 0.0
    points, index = np.unique(points, axis=0, return_inverse=True)
    faces = [list(dict.fromkeys(index.reshape(-1)[face].tolist())) for face in grid(rows, columns)]
    return points * random.uniform(0.5, 1.5, 3), [face for face in faces if len(face) > 2]


def torus(random: Random, size: int) -> Shape:
    rows, columns = _sides(size, 3)
    i, j = np.mgrid[:rows, :columns].reshape(2, -1)
    u, v, minor = 2.0 * np.pi * i / rows, 2.0 * np.pi * j / columns, random.uniform(0.01, 0.9)
    ring = 1.0 + minor * np.cos(v)
    return np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], 1), grid(rows, columns, True, True)


def tube(random: Random, size: int) -> Shape:
    """Closed around, open at its ends, bent by a random curve."""
    rows, columns = max(1, size // 40), random.integers(3, 21)
    i, j = np.mgrid[: rows + 1, :columns].reshape(2, -1)
    path = np.cumsum(random.normal(size=(rows + 1, 3)) * 0.1 + [0.3, 0.0, 0.0], 0)[i]
    turn = 2.0 * np.pi * j / columns
    return path + 0.1 * np.stack([0.0 * turn, np.cos(turn), np.sin(turn)], 1), grid(rows, columns, True)


def terrain(random: Random, size: int, rough: float = 0.3) -> Shape:
    rows, columns = _sides(size)
    points = _flat(rows, columns)
    for octave in 2.0 ** np.arange(5):
        phase = random.uniform(0.0, 6.3, 2)
        points[:, 2] += rough / octave * np.prod(np.sin(3.0 * octave * points[:, :2] + phase), 1)
    return points, grid(rows, columns)


def noise(random: Random, size: int) -> Shape:
    points, faces = terrain(random, min(size, 3000))
    return points + random.normal(size=points.shape) * random.choice([0.1, 0.5, 2.0]) / np.sqrt(len(points)), faces


def soup(random: Random, size: int) -> Shape:
    """Triangles that share few or many vertices at random: edges of one to many faces, either way round."""
    size = min(size, 2000)
    points = random.uniform(-1.0, 1.0, (max(4, int(size * random.choice([0.1, 0.5, 3.0]))), 3))
    return points, [random.choice(len(points), 3, replace=False).tolist() for _ in range(size)]


def slivers(random: Random, size: int) -> Shape:
    """Triangles up to a million times as long as wide."""
    size = min(size, 3000)
    start, along, across = random.normal(size=(3, size, 3))
    width = 10.0 ** random.uniform(-6.0, 0.0, (size, 1))
    points = np.stack([start, start + along, start + 0.5 * along + width * across], 1).reshape(-1, 3)
    return points, np.arange(3 * size).reshape(-1, 3).tolist()


def degenerate(random: Random, size: int) -> Shape:
    """A terrain a tenth of whose vertices lie in the place of a neighbour."""
    points, faces = terrain(random, size)
    moved = random.choice(len(points) - 1, len(points) // 10, replace=False)
    points[moved] = points[moved + 1]
    return points, faces


def coincident(random: Random, size: int) -> Shape:
    """Faces twice in the same place, in the same sense or turned over, on vertices of their own or not."""
    points, faces = random.choice([ball, box, terrain])(random, max(2, size // 2))
    again = [face[:: random.choice([1, -1])] for face in faces]
    if random.random() < 0.5:
        return points, faces + again
    return np.concatenate([points, points]), faces + [[v + len(points) for v in face] for face in again]


def split(random: Random, size: int) -> Shape:
    """Each face has vertices of its own, in the places of its neighbours'."""
    points, faces = random.choice([ball, torus, terrain])(random, size)
    lengths = np.cumsum([0, *map(len, faces)])
    return points[np.concatenate(faces)], [list(range(a, b)) for a, b in itertools.pairwise(lengths)]


def bits(random: Random, size: int) -> Shape:
    """Many small shapes, some of them through each other."""
    points, faces, first = [], [], 0
    for _ in range(min(60, max(1, size // 20))):
        one, own = random.choice([ball, box, torus, terrain])(random, random.integers(1, 60))
        points.append(one * random.uniform(0.05, 0.5) + random.uniform(-2.0, 2.0, 3))
        faces += [[v + first for v in face] for face in own]
        first += len(one)
    return np.concatenate(points), faces


def huge(random: Random, size: int) -> Shape:
    points, faces = random.choice([ball, box, terrain])(random, size)
    return points * 10.0 ** random.uniform(3.0, 12.0), faces


def small(random: Random, size: int) -> Shape:
    """Down to a nanometre, beside the origin or metres from it."""
    points, faces = random.choice([ball, box, terrain])(random, size)
    return points * 10.0 ** random.uniform(-9.0, -3.0) + random.choice([0.0, 1.0]) * random.normal(size=3), faces


def uneven(random: Random, size: int) -> Shape:
    """A shape whose faces differ in size by up to a million, in one direction or in all."""
    points, faces = random.choice([ball, terrain, torus])(random, size)
    power = random.uniform(1.0, 6.0)
    if random.random() < 0.5:
        return points * [1.0, 10.0**-power, 1.0], faces
    return np.sign(points) * np.abs(points) ** power, faces


def fan(random: Random, size: int) -> Shape:
    """A flat disc of triangles around one vertex."""
    size = max(3, min(size, 2000))
    turn = np.sort(random.uniform(0.0, 2.0 * np.pi, size))
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1)
    return np.concatenate([[[0.0, 0.0, 0.0]], ring]), [[0, 1 + i, 1 + (i + 1) % size] for i in range(size)]


def one(random: Random, size: int) -> Shape:
    return random.normal(size=(3, 3)), [[0, 1, 2]]


def monkey(random: Random, size: int) -> Shape:
    """Blender's, whole or in part, bent a little."""
    import bmesh  # which the bpy module has once it is imported

    made = bmesh.new()
    bmesh.ops.create_monkey(made)
    points = np.array([vertex.co for vertex in made.verts])
    faces = [[vertex.index for vertex in face.verts] for face in made.faces]
    made.free()
    kept = faces if random.random() < 0.5 else faces[: max(1, size % len(faces))]
    return points + random.normal(size=points.shape) * random.choice([0.0, 0.003, 0.03]), kept


def ngons(random: Random, size: int) -> Shape:
    """Prisms whose caps are polygons of many corners, convex or stars, planar or warped."""
    count = max(3, min(size // 4, 400))
    turn = 2.0 * np.pi * np.arange(count) / count
    radius = np.where(np.arange(count) % 2, random.uniform(0.4, 1.0), 1.0)
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.0 * turn], 1)
    warp = random.choice([0.0, 0.02, 0.3]) * random.normal(size=ring.shape)
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    caps = [list(range(count))[::-1], list(range(count, 2 * count))]
    return np.concatenate([ring, ring + np.array([0.0, 0.0, 1.0]) + warp]), caps + sides


def mirrored(random: Random, size: int) -> Shape:
    """A shape of negative scale, whose faces look inwards or are turned over again."""
    points, faces = random.choice([ball, box, torus, terrain])(random, size)
    return points * [-1.0, 1.0, 1.0], [face[:: random.choice([1, -1])] for face in faces]


def moebius(random: Random, size: int) -> Shape:
    """A surface with one side: somewhere two neighbours look opposite ways."""
    length = max(8, size // 8)
    i, j = np.mgrid[:length, :5].reshape(2, -1)
    turn, across = 2.0 * np.pi * i / length, 0.1 * (j - 2.0)
    ring = 1.0 + across * np.cos(0.5 * turn)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), across * np.sin(0.5 * turn)], 1)
    last = [[(length - 1) * 5 + j, (length - 1) * 5 + j + 1, 3 - j, 4 - j] for j in range(4)]
    return points, grid(length - 1, 4) + last


def twisted(random: Random, size: int) -> Shape:
    """Quads and pentagons whose corners are anywhere: bows, and folds that cannot be laid flat."""
    size = min(size, 500)
    points = random.normal(size=(5 * size, 3)) * [1.0, 1.0, random.choice([0.0, 0.3, 1.0])]
    return points, [list(range(5 * i, 5 * i + random.integers(4, 6))) for i in range(size)]


KINDS: dict[str, Callable[[Random, int], Shape]] = {
    function.__name__: function
    for function in (
        *(box, ball, torus, tube, terrain, noise, soup, slivers, degenerate, coincident, split, bits, huge, small),
        *(uneven, fan, one, monkey, ngons, mirrored, moebius, twisted),
    )
}
