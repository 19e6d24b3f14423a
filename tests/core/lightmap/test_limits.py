"""Bounds that a lightmap keeps to: its ray budget, the disk, rows of bands; and overlaps, counted by face."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from obscurance_addon.core.errors import GeometryError
from obscurance_addon.core.lightmap import estimation
from obscurance_addon.core.lightmap.adaptive import STRIDES
from obscurance_addon.core.lightmap.estimation import TexelCounts
from obscurance_addon.core.lightmap.obscurances import TexelValues
from obscurance_addon.core.settings import BakeSettings
from tests.core.lightmap.lightmap_scenes import flat, mapped_scene
from tests.core.lightmap.test_texels import atlas, rectangle, texels
from tests.core.scenes import floor


def under_a_lid():
    """A floor so close under a lid that no texel of it can be interpolated."""
    ground, lid = floor((0, 0), (2, 2)), floor((-1, -1), (3, 3)).moved(1.0, (0.0, 0.0, 0.06))
    return mapped_scene([flat(ground, (8, 8), 64.0)], [lid])


@pytest.mark.parametrize("per_texel", [16, 64, 100])
def test_sparse_texels_keep_to_the_budget_where_they_save_nothing(per_texel):
    """All texels are traced in the end, some of them with more rays; the floor of 16 rays each is let through."""
    s = under_a_lid()
    budget = int(per_texel * len(s.texels()))
    baked = s.bake(BakeSettings(ray_budget=budget, distance=1.0), adaptive=True)
    assert baked.traced == baked.counts.texels
    least = 16 * baked.counts.texels
    assert baked.rays <= max(budget, (1.0 + estimation.MOST_EXTRA_RAYS) * least)
    assert baked.rays > least


@pytest.mark.parametrize("size", [256, 1000, 1001, 1500])
def test_bands_begin_where_sparse_texels_do(size):
    """At multiples of the coarsest stride, whatever the size; the bands share their rows out without a gap."""
    corners = rectangle(1, 1, size - 1, size - 1)
    rows = estimation._rows_of_bands(size)
    assert all(first % STRIDES[0] == 0 for first, _ in rows)
    bands = [estimation._band(atlas(np.array(corners)), size, 0, of) for of in rows]
    index = np.concatenate([found.index[:n] for found, n in bands])
    assert np.array_equal(index, np.unique(index))
    assert len(index) == (size - 2) ** 2


def test_pages_without_room_on_the_disk_are_refused(monkeypatch):
    """Before anything is traced: writing into a full disk through memory would end Blender."""
    page = flat(floor((0, 0), (1, 1)), (8, 8), 40.0)
    s = mapped_scene([page, flat(floor((5, 5), (6, 6)), (8, 8), 40.0, page=1)])
    assert len(s.bake(BakeSettings(4)).pages) == 2
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: SimpleNamespace(free=1 << 20))
    with pytest.raises(GeometryError, match=r"2 pages of 256 need .* make room, or use a lower texel density"):
        s.bake(BakeSettings(4))


@pytest.mark.parametrize(
    ("triangles", "face", "chart", "expected"),
    [
        (rectangle(2, 2, 6, 6) * 2, 1, 0, {(1, 1): 16}),
        (rectangle(2, 2, 6, 6) * 2, [3, 3, 1, 1], [0, 0, 1, 1], {(1, 3): 16}),
        (
            rectangle(2, 2, 6.5, 10) + rectangle(6.5, 2, 11, 10) + rectangle(2, 2, 11, 10),
            [1, 1, 2, 2, 3, 3],
            [0] * 4 + [1] * 2,
            {(1, 3): 40, (2, 3): 32},
        ),
        (rectangle(2, 2, 6.5, 10) + rectangle(6.5, 2, 11, 10), [1, 1, 2, 2], 0, {}),
    ],
    ids=["itself", "another", "neighbours over a third", "neighbours"],
)
def test_overlaps_are_counted_by_the_faces_that_overlap(triangles, face, chart, expected):
    """A face may overlap itself; faces that share an edge do not overlap."""
    found = texels(atlas(triangles, face=face, chart=chart))
    values = TexelValues(np.zeros((len(found), 4)), np.ones(len(found)), rays=0, traced=0)
    counts = TexelCounts.none(4)
    counts.add(TexelCounts.of(found, values, 4))
    assert counts.overlap.keys() == expected.keys()
    assert sum(counts.overlap.values()) == sum(expected.values())
