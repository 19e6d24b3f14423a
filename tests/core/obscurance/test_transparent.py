"""Transparent surfaces: stacks of cards in closed form, cut-outs against every surface along every ray in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.falloff import Falloff
from obscurance_addon.core.obscurance.estimator import gather_obscurances
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from obscurance_addon.core.tracing.intersector import BruteForceIntersector
from obscurance_addon.core.tracing.samples import PatchSamples
from tests.core import closed_forms
from tests.core.scenes import box, floor, grid, join, room, rotation, scene

EXACT = 2e-3  # what 4,096 rays leave


def stack(heights, transmission, colour=(0.5, 0.5, 0.5)):
    """A small floor under cards that are wide beside d_max = 1."""
    cards = [floor((-6, -6), (6, 6), z=z).coloured(colour).letting_through(transmission) for z in heights]
    return scene([floor((-0.05, -0.05), (0.05, 0.05), colour=(0.5, 0.5, 0.5))], cards)


def of_stack(falloff, heights, alpha):
    """W of eq. 2 under infinite cards of opacity alpha, and the share of light that gets through to d_max."""
    miss = np.array([closed_forms.planes(Falloff.STEP, q) for q in heights])
    near = np.array([closed_forms.planes(falloff, q) for q in heights]) - miss
    reached = np.append(1.0 - miss, 0.0)
    through = (1.0 - alpha) ** np.arange(len(heights) + 1)
    out = miss[0] + through[1:] @ (reached[:-1] - reached[1:])
    return alpha * through[:-1] @ near + out, out


@pytest.mark.parametrize("falloff", list(Falloff))
@pytest.mark.parametrize(
    ("heights", "alpha"), [((0.3,), 0.5), ((0.2, 0.5, 0.7), 0.25), (np.linspace(0.1, 0.9, 30), 0.1)]
)
def test_stack_of_cards(falloff, heights, alpha):
    """Each dims what is behind it, and adds its own at its own distance."""
    baked = stack(heights, 1.0 - alpha).bake(BakeSettings(4096, distance=1.0, falloff=falloff))
    exact, out = of_stack(falloff, heights, alpha)
    assert baked.grey[0] == pytest.approx(exact, abs=EXACT)
    assert baked.sums.miss[0] == pytest.approx(out, abs=EXACT)
    np.testing.assert_allclose(baked.white[0], baked.grey[0], atol=1e-5)  # all of one colour
    np.testing.assert_allclose(baked.r_ave, 0.5, rtol=1e-6)


@pytest.mark.parametrize("falloff", [Falloff.STEP, Falloff.SQRT])
@pytest.mark.parametrize("count", [1, 30])
def test_what_lets_all_light_through_is_as_if_absent(falloff, count):
    baked = stack(np.linspace(0.1, 0.9, count), 1.0).bake(BakeSettings(64, distance=1.0, falloff=falloff))
    np.testing.assert_allclose(baked.white, 1.0, atol=1e-6)


@pytest.mark.parametrize("falloff", [Falloff.STEP, Falloff.LINEAR])
def test_never_darker_than_opaque_and_half_way_between(falloff):
    settings = BakeSettings(256, distance=1.0, falloff=falloff)
    opaque, half, clear = (stack((0.3,), t).bake(settings).white[0] for t in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * (opaque + clear), atol=1e-6)
    assert (opaque < half).all()
    assert (half < clear).all()


@pytest.mark.parametrize("falloff", [Falloff.STEP, Falloff.SQRT])
def test_a_filter_colours_what_is_behind_it(falloff):
    """Two red filters before a green wall: eq. 5 per channel, and the grey mean without colour."""
    red, green = np.array([1.0, 0.5, 0.25]), np.array([0.1, 0.8, 0.2])
    filters = [floor((-6, -6), (6, 6), z=z).coloured((0, 0, 0)).letting_through(red) for z in (0.1, 0.2)]
    patch = floor((-0.05, -0.05), (0.05, 0.05), colour=(0.5, 0.5, 0.5))
    wall = floor((-6, -6), (6, 6), z=0.4).coloured(green)
    settings = BakeSettings(4096, distance=1.0, falloff=falloff)
    through = scene([patch], [*filters, wall]).bake(settings)
    miss = np.array([closed_forms.planes(Falloff.STEP, q) for q in (0.1, 0.2, 0.4)])
    hit = closed_forms.planes(falloff, 0.4) - miss[2]
    out = miss[0] + red * (miss[1] - miss[0]) + red**2 * (miss[2] - miss[1])
    np.testing.assert_allclose(through.coloured[0], red**2 * green * hit + out * through.r_ave, atol=EXACT)
    if falloff is Falloff.STEP:
        np.testing.assert_allclose(through.white[0], out, atol=EXACT)
    grey, near = red.mean(), [closed_forms.planes(falloff, q) - m for q, m in zip((0.1, 0.2), miss, strict=False)]
    exact = (1 - grey) * (near[0] + grey * near[1]) + grey**2 * hit
    exact += miss[0] + grey * (miss[1] - miss[0]) + grey**2 * (miss[2] - miss[1])
    assert through.grey[0] == pytest.approx(exact, abs=EXACT)


def leaves(triangles, places):
    """A pattern that is another one on each triangle; between clear and opaque all is smooth."""
    wave = 0.5 + 0.5 * np.sin(20.0 * places[:, :1] + triangles[:, None] + np.array([0.0, 0.3, 0.6]))
    return np.clip(1.5 * wave - 0.25, 0.0, 1.0).astype(np.float32)


def foliage(seed, n=24):
    """Leaves of all directions, some crossing, some a ten-thousandth before others, with a wall and a floor."""
    rng = np.random.default_rng(seed)
    cards = []
    for _ in range(n):
        card = grid((-0.2, -0.2, 0.0), (0.4, 0, 0), (0, 0.4, 0), 2, 1, colour=rng.uniform(0.1, 0.9, 3))
        turn, place = rotation(int(rng.integers(1 << 30))), rng.uniform((-0.7, -0.7, 0.15), (0.7, 0.7, 0.6))
        card = card.moved(turn, place)
        cards += [card, card.moved(offset=1e-4 * turn[:, 2])]
    wall = grid((-1, 0.9, 0), (2, 0, 0), (0, 0, 1), colour=(0.7, 0.2, 0.2))
    return floor((-1, -1), (1, 1), 3, 3), join(cards).letting_through(0.5, leaves), wall


def along_every_ray(meshes, built, samples, n):
    """Sums (c, 8) of each cell by eq. 5 in float64: all surfaces along each ray, in the order of their distances."""
    corners = np.concatenate([m.corners() for m in meshes])
    corners = built.normalisation.apply(corners)
    owner = np.repeat(np.arange(len(meshes)), [len(m.triangles) for m in meshes])
    local = np.concatenate([np.arange(len(m.triangles)) for m in meshes])
    scene_limit, falloff = float(built.traced.limit), built.traced.falloff
    sums = np.zeros((len(built.traced.cells.patch), 8))

    def work(cells, drawn):
        origins = samples.origins(cells, drawn).astype(float)
        directions = samples.directions(cells, drawn).astype(float)
        hits = [[] for _ in origins]
        for t, c in enumerate(corners):
            edges = np.stack([c[1] - c[0], c[2] - c[0]], 1)
            for ray in range(len(origins)):
                matrix = np.column_stack([edges, -directions[ray]])
                if abs(np.linalg.det(matrix)) < 1e-14:
                    continue
                u, v, d = np.linalg.solve(matrix, origins[ray] - c[0])
                if u >= 0 and v >= 0 and u + v <= 1 and 0 < d < scene_limit:
                    hits[ray].append((d, t, u, v))
        for ray, found in enumerate(hits):
            light, total = np.ones(4), np.zeros(8)
            for d, t, u, v in sorted(found):
                m, triangle = meshes[owner[t]], local[t]
                passing = np.zeros(3)
                if m.lookup is not None:
                    passing = m.lookup(np.array([triangle]), np.array([[1 - u - v, u, v]]))[0].astype(float)
                opaque, mean = 1.0 - passing.mean(), m.opacity()[m.face[triangle]]
                colour = m.reflectance[m.face[triangle]] / mean * opaque
                total[:4] += light * closed_forms.rho(falloff, d / scene_limit) * np.append(colour, opaque)
                light = light * np.append(passing, passing.mean())
            total[4:] = light
            sums[cells[ray // n]] += total / n

    samples.run(np.arange(len(sums)), work)
    return sums


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("falloff", [Falloff.SQRT, Falloff.STEP])
def test_cut_outs_against_brute_force(falloff, seed):
    meshes, n = foliage(seed), 32
    s, settings = scene(meshes[:1], meshes[1:]), BakeSettings(2 * n, distance=0.8, falloff=falloff)
    built = build_scene(s.surfaces, s.patches, settings)
    found = gather_obscurances(built.traced, s.patches.ids, settings)
    samples = PatchSamples(built.traced.cells, s.patches.ids, np.full(9, 2 * n), settings)
    exact = along_every_ray(meshes, built, samples, n)
    exact = np.stack([np.bincount(built.traced.cells.patch, built.traced.cells.weight * c, 9) for c in exact.T], -1)
    assert found.hit[:, 3].max() > 0.1 or falloff is Falloff.STEP
    np.testing.assert_allclose(found.hit, exact[:, :4] if falloff is not Falloff.STEP else 0.0, atol=2e-4)
    np.testing.assert_allclose(found.miss, exact[:, 7], atol=2e-4)
    np.testing.assert_allclose(found.miss[:, None] + found.tint, exact[:, 4:7], atol=2e-4)


def test_brute_force_tracer_threads_and_blocks_make_no_difference():
    meshes = foliage(5, 6)
    s = scene(meshes[:1], meshes[1:])
    settings = BakeSettings(64, distance=0.8, threads=1)
    one = s.bake(settings)
    for other in (s.bake(replace(settings, threads=3)), s.bake(settings, block_rays=64)):
        for name in ("coloured", "grey", "rmse"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    slow = s.bake(settings, intersector=lambda v, t, _: BruteForceIntersector(v, t))
    np.testing.assert_allclose(slow.coloured, one.coloured, atol=1e-4)


@pytest.mark.parametrize("falloff", [Falloff.STEP, Falloff.SQRT])
def test_a_body_of_glass_is_no_solid_and_a_wall_behind_it_still_is(falloff):
    """Faces inside of a glass box count; what is hidden in a wall is hidden, whatever passes the leaves in there."""
    inside = floor((-0.2, -0.2), (0.2, 0.2), 2, 2, z=0.3)
    settings = BakeSettings(256, distance=0.6, falloff=falloff)
    glass = box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0)).coloured((0, 0, 0)).letting_through(1.0)
    front = box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))
    window = np.zeros((front.faces, 3), np.float32)
    window[0] = 1.0
    front = replace(front, transmission=window)
    assert scene([inside], [glass]).bake(settings).valid.all()
    assert scene([inside], [front]).bake(settings).valid.all()
    leaf = floor((-0.4, -0.4), (1.2, 0.4), z=0.35).letting_through(0.5)
    solid, crossing = box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0)), floor((-0.2, -0.2), (1.0, 0.2), 6, 2, z=0.3)
    is_hidden = np.zeros(crossing.faces, bool)
    is_hidden[crossing.face[crossing.vertices[crossing.triangles][..., 0].max(1) < 0.45]] = True
    for distance in (0.1, 0.6, np.inf):
        hidden = scene([crossing], [solid, leaf]).bake(replace(settings, distance=distance))
        np.testing.assert_array_equal(hidden.valid, ~is_hidden)


def test_half_hidden_behind_a_leaf():
    """A floor half under a block, with a leaf in between: as without the leaf, of which nothing shows."""
    ground = floor((-1, -1), (1, 1), 1, 1)
    block = box((0.0, -1.5, -0.5), (1.5, 1.5, 0.5))
    leaf = floor((-2, -2), (2, 2), z=0.1).coloured((0, 0, 0)).letting_through(1.0)
    for distance in (0.3, 3.0):
        settings = BakeSettings(1024, distance=distance)
        bare, with_leaf = (scene([ground], others).bake(settings) for others in ([block], [block, leaf]))
        assert bare.sums.valid[0] == pytest.approx(0.5, abs=0.01)
        np.testing.assert_allclose(with_leaf.sums.valid, bare.sums.valid, atol=1e-9)
        np.testing.assert_allclose(with_leaf.grey, bare.grey, atol=1e-6)


def test_mean_reflectance_goes_by_opaque_area():
    """Glass counts as little as it stops, also where it is hidden inside of a solid."""
    walls = room((0, 0, 0), (1, 1, 1), colour=(0.6, 0.6, 0.6))
    pane = floor((0.2, 0.2), (0.8, 0.8), z=0.5, colour=(0.2, 0.2, 0.2))
    for transmission in (0.0, 0.5, 1.0):
        opaque = 0.36 * (1.0 - transmission)
        baked = scene([walls, pane.letting_through(transmission)]).bake_all(BakeSettings(16))
        np.testing.assert_allclose(baked.r_ave, (6 * 0.6 + opaque * 0.2) / (6 + opaque), rtol=1e-6)
    block = box((0.1, 0.1, 0.4), (0.5, 0.9, 0.6), colour=(0.6, 0.6, 0.6))
    hidden = scene([walls, block, pane.letting_through(0.5)]).bake_all(BakeSettings(1024))
    np.testing.assert_allclose(hidden.r_ave, (7.12 * 0.6 + 0.09 * 0.2) / 7.21, atol=2e-4)
