"""The error figure that a bake reports, against the true error beside a wall."""

import itertools

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.obscurance import bake as bake_module
from obscurance_addon.core.settings import BakeSettings, Sampler
from tests.core import closed_forms as exact
from tests.core.scenes import floor, grid, mesh, scene

STRIPS, ROWS = 4, 128
WALL = grid((0, -1.01, 0), (0, 18.02, 0), (0, 0, 1.01), colour=(0.8, 0.2, 0.0))
SCENE = scene([floor((0, 0), (0.8, 16), STRIPS, ROWS, colour=(0.1, 0.5, 0.0))], [WALL])


def exact_values(falloff: Falloff, r_ave: np.ndarray) -> np.ndarray:
    """(p, 4): coloured and grey."""
    edges = 0.2 * np.arange(STRIPS + 1)
    w, m = (
        np.array([exact.strip(f, a, b) for a, b in itertools.pairwise(edges)])[:, None] for f in (falloff, Falloff.STEP)
    )
    coloured = np.array([0.8, 0.2, 0.0]) * (w - m) + r_ave * m
    return np.tile(np.hstack([coloured, w]), (ROWS, 1))


@pytest.mark.parametrize("sampler", list(Sampler))
@pytest.mark.parametrize("rays", [64, 256])
@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_reported_error_is_the_true_error(sampler, rays, falloff):
    """Within 25 %: 512 patches with some 220 distinct point sets know either RMSE to 5 %."""
    baked = SCENE.bake(BakeSettings(rays, distance=1.0, falloff=falloff, sampler=sampler))
    values = np.column_stack([baked.coloured, baked.grey])
    true = np.sqrt(np.mean((values - exact_values(falloff, baked.r_ave)) ** 2, axis=0))
    reported = np.append(baked.rmse, baked.grey_rmse)
    assert true[[0, 1, 3]].min() > 1e-5
    np.testing.assert_allclose(reported[[0, 1, 3]], true[[0, 1, 3]], rtol=0.25)
    assert reported[2] == true[2] == 0.0  # no blue anywhere


def test_a_sample_of_a_large_scene_reports_the_same(monkeypatch):
    """With 128 patches baked twice instead of 512, the figure stays within 35 %, and the values do not move."""
    settings = BakeSettings(64, distance=1.0)
    whole = SCENE.bake(settings)
    monkeypatch.setattr(bake_module, "ERROR_SAMPLE_MIN", 128)
    part = SCENE.bake(settings)
    assert part.error_rays == 128 * 64
    assert whole.error_rays == 512 * 64
    np.testing.assert_array_equal(part.coloured, whole.coloured)
    assert part.grey_rmse == pytest.approx(whole.grey_rmse, rel=0.35)  # 128 pairs know it to 7 %, times five


def test_no_noise_no_error():
    baked = scene([floor((0, 0), (1, 1), 4, 4)]).bake()
    assert baked.grey_rmse == 0.0
    np.testing.assert_array_equal(baked.rmse, 0.0)


def test_error_is_defined_without_valid_patches():
    needle = [[0, 0, 0], [1, 0, 0], [0.5, 1e-12, 0]]
    baked = scene([mesh(needle, [(0, 1, 2)])]).bake()
    assert baked.grey_rmse == 0.0
