"""Values that are constant or vary over a face: images, colour attributes, functions of them. numpy only, no bpy.

Expressions are immutable and may be evaluated in any thread.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .arithmetic import tame
from .points import TrianglePoints
from .surfaces import SurfaceArrays
from .textures import Texture

# Parts along a triangle's edge: up to 64 (4096 points) for faces with many texels.
MAX_PARTS = 64
PARTS_PER_TEXEL = 4.0
ATTRIBUTE_PARTS = 4
# Texture coordinates and factors beyond these mean nothing; within them, products and squares are finite in float32.
_FAR_UV, _FAR_FACTOR = 2.0**40, 2.0**60


class Expression(ABC):
    """A colour (last axis 3) or grey (last axis 1) value, constant or varying over a face."""

    def operands(self) -> tuple[Expression, ...]:
        """Expressions that this one is made of."""
        return ()

    def parts(self, surface: SurfaceArrays, triangles: np.ndarray) -> np.ndarray | int:
        """How many parts along their edges the triangles need, (t,) int or one for all; 0: constant."""
        return 0

    @abstractmethod
    def compute(self, points: TrianglePoints | None) -> np.ndarray:
        """Values that broadcast to (t, n * n, 3) float32; `points` is None for constants."""

    def at(self, points: TrianglePoints | None) -> np.ndarray:
        """As `compute`, once per expression and set of points."""
        if points is None:
            return self.compute(None)
        if id(self) not in points.values:
            points.values[id(self)] = self.compute(points)
        return points.values[id(self)]


@dataclass(frozen=True)
class Constant(Expression):
    """One value (grey) or three (colour), everywhere the same."""

    values: tuple[float, ...]

    def compute(self, points: TrianglePoints | None) -> np.ndarray:
        return np.array(self.values, np.float32).reshape(1, 1, -1)


BLACK = Constant((0.0,))


@dataclass(frozen=True, eq=False)
class Applied(Expression):
    """A function of arrays applied to expressions."""

    function: Callable[..., np.ndarray]
    inputs: tuple[Expression, ...]

    def operands(self) -> tuple[Expression, ...]:
        return self.inputs

    def compute(self, points: TrianglePoints | None) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self.function(*(value.at(points) for value in self.inputs))


def apply(function: Callable[..., np.ndarray], *inputs: Expression) -> Expression:
    """The function of the inputs, worked out at once if they are constant."""
    applied = Applied(function, inputs)
    if all(isinstance(value, Constant) for value in inputs):
        return Constant(tuple(applied.compute(None).ravel().tolist()))
    return applied


@dataclass(frozen=True, eq=False)
class UVProjection:
    """An affine picture of a UV map: uv @ matrix[:, :2].T + matrix[:, 2]. An empty name is the active map."""

    name: str
    matrix: np.ndarray

    def corners(self, surface: SurfaceArrays, triangles: np.ndarray) -> np.ndarray | None:
        """(t, 3, 2) float32 texture coordinates at the corners of triangles, None if the mesh lacks the map."""
        uv = surface.uv.get(self.name or surface.active_uv)
        if uv is None:
            return None
        matrix = tame(self.matrix, _FAR_FACTOR)
        return tame(uv[surface.triangle_corners[triangles]] @ matrix[:, :2].T + matrix[:, 2], _FAR_UV)


@dataclass(frozen=True, eq=False)
class ImageSample(Expression):
    """Colour or alpha of an image over the face, or of the whole image where it has no usable coordinates.

    Looked up in the copy of the image whose texels are just smaller than the part of the triangle: a face that covers
    a million texels costs no more than 4096 lookups and still weighs all of them.
    """

    texture: Texture
    projection: UVProjection | None
    extension: str
    closest: bool
    alpha: bool

    def parts(self, surface: SurfaceArrays, triangles: np.ndarray) -> np.ndarray | int:
        if self.projection is None:
            return 0
        uv = self.projection.corners(surface, triangles)
        if uv is None:
            return 1
        edges = (uv - np.roll(uv, 1, axis=1)) * np.array([self.texture.width, self.texture.height], np.float32)
        longest = np.sqrt(np.square(edges).sum(axis=2).max(axis=1))
        # Bilinear colour bends at every texel: faces of a few texels need several parts to each of them.
        return np.exp2(np.ceil(np.log2(np.clip(PARTS_PER_TEXEL * longest, 2.0, MAX_PARTS)))).astype(np.int64)

    def compute(self, points: TrianglePoints | None) -> np.ndarray:
        pyramid = self.texture.pyramid
        channels = slice(3, 4) if self.alpha else slice(0, 3)
        uv = None
        if points is not None and self.projection is not None:
            uv = self.projection.corners(points.surface, points.triangles)
        if uv is None:
            return pyramid.mean[channels].reshape(1, 1, -1)
        # Texels per part; a level's texels are four times those of the level before, and no larger than the part.
        sides = (uv[:, 1:] - uv[:, :1]).astype(np.float64)
        area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        texels = area * pyramid.width[0] * pyramid.height[0] / points.parts**2
        level = np.floor(0.5 * np.log2(np.clip(texels, 1.0, 4.0 ** (len(pyramid.start) - 1)))).astype(np.int64)
        return pyramid.lookup(points.on_corners(uv), level[:, None], self.extension, self.closest)[..., channels]


@dataclass(frozen=True)
class AttributeSample(Expression):
    """A colour attribute over the face; black, as in Cycles, if the mesh lacks it. An empty name is the active one."""

    name: str

    def parts(self, surface: SurfaceArrays, triangles: np.ndarray) -> np.ndarray | int:
        domain, _ = surface.color.get(self.name or surface.active_color, ("FACE", None))
        return 1 if domain == "FACE" else ATTRIBUTE_PARTS

    def compute(self, points: TrianglePoints | None) -> np.ndarray:
        surface = points.surface
        domain, color = surface.color.get(self.name or surface.active_color, ("", None))
        if color is None:
            return np.zeros((1, 1, 3), np.float32)
        if domain == "FACE":
            return color[surface.triangle_face[points.triangles]][:, None]
        corners = surface.triangle_corners[points.triangles]
        return points.on_corners(color[corners if domain == "CORNER" else surface.corner_vertex[corners]])


def walk(*expressions: Expression) -> Iterator[Expression]:
    """Every expression that these are made of, each once."""
    seen: set[int] = set()
    waiting = list(expressions)
    while waiting:
        expression = waiting.pop()
        if id(expression) not in seen:
            seen.add(id(expression))
            waiting.extend(expression.operands())
            yield expression
