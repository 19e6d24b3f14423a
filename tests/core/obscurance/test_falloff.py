"""The distance functions: their shape, their values, and that they work in place."""

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff, apply_falloff
from tests.core import closed_forms

EVERY = pytest.mark.parametrize("falloff", list(Falloff))
GRADUAL = pytest.mark.parametrize("falloff", [f for f in Falloff if f is not Falloff.STEP])


def values(falloff: Falloff, s: object) -> np.ndarray:
    return apply_falloff(falloff, np.array(s, np.float64))


@EVERY
def test_is_zero_at_contact(falloff):
    assert values(falloff, [0.0])[0] == 0.0


@EVERY
def test_never_falls_and_stays_within_0_and_1(falloff):
    rho = values(falloff, np.linspace(0.0, 1.0, 10001))
    assert (np.diff(rho) >= 0.0).all()
    assert rho.min() == 0.0
    assert rho.max() <= 1.0 + 1e-15


@GRADUAL
def test_reaches_1_without_a_jump(falloff):
    assert values(falloff, [1.0])[0] == pytest.approx(1.0, abs=1e-15)


@GRADUAL
def test_is_concave(falloff):
    rho = values(falloff, np.linspace(0.0, 1.0, 10001))
    assert (np.diff(rho, 2) <= 1e-15).all()


@EVERY
def test_equals_its_definition(falloff):
    s = np.linspace(0.0, 1.0, 1001)[:-1]
    np.testing.assert_allclose(values(falloff, s), closed_forms.rho(falloff, s), rtol=0, atol=4e-16)


@EVERY
def test_works_in_place_in_single_precision(falloff):
    s = np.linspace(0.0, 1.0, 1001, dtype=np.float32)[:-1]
    exact = closed_forms.rho(falloff, s)
    rho = apply_falloff(falloff, s)
    assert rho is s
    assert rho.dtype == np.float32
    np.testing.assert_allclose(rho, exact, rtol=0, atol=4 * np.finfo(np.float32).eps)


def test_order_of_the_falloffs():
    """The steeper the rise at contact, the lighter: step <= linear <= exponential <= sqrt <= cbrt."""
    s = np.linspace(0.01, 0.99, 99)
    order = [Falloff.STEP, Falloff.LINEAR, Falloff.EXPONENTIAL, Falloff.SQRT, Falloff.CBRT]
    rho = np.stack([values(falloff, s) for falloff in order])
    assert (np.diff(rho, axis=0) > 0.0).all()
