"""Scenes of objects that change, and the comparison of an incremental bake with a full one."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

import numpy as np

from obscurance_addon.core.obscurance.bake import Obscurances, bake_obscurances
from obscurance_addon.core.scene.objects import SceneObject, join_objects
from obscurance_addon.core.scene.patches import Patches, Surfaces
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import Held
from obscurance_addon.core.updates.incremental import IncrementalBake
from tests.core.scenes import Mesh, box, floor, grid, icosphere, mesh, room, rotation, shells_of

RED, BLUE, GREEN = (0.8, 0.1, 0.1), (0.1, 0.2, 0.9), (0.1, 0.8, 0.2)


def scene_object(m: Mesh, first_id: int = 0, *, baked: bool = True) -> SceneObject:
    """A mesh as one object; faces that share a vertex are neighbours."""
    shells, reflectance = shells_of(m), m.reflectance[m.face]
    patch = m.face.astype(np.int32) if baked else None
    surfaces = Surfaces(m.vertices, m.triangles, reflectance, shells, patch=patch, transmission=m.passing())
    if not baked:
        return SceneObject(surfaces, Patches.none(), np.zeros((0, 3)))
    ids = np.arange(first_id, first_id + m.faces, dtype=np.uint32)
    shell = np.zeros(m.faces, np.int32)
    shell[m.face] = shells.shell
    pairs = np.unique(np.stack([np.repeat(m.face, 3), m.triangles.ravel()]), axis=1)
    opacity = None if m.transmission is None else m.opacity()
    patches = Patches(m.corners(), m.face, ids, shell)
    return SceneObject(surfaces, patches, m.reflectance.astype(float), tuple(pairs), opacity)


def furniture() -> dict[Hashable, Mesh]:
    """A room, a crate through its floor, one that interpenetrates it, a decal, a sheet, an octagon and a ball."""
    turns = np.linspace(0, 2 * np.pi, 9)[:-1]
    octagon = np.stack([0.75 + 0.11 * np.cos(turns), 0.23 + 0.1 * np.sin(turns), 0.31 + 0.02 * np.cos(2 * turns)], -1)
    return {
        "room": room((0, 0, 0), (1, 1, 0.8), 4, (0.3, 0.5, 0.7)),
        "crate": box((0.23, 0.17, -0.05), (0.51, 0.43, 0.31), 2, RED),
        "other": box((0.45, 0.33, 0.11), (0.83, 0.71, 0.47), 2, BLUE),
        "decal": floor((0.05, 0.55), (0.35, 0.95), 2, 2, z=1.5e-5, colour=(0.9, 0.9, 0.1)),
        "sheet": grid((0.61, 0.12, 0.52), (0.25, 0, 0.125), (0, 0.25, 0), 2, 2, colour=GREEN),
        "octagon": mesh(octagon, [(0, i, i + 1) for i in range(1, 7)], [0] * 6, (0.7, 0.3, 0.6)),
        "ball": icosphere(1).moved(0.1, (0.22, 0.77, 0.26)).coloured((0.9, 0.6, 0.2)),
    }


def objects_of(meshes: Mapping[Hashable, Mesh], unbaked: Sequence[Hashable] = ()) -> dict[Hashable, SceneObject]:
    """Objects whose patches have ids of their own."""
    return {key: scene_object(m, 1000 * i, baked=key not in unbaked) for i, (key, m) in enumerate(meshes.items())}


def turned(m: Mesh, rng: np.random.Generator, step: float, scale: float = 1.0) -> Mesh:
    """The mesh turned at random about its middle, scaled, and moved by up to `step` along each axis."""
    middle = m.vertices.mean(0)
    centred = m.moved(offset=-middle)
    return centred.moved(scale * rotation(int(rng.integers(1 << 30))), middle + rng.uniform(-step, step, 3))


def full_bake(objects: Mapping[Hashable, SceneObject], settings: BakeSettings, held: Held, **kw: object) -> Obscurances:
    joined = join_objects(objects.values())
    return bake_obscurances(
        joined.surfaces,
        joined.patches,
        settings,
        neighbours=joined.neighbours,
        patch_reflectance=joined.patch_reflectance,
        patch_opacity=joined.patch_opacity,
        held=held,
        **kw,
    )


def assert_equals_full_bake(bake: IncrementalBake, settings: BakeSettings, **kw: object) -> None:
    """All values, bit for bit."""
    objects = bake.objects
    full = full_bake(objects, settings, bake.held, **kw)
    np.testing.assert_array_equal(bake.r_ave, full.r_ave)
    np.testing.assert_array_equal(bake.scattering, full.scattering)
    white = full.white
    first = 0
    for key, source in objects.items():
        own = slice(first, first + len(source.patches))
        first = own.stop
        values = bake.values(key)
        np.testing.assert_array_equal(values.valid, full.valid[own], err_msg=str(key))
        np.testing.assert_array_equal(values.grey, full.grey[own], err_msg=str(key))
        np.testing.assert_array_equal(values.coloured, full.coloured[own], err_msg=str(key))
        np.testing.assert_array_equal(values.white, white[own], err_msg=str(key))
