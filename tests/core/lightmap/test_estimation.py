"""Obscurances of texels, each traced on its own: against exact values, the bake of faces, and many more rays."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.errors import BakeCancelledError, GeometryError
from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.lightmap import estimation
from obscurance_addon.core.lightmap.estimation import ERROR_SAMPLE
from obscurance_addon.core.monitor import Monitor
from obscurance_addon.core.obscurance.white import white_hits
from obscurance_addon.core.scene.reflectance import LUMINANCE
from obscurance_addon.core.settings import MIN_RAYS_PER_PATCH, BakeSettings
from tests.core import closed_forms as exact
from tests.core.lightmap.lightmap_scenes import (
    SIZE,
    bakes,
    flat,
    furnished,
    mapped_scene,
    over_seeds,
    turned,
    values_at,
)
from tests.core.measuring import ROUNDING, SEEDS, SIGMAS
from tests.core.scenes import box, floor, grid, icosphere, mesh

RED, BLUE = (0.8, 0.1, 0.0), (0.1, 0.3, 0.9)
HALF = pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])


@HALF
@pytest.mark.parametrize("white", [True, False])
def test_columns_of_texels_beside_a_wall(falloff, white):
    """Each has the mean over just the strip that it covers; the first and the last are half texels."""
    density = 8.0
    ground = floor((0, 0), (1.25, 4), colour=RED)
    wall = grid((0, -1.01, 0), (0, 6.02, 0), (0, 0, 1.01), colour=BLUE)
    s = mapped_scene([flat(ground, (10.5, 20.25), density)], [wall])
    texels = s.texels()
    settings = BakeSettings(64, distance=1.0, falloff=falloff)
    values = bakes(s, texels, settings, white=white)
    r_ave = (5.0 * np.array(RED) + 6.02 * 1.01 * np.array(BLUE)) / (5.0 + 6.02 * 1.01)
    reference = s.scene.bake(settings).scattering @ LUMINANCE
    column = texels.index % SIZE
    assert np.unique(column).tolist() == list(range(10, 21))
    for x in range(10, 21):
        near, far = np.clip(np.array([x, x + 1]) - 10.5, 0.0, 10.0) / density
        weights = texels.area[column == x]
        got = over_seeds(np.average(values[:, column == x], axis=1, weights=weights))
        w, m = exact.strip(falloff, near, far), exact.strip(Falloff.STEP, near, far)
        colour = np.array(BLUE) * (w - m) + r_ave * m
        if white:
            colour = white_hits((w - m) * np.array([[*BLUE, 1.0]]), reference)[0] + m
        assert got.error.max() < 5e-3
        assert got.agrees_with(colour), x


@HALF
def test_texels_below_a_ceiling(falloff):
    """All have the same value, mirrored and turned maps included."""
    s = mapped_scene(
        [
            turned(flat(floor((0, 0), (1, 1), 3, 3), (20, 20), 12.0), 27.0, (26, 26)),
            flat(floor((1, 0), (2, 1)), (60, 20), 12.0, (-1, 0, 0)),
        ],
        [floor((-1.01, -1.01), (3.01, 2.01), z=0.25).flipped()],
    )
    got = over_seeds(bakes(s, s.texels(), BakeSettings(64, distance=1.0, falloff=falloff)).mean(1))
    # Rays start 1e-5 of the half diagonal (1.12) above the floor: the ceiling is that much nearer.
    offset = 1.12e-5 * (exact.planes(falloff, 0.26) - exact.planes(falloff, 0.24)) / 0.02
    assert got.error.max() < 1e-3
    assert (np.abs(got.mean - exact.planes(falloff, 0.25)) < SIGMAS * got.error + ROUNDING + offset).all()


def test_polygon_occluders():
    """Lambert's form factor, averaged by quadrature over each of 4 x 4 texels."""
    polygon = np.array([(0.2, 0.1, 0.8), (1.2, 0.1, 0.8), (1.2, 0.9, 0.8), (0.2, 0.9, 0.8)])
    s = mapped_scene(
        [flat(floor((0, 0), (1, 1)), (8, 8), 4.0)], [mesh(polygon, [(0, 1, 2), (0, 2, 3)], np.zeros(2, int))]
    )
    got = over_seeds(bakes(s, s.texels(), BakeSettings(1024, distance=np.inf, falloff=Falloff.STEP)))
    patches = floor((0, 0), (1, 1), 4, 4).corners().reshape(16, 2, 3, 3)
    covers = np.array([exact.mean_polygon_cover(quad, polygon) for quad in patches])
    assert got.error.max() < 2e-3
    assert (np.abs(got.mean - (1.0 - covers[:, None])) < SIGMAS * got.error + 1e-5).all()


def face_means(s, values):
    """Means (seeds, f, 3) of texels (seeds, n, 3) over the face that covers most of each."""
    texels, faces = s.texels(), s.scene.patches
    area = np.bincount(texels.face, texels.area, len(faces))
    sums = [[np.bincount(texels.face, texels.area * c, len(faces)) / area for c in v.T] for v in values]
    return np.array(sums).transpose(0, 2, 1)


@pytest.mark.parametrize("use_bleeding", [True, False])
def test_the_mean_over_texels_is_the_value_of_the_face(use_bleeding):
    """Of maps whose texels end where faces do, on the paper's scale: white is no linear function of hits."""
    s = furnished(16.0, degrees=0.0, shift=0.0)
    settings = BakeSettings(64, distance=1.0, use_bleeding=use_bleeding)
    texel = over_seeds(face_means(s, bakes(s, s.texels(), settings, white=False)))
    seeded = [replace(settings, rays=4096, seed=100 + seed) for seed in range(SEEDS)]
    face = over_seeds(s.scene.bake(one).coloured for one in seeded)
    error = np.hypot(texel.error, face.error)
    assert error.max() < 1e-3
    assert (np.abs(texel.mean - face.mean) < SIGMAS * error + ROUNDING).all()
    assert np.ptp(face.mean) > 0.3


@pytest.mark.parametrize("adaptive", [True, False])
@pytest.mark.parametrize("falloff", list(Falloff))
def test_an_open_scene_is_exactly_white(adaptive, falloff):
    """A convex solid of many facets, and a sheet out of its reach."""
    ball = icosphere(2)
    apart = np.arange(len(ball.triangles))
    uv = np.array([(0, 0), (6.5, 0), (0, 6.5)]) + np.stack([apart % 30, apart // 30], -1)[:, None] * 8.0 + 1.3
    s = mapped_scene(
        [
            replace(flat(ball, (0, 0), 1.0), uv=uv, chart=apart),
            flat(floor((0, 0), (5, 5), z=1.5), (8, 120), 20.0),
        ]
    )
    baked = s.bake(BakeSettings(16, distance=0.4, falloff=falloff), adaptive=adaptive)
    alpha = baked.pages[0][..., 3]
    np.testing.assert_array_equal(baked.pages[0][alpha > 0.0], 1.0)
    np.testing.assert_array_equal(baked.pages[0][alpha == 0.0], 0.0)
    np.testing.assert_array_equal(baked.rmse, 0.0)
    assert alpha.ravel()[s.texels().index].all()


def test_an_open_scene_has_the_paper_value_of_r_ave():
    s = mapped_scene([flat(floor((0, 0), (5, 5), colour=RED), (8.5, 12.2), 20.0)])
    for adaptive in (True, False):
        baked = s.bake(white=False, adaptive=adaptive)
        np.testing.assert_allclose(baked.r_ave, np.float32(RED), rtol=1e-12)
        np.testing.assert_array_equal(values_at(baked, s.texels()), np.tile(np.float32(baked.r_ave), (101 * 101, 1)))


@pytest.mark.parametrize("white", [True, False])
def test_without_bleeding_it_is_grey(white):
    """And of a channel in which nothing reflects the misses are left, or nothing on the paper's scale."""
    s = furnished()
    dark = replace(s.scene.surfaces, reflectance=s.scene.surfaces.reflectance * np.float32([1, 1, 0]))
    s = replace(s, scene=replace(s.scene, surfaces=dark))
    texels = s.texels()
    grey = values_at(s.bake(BakeSettings(use_bleeding=False, distance=1.0), white=white), texels)
    coloured = values_at(s.bake(BakeSettings(distance=1.0), white=white), texels)
    assert (grey == grey[:, :1]).all()
    assert np.ptp(grey) > 0.3
    misses = BakeSettings(use_bleeding=False, distance=1.0, falloff=Falloff.STEP)
    left = values_at(s.bake(misses), texels)[:, 0] if white else 0.0
    np.testing.assert_allclose(coloured[:, 2], left, rtol=0, atol=ROUNDING)
    assert np.abs(coloured[:, 0] - grey[:, 0]).max() > 0.05


def test_texels_inside_of_a_solid_are_counted_and_filled():
    """12 x 12 texels under a crate; what fills them stays within the values around them, on every channel."""
    crate = box((1, 1, 0), (1.75, 1.75, 0.5), colour=RED)
    s = mapped_scene([flat(floor((0, 0), (3, 3)), (8, 8), 16.0)], [crate])
    baked = s.bake(BakeSettings(distance=0.5), margin=0)
    assert (baked.counts.texels, baked.counts.invalid) == (48 * 48, 12 * 12)
    assert baked.counts.hidden.sum() == pytest.approx(baked.counts.area.sum() * 144 / 48**2)
    page = baked.pages[0]
    assert page[..., 3].sum() == 48 * 48
    y, x = np.mgrid[:SIZE, :SIZE] - 24
    under = (x >= 0) & (x < 12) & (y >= 0) & (y < 12)
    around = (x >= -1) & (x < 13) & (y >= -1) & (y < 13) & ~under
    for channel in range(3):
        assert page[around, channel].min() <= page[under, channel].min()
        assert page[under, channel].max() <= page[around, channel].max()


def test_a_chart_inside_of_a_solid_is_open():
    """Nothing is known of it, so that it is as if nothing were there. Either solid holds but a part of it."""
    halves = [box((-1, -1, -1), (0.75, 2, 2)), box((0.5, -1, -1), (2, 2, 2))]
    s = mapped_scene([flat(floor((0, 0), (1, 1)), (8, 8), 16.0)], halves)
    for white in (True, False):
        baked = s.bake(white=white)
        assert baked.counts.invalid == baked.counts.texels == 256
        np.testing.assert_array_equal(values_at(baked, s.texels()), np.float32(1.0 if white else baked.r_ave[0]))


@pytest.mark.parametrize("adaptive", [True, False])
def test_r_ave_leaves_out_what_is_hidden(adaptive):
    """As the bake of faces does, and as the exact exposed area says."""
    crate = box((1.03, 1.04, 0), (1.72, 1.91, 0.5), colour=RED)
    s = mapped_scene([flat(floor((0, 0), (3, 3), 3, 3, colour=BLUE), (8.3, 8.1), 15.0)], [crate])
    seeded = [BakeSettings(64, distance=0.5, seed=seed) for seed in range(SEEDS)]
    colour = s.scene.patch_reflectance
    texel = over_seeds(s.bake(one, adaptive=adaptive, patch_reflectance=colour).r_ave for one in seeded)
    face = over_seeds(s.scene.bake(one, patch_reflectance=colour).r_ave for one in seeded)
    exposed, walls = 9.0 - 0.69 * 0.87, 2 * (0.69 * 0.87 + 0.69 * 0.5 + 0.87 * 0.5)
    r_ave = (exposed * np.array(BLUE) + walls * np.array(RED)) / (exposed + walls)
    assert (texel.error < face.error).all()
    assert (np.abs(texel.mean - face.mean) < SIGMAS * np.hypot(texel.error, face.error)).all()
    assert texel.agrees_with(r_ave)


@HALF
@pytest.mark.parametrize("adaptive", [True, False])
def test_threads_and_blocks_change_no_bit(adaptive, falloff):
    s = furnished()
    settings = BakeSettings(48, distance=0.6, falloff=falloff, threads=1)
    reference = s.bake(settings, adaptive=adaptive)
    for threads, block_rays in ((1, 777), (2, 32768), (7, 4096)):
        again = s.bake(replace(settings, threads=threads), adaptive=adaptive, block_rays=block_rays)
        np.testing.assert_array_equal(again.pages[0], reference.pages[0])
        np.testing.assert_array_equal([again.rmse, again.r_ave], [reference.rmse, reference.r_ave])
        assert again.rays == reference.rays


def test_bands_of_rows_change_no_bit(monkeypatch):
    s = furnished()
    whole = s.bake(BakeSettings(distance=0.6))
    monkeypatch.setattr(estimation, "_BAND_TEXELS", 1)
    monkeypatch.setattr(estimation, "_BAND_ROWS", 16)
    bands = s.bake(BakeSettings(distance=0.6))
    np.testing.assert_array_equal(bands.pages[0], whole.pages[0])
    assert (bands.rays, bands.counts.texels) == (whole.rays, whole.counts.texels)


def test_pages_are_baked_one_like_the_other():
    """Each as if the others had no place, bit for bit, though they shade each other."""
    ground, wall = floor((0, 0), (3, 3), colour=RED), grid((0, 0, 0), (0, 3, 0), (0, 0, 3), colour=BLUE)
    other = grid((0, 3, 0), (3, 0, 0), (0, 0, 3))
    s = mapped_scene(
        [
            flat(ground, (8, 8), 20.0),
            flat(wall, (8, 8), 20.0, (0, 1, 0), (0, 0, 1), page=2),
            flat(other, (30, 8.2), 20.0, (1, 0, 0), (0, 0, 1), page=1),
        ]
    )
    together = s.bake()
    assert len(together.pages) == 3
    assert together.use == pytest.approx(together.counts.texels / (3 * SIZE**2))
    for page in range(3):
        alone = replace(s, layout=replace(s.layout, page=np.where(s.layout.page == page, page, -1))).bake()
        np.testing.assert_array_equal(alone.pages[page], together.pages[page])
        assert not np.any([alone.pages[k] for k in range(3) if k != page])
        assert np.ptp(values_at(together, s.texels(page))) > 0.2


@pytest.mark.parametrize("per_texel", [2, 17, 40, 300])
def test_a_budget_is_shared_out_over_the_texels(per_texel):
    """As the greatest power of two that it allows, and never fewer rays than a patch gets at least."""
    s = furnished()
    texels = s.triangles().texels()
    baked = s.bake(BakeSettings(ray_budget=int(per_texel * texels) + 1, distance=1.0))
    plain = s.bake(BakeSettings(max(MIN_RAYS_PER_PATCH, 2 ** int(np.log2(per_texel))), distance=1.0))
    assert baked.rays == plain.rays
    np.testing.assert_array_equal(baked.pages[0], plain.pages[0])


@HALF
@pytest.mark.parametrize("adaptive", [True, False])
def test_the_estimated_error_is_the_true_one(adaptive, falloff):
    """Within 35 %: of n point sets, the mean of products knows the square to sqrt(5 / n), 7 % of the root of 256's.

    What it repeats is a sample, and texels of one point set err alike, so that this is 5 standard errors.
    """
    s = furnished(20.0)
    texels = s.texels()
    assert len(texels) < 3 * ERROR_SAMPLE
    settings = BakeSettings(32, distance=1.0, falloff=falloff)
    baked = s.bake(settings, adaptive=adaptive)
    reference = values_at(s.bake(replace(settings, rays=1024, seed=7)), texels)
    true = np.sqrt(((values_at(baked, texels) - reference) ** 2).mean(0))
    np.testing.assert_allclose(baked.rmse, true, rtol=0.35)
    assert true.min() > 1e-3


def test_without_a_place_there_is_nothing_to_bake():
    s = furnished()
    with pytest.raises(GeometryError, match="UV map"):
        replace(s, layout=replace(s.layout, page=np.full(len(s.layout.page), -1))).bake()
    with pytest.raises(GeometryError, match="UV map"):
        replace(s, layout=replace(s.layout, uv=np.full_like(s.layout.uv, 0.5))).bake()


class Recorder(Monitor):
    def __init__(self, stop_in=None):
        self.phases, self.done, self.stop_in = [], 0, stop_in

    def phase(self, name, total):
        self.phases.append(name)
        self.total, self.done = total, 0

    def advance(self, amount):
        self.done += amount
        if self.phases[-1] == self.stop_in:
            raise BakeCancelledError("cancelled")


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_monitor_hears_of_all_texels_and_can_cancel(adaptive):
    s, monitor, before = furnished(), Recorder(), set(threading.enumerate())
    s.bake(monitor=monitor, adaptive=adaptive)
    assert monitor.phases == ["build", "trace"]
    assert 0.8 * monitor.total < monitor.done <= len(s.texels())
    for phase in monitor.phases:
        with pytest.raises(BakeCancelledError):
            s.bake(monitor=Recorder(phase), adaptive=adaptive)
    assert set(threading.enumerate()) == before


@HALF
def test_brute_force_gives_the_same(falloff):
    s = furnished(3.0)
    settings = BakeSettings(16, distance=1.0, falloff=falloff)
    embree, brute = s.bake(settings), s.bake(settings, brute=True)
    np.testing.assert_allclose(brute.pages[0], embree.pages[0], rtol=0, atol=ROUNDING)
