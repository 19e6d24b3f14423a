"""Texels below transparent surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from tests.core.lightmap.lightmap_scenes import flat, mapped_scene, values_at
from tests.core.obscurance.test_transparent import of_stack
from tests.core.scenes import floor

RED = np.array([1.0, 0.5, 0.25])


@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_texels_below_a_stack_of_cards(falloff, adaptive):
    heights, alpha = (0.3, 0.6), 0.4
    cards = [floor((-8, -8), (8, 8), z=z).letting_through(1.0 - alpha) for z in heights]
    s = mapped_scene([flat(floor((-1, -1), (1, 1)), (10.0, 10.0), 20.0)], cards)
    settings = BakeSettings(256, distance=1.0, falloff=falloff)
    values = values_at(s.bake(settings, adaptive=adaptive), s.texels())
    np.testing.assert_allclose(values.mean(0), of_stack(falloff, heights, alpha)[0], atol=2e-3)


def test_texels_below_a_filter():
    """Under STEP a black filter leaves its colour, times the light that does not come past it."""
    filters = floor((-8, -8), (8, 8), z=0.5).coloured((0, 0, 0)).letting_through(RED)
    s = mapped_scene([flat(floor((-1, -1), (1, 1)), (10.0, 10.0), 20.0)], [filters])
    values = values_at(s.bake(BakeSettings(256, distance=1.0, falloff=Falloff.STEP)), s.texels())
    np.testing.assert_allclose(values.mean(0), 0.25 + 0.75 * RED, atol=2e-3)
