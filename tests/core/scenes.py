"""Small meshes with known obscurances, as the arrays that a bake takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obscurance_addon.core.light.bake import bake_light
from obscurance_addon.core.light.records import BakedLight, LightSources, PatchMaterials
from obscurance_addon.core.light.settings import LightSettings
from obscurance_addon.core.monitor import Monitor
from obscurance_addon.core.obscurance.bake import Obscurances, bake_obscurances
from obscurance_addon.core.scene.patches import Patches, Surfaces
from obscurance_addon.core.scene.solids import Shells, find_shells
from obscurance_addon.core.scene.transmission import Lookup, Transmission, join_transmissions, opacity
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.intersector import BruteForceIntersector

GREY = (0.5, 0.5, 0.5)


@dataclass(frozen=True)
class Mesh:
    """Triangles grouped into faces: each face is one patch, with one reflectance."""

    vertices: np.ndarray  # (v, 3) float64
    triangles: np.ndarray  # (t, 3) int32
    face: np.ndarray  # (t,) int64, ascending
    reflectance: np.ndarray  # (f, 3) float32
    emission: np.ndarray | None = None  # (f, 3) float32 radiant exitance, None for dark ones
    transmission: np.ndarray | None = None  # (f, 3) float32, None for opaque ones
    lookup: Lookup | None = None  # tells transmission place by place; its mean is `transmission`

    @property
    def faces(self) -> int:
        return len(self.reflectance)

    def coloured(self, colour: Sequence[float]) -> Mesh:
        return replace(self, reflectance=np.tile(np.float32(colour), (self.faces, 1)))

    def shining(self, exitance: Sequence[float]) -> Mesh:
        return replace(self, emission=np.tile(np.float32(exitance), (self.faces, 1)))

    def letting_through(self, transmission: float | Sequence[float], lookup: Lookup | None = None) -> Mesh:
        """Transparent, all over alike or as looked up with this mean; what is left of it has the colour that it had."""
        mean = np.tile(np.float32(np.broadcast_to(transmission, 3)), (self.faces, 1))
        return replace(
            self, reflectance=self.reflectance * (1.0 - mean.mean(1, keepdims=True)), transmission=mean, lookup=lookup
        )

    def opacity(self) -> np.ndarray:
        """(f,) mean opacity of each face."""
        return np.ones(self.faces) if self.transmission is None else opacity(self.transmission)

    def passing(self) -> Transmission | None:
        """What passes the triangles."""
        if self.transmission is None:
            return None
        uniform = Transmission.uniform(self.transmission[self.face])
        if self.lookup is None:
            return uniform
        every = np.arange(len(self.triangles), dtype=np.int32)
        return Transmission(uniform.mean, every, self.corners(), every, np.zeros_like(every), (self.lookup,))

    def emitted(self) -> np.ndarray:
        """(f, 3) radiant exitance of each face."""
        return np.zeros((self.faces, 3), np.float32) if self.emission is None else self.emission

    def moved(self, matrix: np.ndarray | float = 1.0, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
        """Vertices times a scalar or 3 x 3 matrix, plus an offset; the order of corners stays."""
        matrix = np.eye(3) * matrix if np.ndim(matrix) == 0 else np.asarray(matrix)
        return replace(self, vertices=self.vertices @ matrix.T + np.asarray(offset))

    def flipped(self) -> Mesh:
        """The same surface seen from the other side."""
        return replace(self, triangles=self.triangles[:, ::-1].copy())

    def corners(self) -> np.ndarray:
        return self.vertices[self.triangles]

    def areas(self) -> np.ndarray:
        """(f,) area of each face."""
        c = self.corners()
        double = np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1)
        return np.bincount(self.face, 0.5 * double, self.faces)

    def centres(self) -> np.ndarray:
        """(f, 3) mean of the triangle centres of each face."""
        count = np.bincount(self.face, minlength=self.faces)[:, None]
        return np.stack([np.bincount(self.face, m, self.faces) for m in self.corners().mean(1).T], -1) / count


def mesh(vertices: object, triangles: object, face: object = None, colour: Sequence[float] = GREY) -> Mesh:
    """A mesh of one colour; without `face`, every triangle is a face."""
    triangles = np.asarray(triangles, np.int32).reshape(-1, 3)
    face = np.arange(len(triangles)) if face is None else np.asarray(face, np.int64)
    count = int(face.max(initial=-1)) + 1
    return Mesh(
        np.asarray(vertices, np.float64).reshape(-1, 3), triangles, face, np.tile(np.float32(colour), (count, 1))
    )


def grid(
    corner: Sequence[float],
    along_u: Sequence[float],
    along_v: Sequence[float],
    nu: int = 1,
    nv: int = 1,
    colour: Sequence[float] = GREY,
) -> Mesh:
    """A parallelogram of nu x nv quads (face = v * nu + u) whose normal is along_u x along_v."""
    corner, along_u, along_v = (np.asarray(a, np.float64) for a in (corner, along_u, along_v))
    u, v = np.meshgrid(np.arange(nu + 1) / nu, np.arange(nv + 1) / nv)
    vertices = corner + u.reshape(-1, 1) * along_u + v.reshape(-1, 1) * along_v
    first = (np.arange(nv)[:, None] * (nu + 1) + np.arange(nu)).ravel()
    a, b, c, d = first, first + 1, first + nu + 2, first + nu + 1
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 1)
    return mesh(vertices, triangles, np.repeat(np.arange(nu * nv), 2), colour)


def floor(low: Sequence[float], high: Sequence[float], nu: int = 1, nv: int = 1, z: float = 0.0, **kw: object) -> Mesh:
    """A horizontal rectangle that looks up."""
    size_x, size_y = high[0] - low[0], high[1] - low[1]
    return grid((low[0], low[1], z), (size_x, 0, 0), (0, size_y, 0), nu, nv, **kw)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several; vertices stay apart."""
    vertex = np.cumsum([0] + [len(m.vertices) for m in meshes])
    face = np.cumsum([0] + [m.faces for m in meshes])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.triangles + np.int32(v) for m, v in zip(meshes, vertex, strict=False)]),
        np.concatenate([m.face + f for m, f in zip(meshes, face, strict=False)]),
        np.concatenate([m.reflectance for m in meshes]),
        np.concatenate([m.emitted() for m in meshes]),
    )


def shells_of(m: Mesh) -> Shells:
    """What it bounds, but for what light passes."""
    shells, passing = find_shells(m.vertices, m.triangles)[0], m.passing()
    return shells if passing is None else shells.without_windows(passing.mean.any(1))


def welded(m: Mesh) -> Mesh:
    """The mesh with equal vertices merged."""
    vertices, index = np.unique(m.vertices, axis=0, return_inverse=True)
    return replace(m, vertices=vertices, triangles=index.reshape(-1)[m.triangles].astype(np.int32))


def box(low: Sequence[float], high: Sequence[float], n: int = 1, colour: Sequence[float] = GREY) -> Mesh:
    """A closed box seen from outside; sides in the order -x, +x, -y, +y, -z, +z, each of n x n quads."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    sides = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = (high - low)[(axis + 1) % 3], (high - low)[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        sides += [grid(low, v, u, n, n), grid(top, u, v, n, n)]
    return welded(join(sides)).coloured(colour)


def room(low: Sequence[float], high: Sequence[float], n: int = 1, colour: Sequence[float] = GREY) -> Mesh:
    """A closed box seen from inside."""
    return box(low, high, n, colour).flipped()


def icosphere(level: int, radius: float = 1.0) -> Mesh:
    """An icosahedron whose triangles are split in four `level` times, on the sphere, seen from outside."""
    phi = (1.0 + 5.0**0.5) / 2.0
    vertices = np.array(
        [(s, t * phi, 0) for s in (-1, 1) for t in (-1, 1)]
        + [(0, s, t * phi) for s in (-1, 1) for t in (-1, 1)]
        + [(t * phi, 0, s) for s in (-1, 1) for t in (-1, 1)],
        np.float64,
    )
    gap = np.linalg.norm(vertices[:, None] - vertices, axis=-1)
    near = np.isclose(gap, 2.0)
    triangles = np.array(
        [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    )
    c = vertices[triangles]
    inwards = np.einsum("ij,ij->i", np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), c[:, 0]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    corners = vertices[triangles]
    for _ in range(level):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    corners *= radius / np.linalg.norm(corners, axis=-1, keepdims=True)
    points, index = np.unique(np.round(corners.reshape(-1, 3) / radius, 12), axis=0, return_inverse=True)
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return mesh(points, index.reshape(-1, 3))


@dataclass(frozen=True)
class Scene:
    """What a bake takes; the patches are those of the first meshes, in order."""

    surfaces: Surfaces
    patches: Patches
    patch_reflectance: np.ndarray
    area: np.ndarray
    others: Patches
    materials: PatchMaterials

    def bake_all(self, settings: BakeSettings | None = None, **kw: object) -> Obscurances:
        """`bake` with the reflectance and opacity of the patches, so that hidden ones are left out of R_ave."""
        n = len(self.patches)
        return self.bake(
            settings,
            patch_reflectance=self.materials.reflectance[:n],
            patch_opacity=self.materials.opacity_of(slice(n)),
            **kw,
        )

    def bake(self, settings: BakeSettings | None = None, *, brute: bool = False, **kw: object) -> Obscurances:
        """Bake with Embree, or with the brute force reference."""
        if brute:
            kw["intersector"] = brute_force
        return bake_obscurances(self.surfaces, self.patches, settings or BakeSettings(), **kw)

    def bake_light(
        self,
        quantity: str,
        lamps: Sequence[object] = (),
        settings: BakeSettings | None = None,
        *,
        world: Sequence[float] = (0.0, 0.0, 0.0),
        brute: bool = False,
        monitor: Monitor | None = None,
        **light: object,
    ) -> BakedLight:
        """Bake light with Embree, or with the brute force reference."""
        return bake_light(
            self.surfaces,
            self.patches,
            self.others,
            self.materials,
            LightSources(tuple(lamps), np.asarray(world, float)),
            settings or BakeSettings(),
            LightSettings(quantity, **light),
            monitor=monitor,
            **({"intersector": brute_force} if brute else {}),
        )


def brute_force(vertices: np.ndarray, triangles: np.ndarray, _progress: object) -> BruteForceIntersector:
    return BruteForceIntersector(vertices, triangles)


def scene(baked: Sequence[Mesh], others: Sequence[Mesh] = (), ids: np.ndarray | None = None) -> Scene:
    """Every mesh is one object: those to bake, and those that are only in the way."""
    patches = join(baked)
    everything = [*baked, *others]
    all_of_it = join(everything)
    starts = np.cumsum([0] + [len(m.triangles) for m in everything[:-1]])
    surfaces = Surfaces(
        all_of_it.vertices,
        all_of_it.triangles,
        all_of_it.reflectance[all_of_it.face],
        Shells.joined([shells_of(m) for m in everything]),
        starts,
        all_of_it.emitted()[all_of_it.face],
        all_of_it.face.astype(np.int32),
        transmission=join_transmissions([(len(m.triangles), m.passing()) for m in everything]),
    )
    ids = np.arange(patches.faces, dtype=np.uint32) if ids is None else ids
    shell = np.zeros(all_of_it.faces, np.int32)
    shell[all_of_it.face] = surfaces.shells.shell
    with np.errstate(invalid="ignore", over="ignore"):
        around = join(others) if others else None
        return Scene(
            surfaces,
            Patches(patches.corners(), patches.face, ids, shell[: patches.faces]),
            patches.reflectance,
            patches.areas(),
            Patches.none()
            if around is None
            else Patches(
                around.corners(),
                around.face,
                np.arange(1 << 20, (1 << 20) + around.faces, dtype=np.uint32),
                shell[patches.faces :],
            ),
            PatchMaterials(
                all_of_it.reflectance.astype(float),
                all_of_it.emitted().astype(float),
                opacity=None if surfaces.transmission is None else np.concatenate([m.opacity() for m in everything]),
            ),
        )


def rotation(seed: int) -> np.ndarray:
    """A random rotation matrix."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q
