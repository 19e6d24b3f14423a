"""The same settings cast the same rays: bit for bit, however the work is split."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings, Sampler
from tests.core.scenes import box, floor, grid, mesh, scene


def mixed(ids=None):
    """Quads, a heptagon, a crate that covers part of the floor, and a sheet."""
    turns = np.linspace(0, 2 * np.pi, 8)[:-1]
    heptagon = mesh(
        np.stack([1.5 + 0.3 * np.cos(turns), 0.5 + 0.3 * np.sin(turns), 0 * turns], -1),
        [(0, i, i + 1) for i in range(1, 6)],
        [0] * 5,
    )
    meshes = [
        floor((0, 0), (1, 1), 7, 7, colour=(0.9, 0.5, 0.1)),
        heptagon,
        box((0.31, 0.22, 0.0), (0.63, 0.57, 0.4), 2, (0.1, 0.2, 0.9)),
        grid((0, 0, 0), (0, 1, 0), (0, 0, 1), 2, 2),
    ]
    return scene(meshes, ids=ids)


def bits(baked) -> bytes:
    arrays = (baked.coloured, baked.grey, baked.valid, baked.r_ave, baked.rmse, baked.sums.hit, baked.sums.miss)
    return b"".join(a.tobytes() for a in arrays) + np.float64(baked.grey_rmse).tobytes()


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP, Falloff.EXPONENTIAL])
@pytest.mark.parametrize("sampler", list(Sampler))
@pytest.mark.parametrize("use_bleeding", [True, False])
def test_threads_and_blocks_change_no_bit(falloff, sampler, use_bleeding):
    settings = BakeSettings(48, distance=0.6, falloff=falloff, sampler=sampler, use_bleeding=use_bleeding, threads=1)
    reference = bits(mixed().bake(settings))
    for threads in (1, 2, 5):
        for block_rays in (1, 100, 777, 16384, 1 << 20):
            again = mixed().bake(replace(settings, threads=threads), block_rays=block_rays)
            assert bits(again) == reference, (threads, block_rays)


def test_budgets_and_passes_change_no_bit_either():
    settings = BakeSettings(ray_budget=200_000, distance=0.6, threads=1)
    reference = bits(mixed().bake(settings))
    assert bits(mixed().bake(replace(settings, threads=2), block_rays=500)) == reference


@pytest.mark.parametrize("sampler", list(Sampler))
def test_seeds_differ(sampler):
    one, two = (mixed().bake(BakeSettings(sampler=sampler, seed=seed)).grey for seed in (0, 1))
    assert np.count_nonzero(one != two) > 0.8 * np.count_nonzero((one < 1.0) | (two < 1.0))


@pytest.mark.parametrize("sampler", list(Sampler))
def test_a_patch_keeps_its_rays_in_other_company(sampler):
    """Patches in another order, with others left out, keep their values as long as they keep their ids."""
    ground = floor((0, 0), (1, 1), 6, 6)
    walls = [grid((0, 0, 0), (0, 1, 0), (0, 0, 1)), grid((0, 0, 0.5), (1, 0, 0), (0, 1, 0))]
    settings = BakeSettings(sampler=sampler, distance=0.7)
    everything = scene([ground], walls).bake(settings)
    corners = ground.corners().reshape(36, 2, 3, 3)
    # The four corner patches stay in, so that the coordinates are normalised alike.
    chosen = np.array([35, 0, 17, 30, 5, 8])
    part = scene([ground], walls)
    patches = type(part.patches)(corners[chosen].reshape(-1, 3, 3), np.repeat(np.arange(6), 2), np.uint32(chosen))
    again = replace(part, patches=patches).bake(settings)
    np.testing.assert_array_equal(again.grey, everything.grey[chosen])


def test_patches_with_different_ids_have_different_errors():
    """Equal surroundings, different ids: the errors are spread, not the same everywhere."""
    ground = floor((0, 0), (1, 8), 1, 64)
    wall = grid((0, -1.1, 0), (0, 10.2, 0), (0, 0, 1.1))
    spread = scene([ground], [wall]).bake(BakeSettings(distance=1.0)).grey
    assert len(np.unique(spread)) > 48
    same = scene([ground], [wall], ids=np.zeros(64, np.uint32)).bake(BakeSettings(distance=1.0)).grey
    assert np.ptp(same) < 1e-5 < np.ptp(spread)
