"""Live Preview under random edits shows what a full bake gives; `tools/random_edits.py` makes many more of them."""

import pytest

from tests.blender.animation.random_runs import DifferenceError, run


@pytest.mark.parametrize("seed", range(3))
def test_what_is_shown_is_what_a_full_bake_gives(registered, tmp_path, seed):
    assert run(100, seed, tmp_path) > 40


def test_the_comparison_can_fail(registered, tmp_path, monkeypatch):
    """A preview that looks at nothing is found out."""
    monkeypatch.setattr("obscurance_addon.blender.animation.scene_changes.SceneChanges.find", lambda *_: {})
    with pytest.raises(DifferenceError):
        run(100, 0, tmp_path)
