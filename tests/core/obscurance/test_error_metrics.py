"""Error metrics on values small enough to check by hand."""

import numpy as np
import pytest

from obscurance_addon.core.obscurance.error_metrics import energy_ratio, relative_rmse, shape_error

REFERENCE = np.array([[1.0, 2.0], [2.0, 0.0], [9.0, 9.0]])
WEIGHT = np.array([2.0, 1.0, 0.0])


def test_by_hand():
    found = np.array([[2.0, 2.0], [2.0, 3.0], [-5.0, 77.0]])
    assert relative_rmse(found, REFERENCE, WEIGHT) == pytest.approx(((2 + 9) / (2 + 8 + 4)) ** 0.5)
    assert energy_ratio(found, REFERENCE, WEIGHT) == pytest.approx((8 + 5) / (6 + 2))


def test_nothing_at_all_is_an_error_of_one():
    nothing = np.zeros_like(REFERENCE)
    assert relative_rmse(nothing, REFERENCE, WEIGHT) == shape_error(nothing, REFERENCE, WEIGHT) == 1.0
    assert energy_ratio(nothing, REFERENCE, WEIGHT) == 0.0


def test_a_factor_is_no_error_of_shape():
    assert shape_error(3.0 * REFERENCE, REFERENCE, WEIGHT) == pytest.approx(0.0, abs=1e-12)
    assert relative_rmse(3.0 * REFERENCE, REFERENCE, WEIGHT) == pytest.approx(2.0)
    assert energy_ratio(3.0 * REFERENCE, REFERENCE, WEIGHT) == pytest.approx(3.0)
