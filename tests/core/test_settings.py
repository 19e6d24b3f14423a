"""Settings check themselves: what is refused, what is accepted, and what it means."""

import dataclasses

import pytest

from obscurance_addon.core.errors import ObscuranceError, SettingsError
from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import MAX_RAYS_PER_PATCH, BakeSettings, Sampler


@pytest.mark.parametrize(
    "wrong",
    [
        {"rays": 0},
        {"rays": -1},
        {"rays": MAX_RAYS_PER_PATCH + 1},
        {"rays": 64.0},
        {"rays": True},
        {"ray_budget": 0},
        {"ray_budget": 1e6},
        {"distance": 0.0},
        {"distance": -1.0},
        {"distance": float("nan")},
        {"distance": -float("inf")},
        {"falloff": "CUBE"},
        {"sampler": "HALTON"},
        {"seed": -1},
        {"seed": 2**32},
        {"threads": -1},
    ],
    ids=str,
)
def test_values_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(SettingsError) as caught:
        BakeSettings(**wrong)
    name = next(iter(wrong)).replace("ray_budget", "ray budget")
    assert name in str(caught.value)
    assert isinstance(caught.value, ObscuranceError)


@pytest.mark.parametrize(
    "right",
    [
        {"rays": 1},
        {"rays": MAX_RAYS_PER_PATCH},
        {"ray_budget": 1},
        {"distance": 5e-324},
        {"distance": float("inf")},
        {"seed": 2**32 - 1},
        {"threads": 1},
    ],
    ids=str,
)
def test_limits_are_accepted(right):
    settings = BakeSettings(**right)
    assert all(getattr(settings, name) == value for name, value in right.items())


def test_names_become_members():
    settings = BakeSettings(falloff="CBRT", sampler="RANDOM")
    assert settings.falloff is Falloff.CBRT
    assert settings.sampler is Sampler.RANDOM


def test_thread_count():
    assert BakeSettings(threads=3).thread_count() == 3
    assert BakeSettings().thread_count() >= 1


def test_settings_do_not_change():
    with pytest.raises(dataclasses.FrozenInstanceError):
        BakeSettings().rays = 3
