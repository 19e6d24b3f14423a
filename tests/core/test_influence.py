"""After any change, an incremental bake has the values of a full bake, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.influence import IncrementalBake
from obscurance_addon.core.settings import BakeSettings

from .changing_scenes import assert_equals_full_bake, furniture, objects_of, scene_object, turned

SETTINGS = BakeSettings(16, distance=0.2, threads=2)


def start(settings=SETTINGS, movers=("other", "ball"), **kw):
    meshes = furniture()
    bake = IncrementalBake(objects_of(meshes), settings, movers=frozenset(movers), **kw)
    assert_equals_full_bake(bake, settings)
    return meshes, bake


def wander(meshes, bake, settings, keys, steps, rng, size=0.12):
    """Move one or all of some objects at random, and compare after each step."""
    ids = {key: 1000 * i for i, key in enumerate(meshes)}
    for step in range(steps):
        moving = keys if step % 3 == 2 else [keys[step % len(keys)]]
        for key in moving:
            meshes[key] = turned(meshes[key], rng, size, 2.0 ** rng.uniform(-0.2, 0.2))
        bake.update({key: scene_object(meshes[key], ids[key]) for key in moving})
        assert bake.last.reason is None
        assert_equals_full_bake(bake, settings)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize("use_bleeding", [True, False])
def test_movers_of_all_kinds(falloff, use_bleeding, seed):
    settings = replace(SETTINGS, falloff=falloff, use_bleeding=use_bleeding)
    movers = (["other", "ball"], ["decal", "sheet"], ["octagon", "crate", "ball"])[seed]
    meshes, bake = start(settings, movers)
    wander(meshes, bake, settings, movers, 6, np.random.default_rng(seed))
