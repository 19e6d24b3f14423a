"""How fast the error falls with the number of rays, beside a wall, where the exact patch values are known."""

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings, Sampler
from obscurance_addon.core.tracing import samples
from tests.core import closed_forms as exact
from tests.core.scenes import floor, grid, scene

SEEDS = 8
STRIPS, ROWS = 4, 32
# Beside a wall, with a d_max of 1: strips from contact to beyond its reach.
SCENE = scene([floor((0, 0), (0.8, 4), STRIPS, ROWS)], [grid((0, -1.01, 0), (0, 6.02, 0), (0, 0, 1.01))])


def rmse(rays: int, falloff: Falloff, sampler: Sampler, seeds: int = SEEDS) -> float:
    """Root mean square error over all patches and seeds; 1,024 errors fix it to about 4 % (256 distinct sets)."""
    strips = [exact.strip(falloff, 0.2 * i, 0.2 * (i + 1)) for i in range(STRIPS)]
    errors = [
        SCENE.bake(BakeSettings(rays, distance=1.0, falloff=falloff, sampler=sampler, seed=seed)).grey.reshape(
            ROWS, STRIPS
        )
        - strips
        for seed in range(seeds)
    ]
    return float(np.sqrt(np.mean(np.square(errors))))


def slope(values: list[float], rays: list[int]) -> float:
    return float(np.polyfit(np.log(rays), np.log(values), 1)[0])


@pytest.mark.parametrize(("falloff", "at_least"), [(Falloff.SQRT, 0.85), (Falloff.LINEAR, 0.85), (Falloff.STEP, 0.6)])
def test_sobol_rate(falloff, at_least):
    """RMSE falls at least as N^-0.85 where rho is continuous, as N^-0.6 for STEP."""
    rays = [16, 64, 256, 1024]
    assert slope([rmse(n, falloff, Sampler.SOBOL) for n in rays], rays) < -at_least


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_random_rate(falloff):
    """Independent rays: N^-0.5, within four standard errors of a slope through RMSEs known to 4 % each."""
    rays = [16, 64, 256, 1024]
    uncertainty = 0.04 / np.sqrt(np.sum((np.log(rays) - np.mean(np.log(rays))) ** 2))
    assert slope([rmse(n, falloff, Sampler.RANDOM) for n in rays], rays) == pytest.approx(-0.5, abs=4 * uncertainty)


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.LINEAR])
def test_64_sobol_rays_are_no_worse_than_1024_random_rays(falloff):
    assert rmse(64, falloff, Sampler.SOBOL) <= rmse(1024, falloff, Sampler.RANDOM)


def test_sequences_longer_than_the_table_keep_their_quality():
    """4,096 rays, held 1,024 at a time, go on converging as before, within four standard errors of the slopes."""
    assert samples.TABLE_ROWS == 1024
    values = [rmse(n, Falloff.SQRT, Sampler.SOBOL, seeds=2) for n in (256, 1024, 4096)]
    before, after = slope(values[:2], [256, 1024]), slope(values[1:], [1024, 4096])
    uncertainty = np.hypot(0.06, 0.06) / np.log(4.0)  # 256 errors fix an RMSE to 6 %
    assert abs(after - before) < 4.0 * uncertainty
    assert after < -0.5 - 2.0 * uncertainty
    random = [rmse(n, Falloff.SQRT, Sampler.RANDOM, seeds=2) for n in (1024, 4096)]
    assert slope(random, [1024, 4096]) == pytest.approx(-0.5, abs=4.0 * uncertainty)


def test_passes_give_the_same_rays(monkeypatch):
    """Holding 32 rays at a time instead of all changes sums by float32 rounding only."""
    settings = BakeSettings(256, distance=1.0)
    whole = SCENE.bake(settings)
    monkeypatch.setattr(samples, "TABLE_ROWS", 32)
    parts = SCENE.bake(settings)
    np.testing.assert_allclose(parts.grey, whole.grey, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(parts.sums.miss, whole.sums.miss)
    assert parts.rays == whole.rays


def test_patches_with_one_ray_are_unbiased():
    """N = 1: the mean over 128 patches x 64 seeds meets the mean of the strips within five standard errors."""
    means = [SCENE.bake(BakeSettings(1, distance=1.0, seed=seed)).grey.mean() for seed in range(64)]
    error = np.std(means, ddof=1) / 8.0
    assert error < 5e-3
    assert abs(np.mean(means) - exact.strip(Falloff.SQRT, 0.0, 0.8)) < 5.0 * error
