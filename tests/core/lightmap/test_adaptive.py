"""Texels interpolated from sparse ones: as close to the truth as was asked for, and only where that can be known."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.lightmap.adaptive import STRIDES, AdaptiveTexels, Band
from obscurance_addon.core.lightmap.obscurances import TexelTracer
from obscurance_addon.core.lightmap.settings import LightmapSettings
from obscurance_addon.core.lightmap.texels import covered_texels
from obscurance_addon.core.scene.reflectance import LUMINANCE, scattering_mean, surface_sums
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.tracing.samples import BLOCK_RAYS
from tests.core.lightmap.lightmap_scenes import SIZE, Mapped, flat, mapped_scene, six_sides, values_at
from tests.core.measuring import SIGMAS
from tests.core.scenes import box, floor, grid, mesh

BOUND = LightmapSettings().error_bound
HALF = pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
DENSITY = 48.0
LEAST = STRIDES[-1]


def contact():
    """A crate on a floor beside a wall; every face but the wall is mapped."""
    ground = floor((0, 0), (2, 2), colour=(0.2, 0.5, 0.8))
    wall = grid((0, -1.1, 0), (0, 4.2, 0), (0, 0, 1.1))
    crate = box((1.0, 0.9, 0), (1.4, 1.4, 0.4), colour=(0.8, 0.2, 0.1))
    return mapped_scene([flat(ground, (4, 4), DENSITY), six_sides(crate, (5, 120), DENSITY, 4)], [wall])


def tracer_of(s, settings):
    """What traces the values of a white layer, and all texels."""
    traced = build_scene(s.scene.surfaces, s.scene.patches, settings).traced
    texels = covered_texels(s.triangles(), s.size, 0, (0, s.size))
    white = scattering_mean(surface_sums(s.scene.surfaces)[4:]) @ LUMINANCE
    return TexelTracer(traced, settings, np.zeros(3, bool), lambda _: None, BLOCK_RAYS, white), texels


def interpolated(s, settings, error_bound=BOUND):
    """The page as a band: what is interpolated of it, and what is traced sparsely."""
    tracer, texels = tracer_of(s, settings)
    return AdaptiveTexels(tracer, np.ones(3), error_bound).interpolate(texels, (0, s.size))


def between(band):
    """(SIZE, SIZE) bool: texels that are interpolated."""
    page = np.zeros(SIZE * SIZE, bool)
    page[band.texels.index[band.between & ~band.known]] = True
    return page.reshape(SIZE, SIZE)


@HALF
@pytest.mark.parametrize("error_bound", [BOUND, 3 * BOUND])
def test_interpolated_values_are_within_the_error_bound(falloff, error_bound):
    """What is left of the error after averaging over seeds, but for the noise of that mean and of the reference."""
    s = contact()
    settings = BakeSettings(128, distance=1.0, falloff=falloff)
    reference = s.bake(replace(settings, rays=1024, seed=77))
    exact = values_at(reference, s.texels())
    errors, masks = [], []
    for seed in range(6):
        band = interpolated(s, replace(settings, seed=seed), error_bound)
        errors.append(band.values[:, :3] + band.values[:, 3:] - exact)
        masks.append(band.between & ~band.known)
    always = np.all(masks, axis=0)
    assert np.count_nonzero(always) > 0.4 * len(always)
    errors = np.stack(errors)[:, always]
    noise = np.sqrt((errors.var(0, ddof=1) / len(errors)).mean(0) + reference.rmse**2)
    assert (np.abs(errors.mean(0)) <= error_bound + SIGMAS * noise).all()
    assert (np.sqrt(np.mean(errors.mean(0) ** 2, axis=0)) <= error_bound).all()


@HALF
def test_the_whole_page_is_within_the_error_bound_with_fewer_rays(falloff):
    s = contact()
    settings = BakeSettings(64, distance=1.0, falloff=falloff)
    plain, adaptive = s.bake(settings), s.bake(settings, adaptive=True)
    assert adaptive.rays < 0.75 * plain.rays
    assert adaptive.traced < 0.5 * plain.traced
    assert plain.traced == plain.counts.texels == adaptive.counts.texels
    assert (adaptive.rmse <= np.hypot(plain.rmse, BOUND)).all()
    assert adaptive.counts.invalid == plain.counts.invalid
    looser = s.bake(settings, adaptive=True, error_bound=3 * BOUND)
    assert looser.traced < adaptive.traced


@HALF
def test_texels_beside_contacts_are_traced(falloff):
    """A block has corners 4 texels apart or more and must see nothing nearer than it is wide."""
    band = interpolated(contact(), BakeSettings(64, distance=1.0, falloff=falloff))
    page = between(band)
    assert not page[4:100, 4:8].any()  # the wall
    low, high = (np.round(4 + DENSITY * np.array(corner)).astype(int) for corner in ((1.0, 0.9), (1.4, 1.4)))
    assert not page[low[1] - 3 : high[1] + 3, low[0] - 3 : high[0] + 3].any()
    assert page[4:100, 4:100].mean() > 0.4


@HALF
def test_texels_inside_of_solids_are_never_interpolated(falloff):
    """Nor those partly inside: a crate and a thin slanted box stand in the floor, off the texels' borders."""
    slanted = box((0, 0, -0.5), (0.06, 0.9, 0.5)).moved([[0.8, -0.6, 0.3], [0.6, 0.8, 0], [0, 0, 1]], (0.9, 0.3, 0))
    crate = box((1.21875, 1.328125, -0.25), (1.609375, 1.765625, 0.03125))  # hardly higher than the floor
    s = mapped_scene([flat(floor((0, 0), (2, 2)), (4, 4), DENSITY)], [slanted, crate])
    settings = BakeSettings(64, distance=1.0, falloff=falloff)
    tracer, texels = tracer_of(s, settings)
    valid = tracer.trace(texels, np.arange(len(texels))).valid
    band = interpolated(s, settings)
    assert s.scene.surfaces.shells.solid.sum() == 24
    assert np.count_nonzero(valid == 0.0) > 18 * 20  # under the crate
    assert np.count_nonzero((valid > 0.0) & (valid < 1.0)) > 100
    assert (valid[band.between] == 1.0).all()
    assert band.between.mean() > 0.2


def folded(degrees):
    """An open ridge across a chart whose fold is at column 42.5."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    sheet = mesh(
        [(0, 0, 0), (0.385, 0, 0), (0.385, 1, 0), (0, 1, 0), (0.385 + c, 0, -s), (0.385 + c, 1, -s)],
        [(0, 1, 2), (0, 2, 3), (1, 4, 5), (1, 5, 2)],
        [0, 0, 1, 1],
    )
    uv = np.array([(4, 4), (42.5, 4), (42.5, 104), (4, 104), (142.5, 4), (142.5, 104)])
    return mapped_scene([Mapped(sheet, uv[sheet.triangles], np.zeros(4, int))])


def touching_charts():
    """Two charts that meet at column 42 of the map, and lie far apart."""
    one, other = floor((0, 0), (0.38, 1)), floor((3, 0), (4, 1))
    return mapped_scene([flat(one, (4, 4), 100.0), flat(other, (42, 4), 100.0)])


@pytest.mark.parametrize(
    "s", [folded(20), folded(90), folded(170), touching_charts()], ids=["20°", "90°", "170°", "charts"]
)
def test_nothing_is_interpolated_across_edges(s):
    """The block of texels in which a hard edge or the border of charts lies is traced, its neighbours are not."""
    page = between(interpolated(s, BakeSettings(16, distance=1.0)))[4:104]
    assert not page[:, 40:44].any()
    assert page[:88, 8:36].mean() > 0.8
    assert page[:88, 48:140].mean() > 0.8


def test_a_slight_bend_is_no_hard_edge():
    """5 degrees change the irradiance by 1 - cos 5, 0.4 %."""
    page = between(interpolated(folded(5), BakeSettings(16, distance=1.0)))
    assert page[4:92, 40:44].mean() > 0.8


def test_nothing_is_interpolated_in_charts_smaller_than_a_block():
    """A block needs the texels at its far side too."""

    def charts(side):
        m = floor((0, 0), (1, 1), 8, 8)
        at = 16.0 * np.stack([m.face % 8, m.face // 8], -1)[:, None]
        local = side * (8.0 * m.corners()[..., :2] - np.stack([m.face % 8, m.face // 8], -1)[:, None])
        return mapped_scene([Mapped(m, at + local, m.face)])

    settings = BakeSettings(16, distance=1.0)
    for side, share in ((LEAST, 0.0), (LEAST + 1, (LEAST**2 - 2) / (LEAST + 1) ** 2)):
        baked = charts(side).bake(settings, adaptive=True)
        assert baked.counts.texels == 64 * side**2
        assert 1.0 - baked.traced / baked.counts.texels == pytest.approx(share)


@HALF
@pytest.mark.parametrize("offset", [1, 5, 9, 13])
def test_a_thin_leg_between_sparse_texels_is_not_missed(falloff, offset):
    """2 texels wide, within the first block of the coarsest lattice and off the lattice of the next ones."""
    density, at = 40.0, 48 + offset
    low, high = (at - 4) / density, (at - 2) / density
    s = mapped_scene([flat(floor((0, 0), (3, 3)), (4, 4), density)], [box((low, low, 0), (high, high, 1))])
    settings = BakeSettings(64, distance=4.0, falloff=falloff)
    plain, adaptive = s.bake(replace(settings, rays=1024, seed=5)), s.bake(settings, adaptive=True)
    assert adaptive.counts.invalid == plain.counts.invalid == 4
    beside = np.zeros((SIZE, SIZE), bool)
    beside[at - 4 : at + 6, at - 4 : at + 6] = True
    beside[at : at + 2, at : at + 2] = False
    shadow, found = plain.pages[0][beside, :3], adaptive.pages[0][beside, :3]
    assert shadow.min() < 0.8
    noise = s.bake(settings, adaptive=False).pages[0][beside, :3] - shadow
    assert np.sqrt(np.mean((found - shadow) ** 2)) < np.hypot(BOUND, np.sqrt(np.mean(noise**2)))
    assert adaptive.traced < 0.5 * plain.traced  # elsewhere there is not much to see


def test_an_open_floor_is_exactly_white():
    """From hardly more than the corners and the centres of the coarsest blocks, for every falloff."""
    s = mapped_scene([flat(floor((0, 0), (2, 2)), (16, 16), 100.0)])
    for falloff in Falloff:
        baked = s.bake(BakeSettings(64, distance=5.0, falloff=falloff), adaptive=True)
        np.testing.assert_array_equal(values_at(baked, s.texels()), 1.0)
        np.testing.assert_array_equal(baked.rmse, 0.0)
        blocks = (200 // STRIDES[0]) ** 2
        rest = 200**2 - (200 // LEAST * LEAST - LEAST) ** 2  # right and above of the last blocks
        assert baked.traced < rest + 3 * blocks + 4 * 200


@pytest.mark.parametrize("stride", STRIDES)
def test_no_colour_leaves_the_range_of_those_it_is_made_of(stride):
    """Corners and centre at random, in any mixture of what is known before R_ave and what waits for it."""
    s = mapped_scene([flat(floor((0, 0), (2, 2)), (0, 0), 100.0)])
    band = Band(covered_texels(s.triangles(), s.size, 0, (0, s.size)), (0, s.size))
    random = np.random.default_rng(3)
    band.values[:] = random.choice([0.0, 0.5, 1.0], band.values.shape) * random.random(band.values.shape)
    blocks = band.open_blocks(stride, band.flat_blocks()[stride])
    assert len(blocks.centre) > 100
    sparse = np.concatenate([blocks.corners, blocks.centre[:, None]], 1)
    band.known[sparse] = True
    before = band.values.copy()
    band.fill(blocks)
    np.testing.assert_array_equal(band.values[band.known], before[band.known])
    rows, columns = np.mgrid[:stride, :stride]
    place = (blocks.row[:, None, None] * stride + rows) * s.size + blocks.column[:, None, None] * stride + columns
    for _ in range(50):
        colour = band.values @ random.normal(size=4)
        own, inside = colour[sparse], colour[np.searchsorted(band.texels.index, place)].reshape(len(sparse), -1)
        slack = 4 * np.finfo(float).eps * np.abs(band.values).max()
        assert (inside <= own.max(1)[:, None] + slack).all()
        assert (inside >= own.min(1)[:, None] - slack).all()
