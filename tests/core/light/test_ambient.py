"""The ambient term, secondary reflectors and radiosity: furnaces, unit-cube form factors, balances of energy."""

import numpy as np
import pytest

from obscurance_addon.core.errors import GeometryError, SettingsError
from obscurance_addon.core.light.direct import LitScene
from obscurance_addon.core.light.form_factors import triangle_form_factors
from obscurance_addon.core.light.lamps import PointLamp, SunLamp
from obscurance_addon.core.light.radiosity import (
    MAX_PATCHES,
    check_size,
    gather_form_factors,
    shoot_random_walks,
    solve_radiosity,
)
from obscurance_addon.core.light.redistribution import redistribute
from obscurance_addon.core.light.reflectors import REFLECTOR_SIZE, choose_reflectors
from obscurance_addon.core.light.settings import LightSettings
from obscurance_addon.core.obscurance.error_metrics import relative_rmse
from obscurance_addon.core.scene.patches import Patches, Surfaces
from obscurance_addon.core.scene.solids import Shells
from obscurance_addon.core.settings import BakeSettings
from obscurance_addon.core.tracing.build import build_scene
from tests.core.scenes import box, floor, grid, room, scene

E, R = np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.4, 0.3])
OPEN = BakeSettings(64, distance=1e-6)  # rho = 1 everywhere: what is near does not matter
OPPOSITE, ADJACENT = 0.19982490, 0.20004378  # form factors between the sides of a cube


def furnace(n=4):
    """A closed room that shines and scatters the same everywhere."""
    return scene([room((0, 0, 0), (1, 1.3, 0.8), n).coloured(R).shining(E)])


def lit(s, settings, **changes):
    """The parts of a light bake below `bake_light`: scene and form factors."""
    traced = build_scene(s.surfaces, s.patches, settings, whole=True).traced
    return LitScene(traced, s.patches.ids, (), None, np.zeros(3), **changes)


def over_seeds(values):
    """Mean over independent seeds, and its standard error."""
    values = np.asarray(values)
    return values.mean(0), values.std(0, ddof=1) / len(values) ** 0.5


def indirect(s, k=0, ambient="RECEIVED", settings=OPEN, **kw):
    return s.bake_light("AMBIENT", settings=settings, ambient=ambient, reflectors=k, **kw)


@pytest.mark.parametrize("bleeding", [True, False])
@pytest.mark.parametrize("ambient", ["EMISSION", "RECEIVED"])
def test_ambient_light_of_a_furnace_is_exact(ambient, bleeding):
    """R^2 E / (1 - R), for eqs. 3 and 4 exactly; from received light up to the noise of what is received."""
    baked = indirect(furnace(), ambient=ambient, settings=BakeSettings(64, distance=1e-6, use_bleeding=bleeding))
    tolerance = 1e-6 if ambient == "EMISSION" else 5e-3
    np.testing.assert_allclose(baked.radiance * np.pi, np.tile(R * R * E / (1 - R), (96, 1)), rtol=tolerance)
    expected = (E if bleeding else R * E) / (1 - R)  # eq. 4, eq. 3
    np.testing.assert_allclose(baked.ambient.intensity(), expected, rtol=tolerance)
    assert baked.ambient.openness == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("k", [1, 7, 40, 96])
def test_reflectors_neither_make_nor_lose_light(k):
    """In a closed room with rho = 1 the flux of indirect light is the same however many pass on what they receive."""
    s = furnace()
    settings = [BakeSettings(64, distance=1e-6, seed=seed) for seed in range(16)]
    baked = [indirect(s, k, settings=one) for one in settings]
    mean, error = over_seeds([s.area @ b.radiance * np.pi for b in baked])
    exact = s.area.sum() * R * R * E / (1 - R)
    assert np.all(np.abs(mean - exact) < 5.0 * error)
    assert error.max() < 0.01 * exact.min()
    assert {b.reflectors for b in baked} == {k}


def test_all_as_reflectors_have_the_light_of_their_form_factors():
    """Every patch receives U sum F = U: with all passing on, each has the furnace's light again."""
    s = furnace()
    settings = [BakeSettings(64, distance=1e-6, seed=seed) for seed in range(16)]
    mean, error = over_seeds([indirect(s, 96, settings=one).radiance * np.pi for one in settings])
    assert np.all(np.abs(mean - R * R * E / (1 - R)) < 6.0 * error)
    assert error.max() < 0.02 * mean.min()


def test_one_reflector_lights_by_the_form_factor_of_a_cube():
    """One side of a black cube passes on; the others receive F, those cut into patches on average."""
    cube = room((0, 0, 0), (1, 1, 1)).coloured((0.5, 0.5, 0.5))
    s, settings = scene([cube]), BakeSettings(1024)
    found = lit(s, settings)
    exitance = np.zeros((6, 3))
    exitance[0] = (1.0, 2.0, 0.0)
    area = np.ones(6)
    chosen = choose_reflectors(found.traced.cells, exitance, area, s.materials.reflectance, 1)
    mean, error = over_seeds(
        [redistribute(found, chosen, exitance, area, np.arange(6), settings, replicate=i).irradiance for i in range(64)]
    )
    exact = np.array([0.0, OPPOSITE, *[ADJACENT] * 4])[:, None] * exitance[0]
    assert np.all(np.abs(mean - exact) < 5.0 * error + 1e-5)
    assert error.max() < 0.02


def test_radiosity_form_factors_are_those_of_a_cube():
    """6 x 65,536 rays are within the standard deviation of as many random ones; each row adds up to 1."""
    s, settings = scene([room((0, 0, 0), (1, 1, 1))]), BakeSettings(65536)
    found = gather_form_factors(lit(s, settings), np.full(6, 65536), np.ones(6), settings)
    matrix = np.stack([found.gather(np.eye(6)[:, [i, i, i]])[:, 0] for i in range(6)], 1)
    exact = np.full((6, 6), ADJACENT)
    for i in range(6):
        exact[i, i], exact[i, i ^ 1] = 0.0, OPPOSITE
    np.testing.assert_allclose(matrix, exact, rtol=0, atol=(0.2 * 0.8 / 65536) ** 0.5)
    np.testing.assert_allclose(matrix.sum(1), 1.0, atol=1e-6)
    assert found.rays == 6 * 65536


def test_radiosity_of_a_furnace():
    """B = E / (1 - R); the indirect part is what is left without E and R E."""
    s = furnace()
    for indirect_only, exact in ((False, E / (1 - R)), (True, R * R * E / (1 - R))):
        baked = s.bake_light("RADIOSITY", settings=BakeSettings(256), indirect_only=indirect_only)
        error = np.sqrt(((baked.radiance * np.pi - exact) ** 2).mean(0))
        assert np.all(error < 1.5 * np.pi * baked.rmse)  # 96 patches tell a deviation to 7 %, the claim likewise
        assert np.all(np.pi * baked.rmse < 0.01 * exact)


def test_solver_from_emission_alone_is_exact_where_rows_are():
    """Rows of a closed room add up to 1, so that any sampled F gives B = E / (1 - R) to rounding."""
    s, settings = furnace(), BakeSettings(64)
    factors = gather_form_factors(lit(s, settings), np.full(96, 64), np.ones(96), settings)
    emission = np.tile(E, (96, 1))
    found = emission + solve_radiosity(factors, np.tile(R, (96, 1)), emission)
    np.testing.assert_allclose(found, np.tile(E / (1 - R), (96, 1)), rtol=1e-5)


def walk(s, walks, seed=0):
    reflectance, emission = s.materials.reflectance, s.materials.emission
    return shoot_random_walks(lit(s, OPEN), reflectance, emission, s.area, np.ones(len(s.area)), walks, seed)


def test_random_walk_in_a_furnace():
    """Unbiased: B - E = R E / (1 - R), mean and each patch within five standard errors."""
    s = furnace()
    found = np.array([walk(s, 20_000, seed)[0] for seed in range(16)])
    exact = R * E / (1 - R)
    mean, error = over_seeds(found)
    assert np.all(np.abs(mean - exact) < 6.5 * error)  # Student's t, 288 comparisons
    flux = np.einsum("p,spk->sk", s.area, found) / s.area.sum()
    assert np.all(np.abs(flux.mean(0) - exact) < 5.0 * flux.std(0, ddof=1) / 4.0)


def test_random_walk_counts_its_rays():
    """A black room ends every walk at the first wall."""
    s = scene([room((0, 0, 0), (1, 1, 1)).coloured((0, 0, 0)).shining(E)])
    assert walk(s, 1000)[1] == 1000


def complicated():
    """A closed room with walls of different colours, two blocks and a shining one."""
    walls = room((0, 0, 0), (1, 1, 1), 6).coloured((0.7, 0.7, 0.7))
    walls.reflectance[:36], walls.reflectance[36:72] = (0.1, 0.15, 0.7), (0.7, 0.2, 0.1)
    blocks = [box((0.2, 0.3, 0.1), (0.4, 0.5, 0.6), 2), box((0.6, 0.5, 0.2), (0.8, 0.8, 0.4), 2)]
    lamp = box((0.4, 0.4, 0.8), (0.6, 0.6, 0.85)).coloured((0.1, 0.1, 0.1)).shining(E * 10)
    return scene([walls, *blocks, lamp])


def test_energy_is_balanced():
    """What surfaces absorb is what is emitted: sum A (1 - R) H = sum A E, with H from B = E + R H."""
    s = complicated()
    whole = s.bake_light("RADIOSITY", settings=BakeSettings(1024)).radiance * np.pi
    reflectance, emission = s.materials.reflectance, s.materials.emission
    received = (whole - emission) / reflectance
    np.testing.assert_allclose(s.area @ ((1 - reflectance) * received), s.area @ emission, rtol=5e-3)


def test_random_walk_and_solver_agree():
    """The same indirect light by two methods that share only the ray tracer."""
    s = complicated()
    radiosity = s.bake_light("RADIOSITY", settings=BakeSettings(4096), indirect_only=True)
    solved = radiosity.radiance * np.pi
    direct = s.bake_light("DIRECT", settings=BakeSettings(4096)).radiance * np.pi
    scene_ = lit(s, OPEN)
    walks = [
        shoot_random_walks(scene_, s.materials.reflectance, direct, s.area, np.ones(len(s.area)), 50_000, seed)[0]
        for seed in range(8)
    ]
    flux = np.array([s.area @ w for w in walks])
    np.testing.assert_allclose(flux.mean(0), s.area @ solved, rtol=5e-3)
    difference = np.mean(walks, 0) - solved
    error = np.std(walks, 0, ddof=1) / 8**0.5
    expected = np.sqrt((error**2).mean() + ((np.pi * radiosity.rmse) ** 2).mean())
    assert np.sqrt((difference**2).mean()) < 1.3 * expected


def test_black_surfaces_scatter_nothing():
    s = scene([room((0, 0, 0), (1, 1, 1), 3).coloured((0, 0, 0))])
    baked = s.bake_light("COMBINED", [PointLamp("Lamp", [0.5, 0.5, 0.5], np.ones(3))])
    assert not baked.radiance.any()
    assert not baked.ambient.intensity().any()


def test_a_channel_without_reflectance_stays_dark():
    s = scene([room((0, 0, 0), (1, 1, 1), 3).coloured((0.5, 0.0, 0.3))])
    radiance = s.bake_light("AMBIENT", [PointLamp("Lamp", [0.5, 0.5, 0.5], np.ones(3))]).radiance
    assert not radiance[:, 1].any()
    assert radiance[:, [0, 2]].min() > 0.0


def test_light_leaves_an_open_scene_at_every_bounce():
    """A plane under the sky sees no surface, so what it scatters meets none: there is no ambient light."""
    s = scene([floor((-1, -1), (1, 1), 4, 4)])
    baked = s.bake_light("AMBIENT", [SunLamp("Sun", [0, 0, 1.0], np.ones(3))], reflectors=0)
    assert baked.ambient.openness == 1.0
    assert not baked.ambient.irradiance.any()
    assert not baked.radiance.any()


def near_a_wall(n):
    """A dark blue wall lit from 5 cm away in a white room of 2 m, its walls cut into n x n faces."""
    walls = room((0, 0, 0), (2, 2, 2), n).coloured((0.75, 0.75, 0.75))
    walls.reflectance[: n * n] = (0.08, 0.12, 0.65)
    shade = grid((0.06, 0.6, 0.6), (0, 0.8, 0), (0, 0, 0.8)).coloured((0, 0, 0))  # towards the room
    return scene([walls], [shade]), [PointLamp("Lamp", [0.05, 1.0, 1.0], np.ones(3))]


def test_the_choice_does_not_depend_on_how_fine_a_mesh_is():
    """The same part of the wall is taken, and with it most of the light, with 1,536 and with 6,144 faces."""
    shares = []
    for n in (16, 32):
        s, lamps = near_a_wall(n)
        baked = s.bake_light("AMBIENT", lamps, BakeSettings(16))
        assert 4 <= baked.reflectors <= 64
        shares.append(baked.reflected_share)
    assert min(shares) > 0.75
    assert shares[0] == pytest.approx(shares[1], abs=0.1)


def test_where_light_is_spread_out_nothing_is_redistributed_and_no_ray_cast():
    """An evenly lit room: the automatic choice equals none, to the bit and to the ray."""
    s = scene([room((0, 0, 0), (1, 1, 1), 16)])
    lamps = [PointLamp("Lamp", [0.5, 0.5, 0.5], np.ones(3))]
    automatic, none = (s.bake_light("AMBIENT", lamps, BakeSettings(16), reflectors=k) for k in (None, 0))
    assert automatic.reflectors == 0
    assert automatic.rays + automatic.error_rays == none.rays + none.error_rays
    np.testing.assert_array_equal(automatic.radiance, none.radiance)


def test_difficult_lighting():
    """Beside a wall, received light beats emitted light and reflectors beat both, judged by radiosity."""
    s, lamps = near_a_wall(12)
    reference = s.bake_light("RADIOSITY", lamps, BakeSettings(1024), indirect_only=True).radiance
    light = [{"ambient": "EMISSION", "reflectors": 0}, {"reflectors": 0}, {}, {"reflectors": 64}]
    errors = [relative_rmse(s.bake_light("AMBIENT", lamps, **k).radiance, reference, s.area) for k in light]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.6 * errors[1]
    assert errors[3] < 0.6 * errors[1]


def test_surroundings_count_whether_they_are_baked_or_not():
    """A part of a room has the same light when the rest is not selected, up to noise."""
    walls = room((0, 0, 0), (1, 1, 1), 8)
    block = box((0.3, 0.3, 0.2), (0.6, 0.6, 0.5), 3)
    lamps = [PointLamp("Lamp", [0.2, 0.2, 0.8], np.ones(3))]
    settings = [BakeSettings(64, distance=0.3, seed=seed) for seed in range(16)]
    alone, both = (
        [s.bake_light("COMBINED", lamps, one) for one in settings]
        for s in (scene([block], [walls]), scene([block, walls]))
    )
    for value in (lambda b: b.ambient.intensity(), lambda b: b.radiance[:54]):
        (one, e1), (two, e2) = over_seeds([value(b) for b in alone]), over_seeds([value(b) for b in both])
        assert np.all(np.abs(one - two) < 6.0 * np.hypot(e1, e2))
        assert np.all(np.hypot(e1, e2) < 0.05 * two)


def test_small_patches_go_together():
    """Reflectors span at most the size that is promised, and their shares are whole."""
    s, lamps = near_a_wall(32)
    direct = s.bake_light("DIRECT", lamps, BakeSettings(16)).radiance
    cells = lit(s, OPEN).traced.cells
    chosen = choose_reflectors(cells, direct, cells.area, s.materials.reflectance[: len(direct)], 40)
    assert len(chosen) == 40
    assert np.diff(chosen.start).max() > 2
    for first, end in zip(chosen.start[:-1], chosen.start[1:], strict=True):
        frames = cells.frames[chosen.cell[first:end]]
        centre = frames[:, 2, :3] + (frames[:, 0, :3] + frames[:, 1, :3]) / 3.0
        assert np.ptp(centre, axis=0).max() <= 2.0 * REFLECTOR_SIZE + 0.03  # of patches; cells reach a little farther
        assert chosen.share[first:end].sum() == pytest.approx(1.0)


def test_combined_is_direct_ambient_and_emission():
    s = complicated()
    parts = {q: s.bake_light(q, settings=BakeSettings(32)).radiance for q in ("DIRECT", "AMBIENT", "COMBINED")}
    emitted = s.materials.emission / np.pi
    np.testing.assert_allclose(parts["COMBINED"], parts["DIRECT"] + parts["AMBIENT"] + emitted, rtol=1e-12)


def test_radiosity_has_a_stated_size():
    check_size(MAX_PATCHES, MAX_PATCHES)
    with pytest.raises(GeometryError, match="bake COMBINED"):
        check_size(MAX_PATCHES + 1, 1)
    with pytest.raises(GeometryError, match="use fewer rays"):
        check_size(100, 1 << 28)


@pytest.mark.parametrize(
    "light", [{"quantity": "LIGHT"}, {"ambient": "SKY"}, {"reflectors": -1}, {"reflectors": 5000}, {"reflectors": 1.5}]
)
def test_light_settings_out_of_range(light):
    with pytest.raises(SettingsError):
        LightSettings(**light)


@pytest.mark.parametrize("n", [1, 4])
def test_openness_does_not_hang_on_a_few_large_faces(n):
    """A box above a field ten times as wide: C is the same for a field of one face and of sixteen, and over seeds."""
    field, block = floor((-5, -5), (5, 5), n, n), box((-0.5, -0.5, 0.2), (0.5, 0.5, 1.2), 4)
    lamps = [SunLamp("Sun", [0, 0, 1.0], np.ones(3))]
    found = [
        1.0 - scene([field, block]).bake_light("AMBIENT", lamps, BakeSettings(64, seed=i)).ambient.openness
        for i in range(8)
    ]
    # The field is nearly all of the area: 4,096 random rays from it would have this standard deviation.
    random = (np.mean(found) * (1.0 - np.mean(found)) / 4096) ** 0.5
    assert np.std(found, ddof=1) < random
    fine = scene([floor((-5, -5), (5, 5), 32, 32), block]).bake_light("AMBIENT", lamps, BakeSettings(64))
    assert abs(np.mean(found) - (1.0 - fine.ambient.openness)) < 5.0 * random / 8**0.5


def spread_and_claim(s, lamps, quantity, seeds=12):
    """Relative spread of the mean radiance over seeds, and what the bakes say of their error."""
    baked = [s.bake_light(quantity, lamps, BakeSettings(64, seed=i), reflectors=0) for i in range(seeds)]
    means = np.array([b.radiance.mean() for b in baked])
    claims = np.array([b.rmse.mean() for b in baked]) / means
    return means.std(ddof=1) / means.mean(), np.sqrt((claims**2).mean())


@pytest.mark.parametrize("quantity", ["AMBIENT", "COMBINED"])
def test_coarse_surroundings_are_sampled_well(quantity):
    """A small box in a room of six faces that is not baked, lit from 5 cm before a wall: spread below 3 %, and said."""
    s = scene([box((0.9, 0.9, 0.2), (1.1, 1.1, 0.4))], [room((0, 0, 0), (2, 2, 2)).coloured((0.7, 0.5, 0.3))])
    spread, claim = spread_and_claim(s, [PointLamp("Lamp", [0.05, 1.0, 1.0], np.ones(3))], quantity)
    assert spread < 0.03
    assert spread < 2.0 * claim


def test_a_bent_patch_receives_whichever_cell_comes_first():
    """Two cells at right angles: a reflector below the plane of one lies before the other."""
    up, side = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (1, 0, -1), (1, 1, 0)]
    shining = box((2.0, 0.0, -1.5), (2.2, 1.0, -0.5)).coloured((0.5, 0.5, 0.5))
    found = []
    for order in ((up, side), (side, up)):
        corners = np.array([*order, *shining.corners()], float)
        patch = np.concatenate([[0, 0], shining.face + 1])
        patches = Patches(corners, patch, np.arange(7, dtype=np.uint32))
        vertices = corners.reshape(-1, 3)
        triangles = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
        n = len(triangles)
        surfaces = Surfaces(vertices, triangles, np.full((n, 3), 0.5, np.float32), Shells.none(n))
        traced = build_scene(surfaces, patches, OPEN, whole=True).traced
        lit_scene = LitScene(traced, patches.ids, (), None, np.zeros(3))
        exitance = np.ones((7, 3))
        exitance[0] = 0.0
        chosen = choose_reflectors(traced.cells, exitance, traced.cells.area, np.full((7, 3), 0.5), 6)
        parts = [
            redistribute(lit_scene, chosen, exitance, np.ones(7), np.array([0]), OPEN, replicate=i).irradiance[0, 0]
            for i in range(32)
        ]
        found.append((np.mean(parts), np.std(parts, ddof=1) / 32**0.5))
    (one, e1), (two, e2) = found
    assert one > 0.005
    assert abs(one - two) < 5.0 * np.hypot(e1, e2)


def test_a_small_reflector_in_the_corner_of_a_large_patch_has_no_spikes():
    """It touches the receiver, whose centre is far away: exact factors serve it, not the kernel."""
    wall = grid((0, 0, 0), (0, 2, 0), (0, 0, 2)).coloured((0.5, 0.5, 0.5))
    small = grid((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)).coloured((0.5, 0.5, 0.5))
    s = scene([wall, small])
    found, exitance = lit(s, OPEN), np.array([np.zeros(3), np.ones(3)])
    chosen = choose_reflectors(found.traced.cells, exitance, s.area, s.materials.reflectance, 1)
    parts = [
        redistribute(found, chosen, exitance, np.ones(2), np.array([0]), OPEN, replicate=i).irradiance[0, 0]
        for i in range(64)
    ]
    exact = parallel_edge_factor(0.1, 2.0)
    mean, error = np.mean(parts), np.std(parts, ddof=1) / 8.0
    assert abs(mean - exact) < 5.0 * error
    assert np.std(parts, ddof=1) < 1.5 * exact


def parallel_edge_factor(a, b, n=400):
    """Form factor from a square wall of side b to a square floor of side a at its corner, by the rule of points."""
    at = (np.arange(n) + 0.5) / n
    # Graded towards the common corner, where the factor from a point is largest.
    y, z = np.meshgrid(b * at**2, b * at**2)
    weight = np.outer(2 * at, 2 * at) / n**2
    points = np.stack([np.zeros(y.size), y.ravel(), z.ravel()], -1)
    normal = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    corners = np.array([[(0, 0, 0), (a, 0, 0), (a, a, 0)], [(0, 0, 0), (a, a, 0), (0, a, 0)]], float)
    factor = sum(triangle_form_factors(points, normal, np.tile(c, (len(points), 1, 1))) for c in corners)
    return float(factor @ weight.ravel())


def test_a_large_reflector_shines_by_its_near_part():
    """A block above a field of one face and of 32 x 32, lit without shadows: the same light comes up, within 5 %."""
    block = box((-0.5, -0.5, 0.1), (0.5, 0.5, 1.1), 4)
    lamps = [SunLamp("Sun", [0.6, 0.0, 0.8], np.ones(3), casts_shadow=False)]
    found = []
    for n in (1, 32):
        s = scene([block], [floor((-4, -4), (4, 4), n, n)])
        baked = [s.bake_light("AMBIENT", lamps, BakeSettings(64, seed=i), reflectors=4096) for i in range(8)]
        found.append(over_seeds([(s.area @ b.radiance)[0] for b in baked]))
    (one, _), (two, _) = found
    assert one == pytest.approx(two, rel=0.05)  # a ratio of means of visibility, whose bias falls with its 16 samples
