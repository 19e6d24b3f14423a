"""Messages between processes arrive as they were sent."""

import multiprocessing
import pickle
import subprocess

import numpy as np
import pytest

from obscurance_addon.core.process import Channel
from obscurance_addon.core.settings import BakeSettings


@pytest.fixture
def ends(tmp_path):
    one, other = multiprocessing.Pipe()
    made = Channel(one, tmp_path), Channel(other, tmp_path)
    yield made
    for end in made:
        end.close()


@pytest.mark.parametrize("n", [0, 1, 100, 1 << 17])
def test_arrays_of_any_size_arrive_and_leave_nothing(ends, n, tmp_path):
    """Small ones through the pipe, large ones through a file; with their layout, and free to be written to."""
    sent = {
        "empty": np.zeros((0, 3), np.int32),
        "rows": np.arange(3 * n, dtype=np.float64).reshape(-1, 3),
        "columns": np.asfortranarray(np.arange(4 * n, dtype=np.float32).reshape(-1, 4)),
        "flags": np.arange(n) % 3 == 0,
        "settings": BakeSettings(rays=7),
    }
    ends[0].send(sent)
    assert ends[1].poll(1.0)
    got = ends[1].receive()
    assert got["settings"] == sent["settings"]
    for name in ("empty", "rows", "columns", "flags"):
        np.testing.assert_array_equal(got[name], sent[name])
        assert got[name].dtype == sent[name].dtype
        assert got[name].flags.writeable
        got[name] += 0 if got[name].dtype != bool else False
    assert got["columns"].flags.f_contiguous
    assert list(tmp_path.iterdir()) == []


def test_parts_that_are_kept_are_sent_once(ends):
    """The same object at the other end, for as long as it is named."""
    part, other = BakeSettings(rays=3), BakeSettings(rays=5)
    got = []
    for message, keep in (([part, 1], [part]), ([part, 2], None), ([part, other], [part, other]), ([other], [other])):
        ends[0].send(message, keep)
        got.append(ends[1].receive())
    assert got[0][0] is got[1][0] is got[2][0]
    assert got[0][0] == part
    assert got[2][1] is got[3][0]
    assert len(ends[1]._kept) == 1


def test_nothing_but_the_core_and_arrays_is_made(ends):
    """A message that names anything else is refused."""
    ends[0].send({"call": subprocess.check_output})
    with pytest.raises(pickle.UnpicklingError, match="subprocess"):
        ends[1].receive()
