"""Patches that other solids cover: under a crate, inside of a block, or touching one."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.settings import BakeSettings
from tests.core.measuring import SEEDS, SIGMAS, bakes, estimate
from tests.core.scenes import Scene, box, floor, grid, join, mesh, room, scene

SETTINGS = BakeSettings(64, distance=0.5)
N = 10
# The crate covers the floor from 0.33 to 0.67: rows 4 and 5 of ten wholly, rows 3 and 6 in part.
LOW, HIGH = 0.33, 0.67
CRATE = box((LOW, LOW, 0.0), (HIGH, HIGH, 0.4), 3, (0.9, 0.2, 0.1))
SHEET = floor((0, 0), (1, 1), N, N, colour=(0.2, 0.4, 0.8))


def slab() -> tuple:
    """A closed slab whose top, of N x N faces, is the floor; the top faces come last."""
    return box((0, 0, -0.2), (1, 1, 0), N, (0.2, 0.4, 0.8))


FLOORS = {"open sheet": (SHEET, slice(0, N * N)), "closed slab": (slab(), slice(5 * N * N, 6 * N * N))}


def exposed_share(faces: np.ndarray) -> np.ndarray:
    """Share of each floor face, given by its centre, that the crate leaves free."""
    side = 0.5 / N
    cover = np.clip(np.minimum(faces + side, HIGH) - np.maximum(faces - side, LOW), 0.0, None)[:, :2] * N
    return 1.0 - cover.prod(1)


@pytest.mark.parametrize("kind", FLOORS)
@pytest.mark.parametrize("falloff", list(Falloff))
def test_floor_under_a_crate(kind, falloff):
    """Covered faces are invalid, exposed ones whole, and those between know their exposed share."""
    ground, top = FLOORS[kind]
    values = scene([ground, CRATE]).bake(replace(SETTINGS, rays=256, falloff=falloff))
    share = exposed_share(ground.centres()[top])
    assert [np.count_nonzero(share < 1e-9), np.count_nonzero((share > 1e-9) & (share < 1 - 1e-9))] == [4, 12]
    np.testing.assert_array_equal(values.valid[top], share > 1e-9)
    np.testing.assert_array_equal(values.sums.valid[top][share > 1 - 1e-9], 1.0)
    np.testing.assert_allclose(values.sums.valid[top], share, rtol=0, atol=0.02)  # 256 points of a net on a square
    assert np.isfinite(values.coloured).all()


def exposed_parts() -> tuple[Scene, np.ndarray, np.ndarray]:
    """The floor cut along the outline of the crate, without what lies under it; and each part's face and area."""
    cuts = np.sort(np.append(np.arange(N + 1) / N, [LOW, HIGH]))
    parts, owner, area = [], [], []
    for x0, x1 in itertools.pairwise(cuts):
        for y0, y1 in itertools.pairwise(cuts):
            middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
            if not ((middle > LOW) & (middle < HIGH)).all():
                parts.append(floor((x0, y0), (x1, y1), colour=(0.2, 0.4, 0.8)))
                owner.append(int(middle[1] * N) * N + int(middle[0] * N))
                area.append((x1 - x0) * (y1 - y0))
    return scene(parts, [CRATE, SHEET]), np.array(owner), np.array(area)


@pytest.mark.parametrize("brute", [False, True])
def test_straddling_faces_are_averaged_over_their_exposed_part(brute):
    """Against a floor that is cut at the crate's outline; no dark fringe."""
    s, owner, area = exposed_parts()
    cut = np.stack(
        [s.bake(replace(SETTINGS, seed=seed), brute=brute).grey for seed in range(SEEDS if not brute else 4)]
    )
    total = np.bincount(owner, area, N * N)
    known = total > 1e-9
    per_face = np.stack([np.bincount(owner, area * v, N * N) for v in cut])[:, known] / total[known]
    whole = bakes(scene([SHEET, CRATE]), replace(SETTINGS, rays=256))[:, : N * N, 3][:, known]
    assert np.count_nonzero(known) == 96
    # Drawing only from the exposed part makes W a ratio of two sums, biased by the square of its error.
    variance = whole.var(0, ddof=1) / len(whole) + per_face.var(0, ddof=1) / len(per_face)
    difference = whole.mean(0) - per_face.mean(0)
    assert (np.abs(difference) < 6.0 * np.sqrt(variance) + 5e-4).all()
    straddling = (exposed_share(SHEET.centres()) < 1 - 1e-9)[known]
    assert straddling.sum() == 12
    assert np.abs(difference[straddling]).max() < 0.01


@pytest.mark.parametrize("distance", [0.05, 0.02])
def test_reach_shorter_than_the_crate(distance):
    """Rays that end before the walls of the crate are recast: covered faces stay invalid, shares stay right."""
    crate = box((LOW, LOW, 0.0), (HIGH, HIGH, 0.4), 1, (0.9, 0.2, 0.1))
    baked = scene([SHEET, crate]).bake(replace(SETTINGS, rays=256, distance=distance))
    share = exposed_share(SHEET.centres())
    np.testing.assert_array_equal(baked.valid[: N * N], share > 1e-9)
    np.testing.assert_allclose(baked.sums.valid[: N * N], share, rtol=0, atol=0.02)


def test_bottom_of_a_crate():
    """On a closed slab it is invalid; on an open sheet its rays start below the sheet, and it is open."""
    for kind, valid in (("open sheet", True), ("closed slab", False)):
        ground, _ = FLOORS[kind]
        baked = scene([ground, CRATE]).bake(SETTINGS)
        bottom = slice(ground.faces + 4 * 9, ground.faces + 5 * 9)
        np.testing.assert_array_equal(baked.valid[bottom], valid)
        np.testing.assert_array_equal(baked.sums.miss[bottom], float(valid))


def test_invalid_faces_take_the_mean_of_valid_neighbours():
    """The four covered faces lie between covered-in-part ones: each takes the mean over the nodes it shares."""
    s = scene([SHEET, CRATE])
    nodes = np.stack(
        [SHEET.triangles[::2, 0], SHEET.triangles[::2, 1], SHEET.triangles[::2, 2], SHEET.triangles[1::2, 2]], 1
    )
    pairs = (np.repeat(np.arange(N * N), 4), nodes.ravel())
    baked = s.bake(SETTINGS, neighbours=pairs)
    open_value = s.bake(SETTINGS).grey
    face = 4 * N + 4
    known = baked.valid[: N * N]
    means = [
        np.mean([baked.grey[f] for f in range(N * N) if known[f] and node in nodes[f]])
        for node in nodes[face]
        if any(known[f] and node in nodes[f] for f in range(N * N))
    ]
    assert not known[face]
    assert len(means) == 3
    assert baked.grey[face] == pytest.approx(np.mean(means), rel=1e-12)
    assert open_value[face] == 1.0  # without neighbours: an open patch


def test_a_gap_of_a_hair():
    """A crate 1e-5 above the floor: exposed faces are those of contact, covered ones dark or invalid, never bright."""
    hair = CRATE.moved(offset=(0, 0, 1e-5))
    touching, hovering = (scene([SHEET, c]) for c in (CRATE, hair))
    a, b = bakes(touching, SETTINGS)[:, : N * N], bakes(hovering, SETTINGS)[:, : N * N]
    share = exposed_share(SHEET.centres())
    exposed = share > 1 - 1e-9
    # The grazing gap lets rays of the outermost strip in; what they meet there is at contact, as the wall is.
    one, two = estimate(a[:, exposed]), estimate(b[:, exposed])
    assert (np.abs(one.mean - two.mean) < SIGMAS * np.hypot(one.error, two.error) + 1e-4).all()
    baked = hovering.bake(SETTINGS)
    covered = share < 1e-9
    assert (baked.grey[: N * N][covered & baked.valid[: N * N]] < 0.05).all()
    assert np.isfinite(baked.coloured).all()
    bottom = slice(SHEET.faces + 4 * 9, SHEET.faces + 5 * 9)
    assert (baked.grey[bottom][baked.valid[bottom]] < 0.05).all()


def test_an_object_inside_of_another():
    """The outer solid is a room of the inner one, which it shades as if its faces looked inwards; it sees nothing."""
    inner, outer = box((0.4, 0.4, 0.4), (0.6, 0.6, 0.6), 2), box((0, 0, 0), (1, 1, 1), 2)
    baked, turned = (scene([inner, shell]).bake(BakeSettings(distance=0.5)) for shell in (outer, outer.flipped()))
    assert baked.valid.all()
    np.testing.assert_array_equal(baked.grey[:24], turned.grey[:24])
    np.testing.assert_array_equal(baked.grey[24:], 1.0)


BIG = box((0, 0, 0), (10, 10, 10), 2)


@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
@pytest.mark.parametrize(
    "post",
    [box((4.9, 4.9, 5), (5.1, 5.1, 45), 8), grid((4.9, 5, 5), (0.2, 0, 0), (0, 0, 40), 8, 8)],
    ids=["block", "sheet"],
)
def test_patches_deep_inside_of_a_big_solid(falloff, post):
    """Invalid although its walls are ten times farther than d_max."""
    baked = scene([post, BIG]).bake(BakeSettings(distance=0.4, falloff=falloff))
    inside = post.centres()[:, 2] < 10.0
    assert 0 < inside.sum() < post.faces / 2
    np.testing.assert_array_equal(baked.valid[: post.faces], ~inside)
    assert baked.valid[post.faces :].all()


def test_a_room_with_inward_normals_hides_nothing():
    """Negative volume: no solid, so furniture in it is valid, and so is the room."""
    furniture = box((0.4, 0.4, 0.2), (0.6, 0.6, 0.6), 2)
    baked = scene([room((0, 0, 0), (1, 1, 1), 3), furniture]).bake(BakeSettings(distance=0.5))
    assert baked.valid.all()
    np.testing.assert_array_equal(baked.sums.valid, pytest.approx(np.ones(len(baked.grey)), abs=1e-12))


def test_a_hollow_solid_hides_nothing_in_its_cavity():
    """A closed wall with thickness, two shells: the cavity is an ordinary room."""
    inner, outer = room((0.2, 0.2, 0.2), (0.8, 0.8, 0.8), 2), box((0, 0, 0), (1, 1, 1), 2)
    lamp = box((0.45, 0.45, 0.45), (0.55, 0.55, 0.55))
    shell = join([inner, outer])
    baked = scene([shell, lamp]).bake(BakeSettings(distance=0.4))
    assert baked.valid.all()
    assert baked.grey[:24].max() < 1.0
    np.testing.assert_array_equal(baked.grey[24:48], 1.0)


def test_overlapping_solids_hide_what_they_share():
    """Two boxes that run through each other: faces inside of the other are invalid, and darken no others."""
    one, two = box((0, 0, 0), (2, 1, 1), 4), box((1.25, -0.5, -0.5), (3, 1.5, 1.5), 1)
    baked = scene([one], [two]).bake(BakeSettings(256, distance=0.3))
    middle = one.centres()
    inside = middle[:, 0] > 1.25 + 0.25
    outside = middle[:, 0] < 1.25 - 0.25
    assert not baked.valid[inside].any()
    assert baked.valid[outside].all()
    np.testing.assert_array_equal(baked.grey[middle[:, 0] < 0.5], 1.0)


def test_solids_as_open_sheets_darken_instead():
    """A flat crate without its bottom is no solid: covered faces are inside of a box, valid and dark."""
    keep = CRATE.centres()[:, 2] > 1e-6
    faces = keep[CRATE.face]
    open_crate = mesh(CRATE.vertices * (1.0, 1.0, 0.5), CRATE.triangles[faces])
    baked = scene([SHEET], [open_crate]).bake(SETTINGS)
    covered = exposed_share(SHEET.centres()) < 1e-9
    assert baked.valid.all()
    assert (baked.sums.miss[covered] == 0.0).all()


def test_a_wall_that_stands_in_a_floor_splits_its_faces():
    """A thin open wall through the middle of a face: both halves see their side, none is dropped."""
    wall = grid((0.5, -1, -1), (0, 3, 0), (0, 0, 3))
    baked = scene([floor((0, 0), (1, 1))], [wall]).bake(replace(SETTINGS, rays=1024))
    assert baked.valid.all()
    assert baked.sums.valid[0] == 1.0
