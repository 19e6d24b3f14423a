"""Small scenes such as people bake, in linear colours: what is around them is larger, darker or more colourful."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.core.scenes import Mesh, Scene, box, floor, grid, icosphere, room, scene

WOOD, STONE, WHITE, BLACK = (0.4, 0.3, 0.2), (0.35, 0.33, 0.3), (0.8, 0.8, 0.8), (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Everyday:
    """A scene, all of it baked.

    `reach` is a distance for its things, in metres, and `open_mesh` one of the meshes with faces that nothing is near.
    """

    name: str
    meshes: tuple[Mesh, ...]
    reach: float
    open_mesh: int = 0

    def scene(self) -> Scene:
        """The arrays that a bake takes."""
        return scene(self.meshes)

    def faces_of(self, mesh: int) -> slice:
        """Its faces among all patches."""
        first = sum(m.faces for m in self.meshes[:mesh])
        return slice(first, first + self.meshes[mesh].faces)


def _table(ground: float = 0.0) -> tuple[Mesh, ...]:
    """A floor of 4 m with a block that hovers a little above it, and a wall beside both."""
    return (
        floor((-2, -2), (2, 2), 10, 10, z=ground + 0.01, colour=WOOD),
        box((-0.5, -0.5, ground + 0.1), (0.5, 0.5, ground + 1.1), 3, WOOD),
        box((-2, 1.5, ground + 0.02), (2, 1.7, ground + 2), 3, WHITE),
    )


def _ground(half: float, colour: tuple[float, float, float], n: int = 20, z: float = 0.0) -> Mesh:
    return floor((-half, -half), (half, half), n, n, z=z, colour=colour)


def emissive_dome() -> Everyday:
    """Daylight from a shining sphere of 30 m, which scatters nothing."""
    dome = icosphere(2, 30.0).flipped().coloured(BLACK).shining((3, 3, 3))
    return Everyday("emissive dome", (*_table(), dome), 1.0)


def metal_hall() -> Everyday:
    """Wooden things in a hall of 60 m without any diffuse reflectance."""
    return Everyday("metal hall", (*_table(), room((-30, -30, -1), (30, 30, 29), 6, BLACK)), 1.0)


def red_ground() -> Everyday:
    """A saturated ground, which reflects nothing in two channels."""
    return Everyday("red ground", (_ground(20, (0.8, 0.0, 0.0)), *_table(0.05)), 1.0)


def lawn() -> Everyday:
    """A white house on a green lawn."""
    house = (
        box((-3, -3, 0.01), (3, 3, 3), 6, WHITE),
        box((3, -1, 0.01), (5, 1, 2.2), 4, WHITE),
        box((-3.5, -3.5, 3.05), (3.5, 3.5, 3.2), 4, (0.3, 0.08, 0.05)),
    )
    return Everyday("lawn", (_ground(20, (0.05, 0.3, 0.03)), *house), 2.0)


def snow() -> Everyday:
    """A black car on snow."""
    car = (box((-2, -0.9, 0.3), (2, 0.9, 0.9), 4, (0.02,) * 3), box((-1, -0.8, 0.95), (1, 0.8, 1.5), 4, (0.02,) * 3))
    wheels = tuple(
        box((x - 0.3, y - 0.1, 0.01), (x + 0.3, y + 0.1, 0.6), 2, (0.01,) * 3) for x in (-1.3, 1.3) for y in (-1, 1)
    )
    return Everyday("snow", (_ground(15, (0.85, 0.87, 0.9)), *car, *wheels), 1.0)


def forest() -> Everyday:
    """Dark trunks and crowns on dark soil, and one birch."""
    rng = np.random.default_rng(1)
    trees = []
    for k, (x, y) in enumerate(rng.uniform(-12, 12, (24, 2))):
        trees.append(
            box((x - 0.2, y - 0.2, -0.1), (x + 0.2, y + 0.2, 4), 2, (0.6,) * 3 if k == 0 else (0.1, 0.06, 0.04))
        )
        trees.append(icosphere(1, 1.8).moved(offset=(x, y, 5)).coloured((0.03, 0.12, 0.02)))
    return Everyday("forest", (_ground(25, (0.08, 0.05, 0.03)), *trees), 2.0)


def night_street() -> Everyday:
    """Houses along a dark street, with lamps that shine and scatter nothing, and a white van."""
    houses = tuple(
        box((x, y, 0.01), (x + 8, y + 6, 7), 4, (0.3, 0.2, 0.15)) for x in (-20, -8, 4, 16) for y in (-11, 5)
    )
    lamps = tuple(
        icosphere(1, 0.3).moved(offset=(x, y, 4)).coloured(BLACK).shining((50, 40, 20))
        for x in (-15, 0, 15)
        for y in (-4.5, 4.5)
    )
    van = box((-2, -3, 0.3), (2.5, -1, 2.4), 4, WHITE)
    return Everyday("night street", (_ground(60, (0.05, 0.05, 0.06), 30), *houses, *lamps, van), 2.0)


def studio() -> Everyday:
    """A red product in front of a white backdrop."""
    back = grid((-5, 4, 0), (10, 0, 0), (0, 0, 6), 10, 6, (0.9,) * 3)
    product = (
        icosphere(2, 0.5).moved(offset=(0, 0, 0.55)).coloured((0.7, 0.03, 0.03)),
        box((0.6, -0.3, 0.01), (1, 0.1, 0.4), 2, STONE),
    )
    return Everyday("studio", (_ground(8, (0.9,) * 3, 16), back, *product), 1.0)


EVERYDAY = (emissive_dome, metal_hall, red_ground, lawn, snow, forest, night_street, studio)
