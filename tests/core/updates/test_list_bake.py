"""The 2003 list of influenced patches: right for the patches on it, and it misses others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.updates.incremental import IncrementalBake
from obscurance_addon.core.updates.list_bake import ListBake
from tests.core.scenes import box, floor
from tests.core.updates.changing_scenes import furniture, objects_of, scene_object, turned

SETTINGS = BakeSettings(64, distance=0.25, threads=2, use_bleeding=False)


def both(settings, movers, meshes):
    objects = objects_of(meshes)
    return [kind(objects, settings, movers=movers) for kind in (IncrementalBake, ListBake)]


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize("movers", [("other",), ("other", "ball", "sheet")])
def test_listed_patches_have_their_exact_values(movers, falloff):
    """Every value is the exact one, or else the one from before: then the patch was missed."""
    meshes, rng, missed = furniture(), np.random.default_rng(0), 0
    for _ in range(6):
        exact, listed = both(replace(SETTINGS, falloff=falloff), movers, meshes)
        before = {key: listed.values(key).grey for key in meshes}
        for key in movers[: 1 + rng.integers(len(movers))]:
            meshes[key] = turned(meshes[key], rng, 0.05)
            change = {key: scene_object(meshes[key], 1000 * list(meshes).index(key))}
            assert listed.update(change).patches <= exact.update(change).patches
        for key in meshes:
            right = listed.values(key).grey == exact.values(key).grey
            if len(movers) == 1:
                assert (right | (listed.values(key).grey == before[key])).all()
            missed += np.count_nonzero(~right)
    assert 0 < missed < 100


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_many_rays_miss_nothing(falloff):
    """A few large patches with 4,096 rays each: all that see the mover are on its list, also on its way back."""
    meshes = {key: furniture()[key] for key in ("sheet", "octagon", "crate", "other")}
    exact, listed = both(replace(SETTINGS, rays=4096, falloff=falloff), {"other"}, meshes)
    rng = np.random.default_rng(1)
    for step in range(8):
        mesh = meshes["other"] if step == 7 else turned(meshes["other"], rng, 0.1)
        change = {"other": scene_object(mesh, 3000)}
        exact.update(change)
        listed.update(change)
        for key in meshes:
            np.testing.assert_array_equal(listed.values(key).grey, exact.values(key).grey)


def test_patches_leave_the_list():
    """A mover that went away influences nothing: the next move bakes its own patches alone."""
    meshes = furniture()
    listed = both(SETTINGS, {"ball"}, meshes)[1]
    own = meshes["ball"].faces
    for x, patches in ((40.0, None), (41.0, own), (42.0, own)):
        listed.update({"ball": scene_object(meshes["ball"].moved(offset=(x, 0, 0)), 6000)})
        assert patches is None or listed.last.patches == patches


def test_colours_and_disappearance():
    """What bled on the list takes the new colour; what vanishes leaves its list behind."""
    settings = replace(SETTINGS, use_bleeding=True)
    meshes = furniture()
    exact, listed = both(settings, {"ball"}, meshes)
    bright = scene_object(meshes["ball"].coloured((0.1, 0.9, 0.1)), 6000)
    for change in ({"ball": bright}, {"ball": None}, {"ball": bright}):
        exact.update(change)
        listed.update(change)
        np.testing.assert_array_equal(listed.r_ave, exact.r_ave)
        assert listed.last.patches > 0 or change["ball"] is None


def test_lists_do_not_depend_on_what_is_kept():
    """Patches that see the mover by rays of their own stay listed, also where what else they meet is known from before.

    The mover has few rays, so that it meets few of the small patches that see it.
    """
    meshes = {"floor": floor((0, 0), (1, 1), 24, 24), "box": box((0.4, 0.4, 0.1), (0.6, 0.6, 0.2), 1)}
    keeping, tracing = (
        ListBake(objects_of(meshes), replace(SETTINGS, rays=16), movers={"box"}, ceiling_bytes=size)
        for size in (1 << 24, 0)
    )
    updates = []
    for x in (0.01, 0.02, 0.03, 0.02, 0.01):
        change = {"box": scene_object(meshes["box"].moved(offset=(x, 0, 0)), 1000)}
        updates.append([bake.update(change) for bake in (keeping, tracing)])
        np.testing.assert_array_equal(keeping.values("floor").grey, tracing.values("floor").grey)
    assert all(one.patches == other.patches for one, other in updates)
    assert updates[-1][0].cached > 0
