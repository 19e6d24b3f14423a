"""Texels that are done, told while several bands are in work."""

from obscurance_addon.core.lightmap.progress import TexelProgress
from obscurance_addon.core.monitor import Monitor


class Told(Monitor):
    def __init__(self):
        self.amounts = []

    def advance(self, amount):
        self.amounts.append(amount)


def test_bands_in_work_are_told_by_their_rays_and_end_at_their_texels():
    told = Told()
    progress = TexelProgress(told, rays=10)
    progress.begin(100)
    progress.begin(50)
    progress.cast(405)
    assert sum(told.amounts) == 40
    progress.cast(10_000)  # more than was foreseen
    assert sum(told.amounts) == 150
    progress.end(100)
    progress.end(50)
    assert sum(told.amounts) == 150
    assert min(told.amounts) >= 0


def test_a_band_that_takes_few_rays_is_told_when_it_ends():
    told = Told()
    progress = TexelProgress(told, rays=10)
    progress.begin(100)
    progress.begin(50)
    progress.cast(300)  # of both, some
    progress.end(100)
    assert sum(told.amounts) == 100
    progress.cast(100)
    assert sum(told.amounts) == 110
    progress.end(50)
    assert sum(told.amounts) == 150
