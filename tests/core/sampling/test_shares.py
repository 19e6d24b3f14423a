"""Entries are chosen as often as their shares say, and what is left of the number is uniform again."""

import numpy as np
import pytest

from obscurance_addon.core.sampling.shares import ascending_ends, pick


def test_ranges_end_where_shares_say():
    owner = np.array([0, 0, 2, 2, 2])
    np.testing.assert_allclose(ascending_ends(owner, np.array([0.25, 0.75, 0.5, 0.0, 0.5])), [0.25, 1, 2.5, 2.5, 3])
    assert len(ascending_ends(np.zeros(0, int), np.zeros(0))) == 0


@pytest.mark.parametrize("owner", [0, 1, 70_000])
def test_entries_are_chosen_by_share_and_the_rest_is_uniform(owner):
    """On a fine lattice of numbers: counts to within one, the rest evenly spread within each entry, none of share 0."""
    share = np.array([0.1, 0.0, 0.6, 0.3])
    ends = ascending_ends(np.repeat([0, 1, 70_000], 4), np.tile(share, 3))
    u = (np.arange(10_000) + 0.5) / 10_000
    entry, rest = pick(ends, np.full(10_000, owner), u)
    first = 4 * [0, 1, 70_000].index(owner)
    np.testing.assert_allclose(np.bincount(entry - first, minlength=4), share * 10_000, atol=1)
    for index in (0, 2, 3):
        np.testing.assert_allclose(np.quantile(rest[entry == first + index], [0.0, 0.5, 1.0]), [0, 0.5, 1], atol=2e-3)


def test_the_largest_number_below_1_stays_with_its_owner():
    """In single precision too, and whatever the shares' sum lost to rounding."""
    ends = ascending_ends(np.array([0, 0, 1]), np.array([1 / 3, 2 / 3 - 1e-9, 1.0]))
    u = np.nextafter(np.float32([1.0, 1.0]), np.float32(0.0))
    assert pick(ends, np.array([0, 1]), u)[0].tolist() == [1, 2]
