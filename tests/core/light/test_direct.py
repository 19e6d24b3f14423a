"""Direct light against closed forms: lamps over planes, shining polygons, the world, shadows, insides of solids."""

from dataclasses import replace

import numpy as np
import pytest

from obscurance_addon.core.light.form_factors import triangle_form_factors
from obscurance_addon.core.light.lamps import AreaLamp, PointLamp, SpotCone, SunLamp
from obscurance_addon.core.settings import BakeSettings, Sampler
from tests.core.scenes import box, floor, grid, room, scene

ONE = np.ones(3)
WHITE = (1.0, 1.0, 1.0)
DOWN = np.array([0.0, 0.0, -1.0])
SEEDS, SIGMAS, ROUNDING = 8, 6.0, 2e-5  # Student's t with 7 degrees of freedom: 6 once in 2,000


def plane(n=8):
    return floor((-1, -1), (1, 1), n, n).coloured(WHITE)


def points(n=8, per_side=48):
    """Midpoints of per_side^2 squares in each face of `plane`, (f, s, 3)."""
    at = (np.arange(n * per_side) + 0.5) / (n * per_side) * 2.0 - 1.0
    x, y = np.meshgrid(at, at)
    place = np.stack([x, y, np.zeros_like(x)], -1).reshape(n, per_side, n, per_side, 3)
    return place.transpose(0, 2, 1, 3, 4).reshape(n * n, -1, 3)


def irradiance(s, lamps=(), rays=256, **kw):
    """Mean over seeds of the irradiance on faces of white (f, 3), and its standard error."""
    values = [s.bake_light("DIRECT", lamps, BakeSettings(rays, seed=i), **kw).radiance * np.pi for i in range(SEEDS)]
    return np.mean(values, 0), np.std(values, 0, ddof=1) / SEEDS**0.5


def agrees(found, exact, relative=0.0):
    """Within the standard error, and what the quadrature of the exact value or rounding leaves."""
    mean, error = found
    exact = np.broadcast_to(np.asarray(exact, float).reshape(len(exact), -1), mean.shape)
    return bool(np.all(np.abs(mean - exact) <= SIGMAS * error + ROUNDING + (ROUNDING + relative) * exact))


def of_point(position, place):
    """Irradiance of a point of intensity 1 on the plane z = 0."""
    square = ((position - place) ** 2).sum(-1)
    return position[2] / square**1.5


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.3])
def test_point_and_ball_over_a_plane(radius):
    """A ball above the horizon lights a surface as a point in its centre does."""
    position = np.array([0.2, -0.1, 0.6])
    found = irradiance(scene([plane()]), [PointLamp("Point", position, [1.0, 2.0, 0.0], radius)])
    exact = of_point(position, points()).mean(1)
    assert agrees(found, exact[:, None] * [1.0, 2.0, 0.0], 2e-4)


def test_disc_that_turns_towards_the_surface():
    """Soft falloff: below the lamp, intensity / (d^2 + r^2)."""
    spot = floor((-0.001, -0.001), (0.001, 0.001)).coloured(WHITE)
    far = floor((5, 5), (6, 6))
    found = irradiance(scene([spot, far]), [PointLamp("Soft", [0.0, 0.0, 0.5], ONE, 0.4, is_disc=True)], rays=1024)
    assert found[0][0] == pytest.approx(1.0 / (0.25 + 0.16), rel=1e-3)


@pytest.mark.parametrize("blend", [0.0, 0.3, 1.0])
def test_spot(blend):
    """Intensity x smoothstep of the cosine within the cone, in the lamp's own frame."""
    frame = np.array([(0.6, 0.8, 0.0), (0.8, -0.6, 0.0), DOWN])
    position, cosine = np.array([0.1, 0.0, 0.8]), np.cos(0.6)
    lamp = PointLamp("Spot", position, ONE, 0.0, SpotCone(frame, cosine, blend))
    place = points(per_side=96)
    along = position[2] / np.linalg.norm(position - place, axis=-1)
    t = np.clip((along - cosine) / max((1.0 - cosine) * blend, 1e-6), 0.0, 1.0)
    exact = (of_point(position, place) * t * t * (3.0 - 2.0 * t)).mean(1)
    assert agrees(irradiance(scene([plane()]), [lamp], 1024), exact, 5e-3 if blend == 0.0 else 1e-3)
    assert exact.min() == 0.0


def test_flux_of_lamps():
    """What arrives on all walls of a black room is what each lamp emits."""
    black = room((-1, -1, -1), (1, 1, 1), 6).coloured(WHITE)
    s = scene([black])
    cone = SpotCone(np.array([(1, 0, 0), (0, -1, 0), (0, 0, -1.0)]), np.cos(0.7), 0.4)
    half = (np.array([0.2, 0, 0]), np.array([0, 0.1, 0]))
    for lamp in (
        PointLamp("Point", [0.1, 0.2, 0.3], ONE),
        PointLamp("Ball", [0.1, 0.2, 0.3], ONE, 0.2),
        PointLamp("Spot", [0.1, 0.2, 0.3], ONE, 0.0, cone),
        AreaLamp("Area", [0.1, 0.2, 0.3], *half, DOWN, ONE),
        AreaLamp("Disc", [0.1, 0.2, 0.3], *half, DOWN, ONE, is_ellipse=True),
        AreaLamp("Beam", [0.1, 0.2, 0.3], *half, DOWN, ONE, half_spread=0.5),
    ):
        mean, _ = irradiance(s, [lamp])
        assert s.area @ mean == pytest.approx(lamp.flux(), rel=2e-3), lamp.name


@pytest.mark.parametrize("half_angle", [0.0, 0.01, 0.4, np.pi / 2])
def test_sun(half_angle):
    """E cos(theta), whatever its size, as long as it is above the horizon; half of it lies below at a slant."""
    direction = np.array([0.6, 0.0, 0.8]) if half_angle < 0.5 else np.array([0.0, 0.0, 1.0])
    found = irradiance(scene([plane()]), [SunLamp("Sun", direction, [3.0, 2.0, 1.0], half_angle)])
    assert agrees(found, np.tile(direction[2] * np.array([3.0, 2.0, 1.0]), (64, 1)), 1e-6)


def of_polygon(triangles, place):
    """Lambert's formula: irradiance / radiance / pi at points (n, 3) of the plane z = 0 from triangles."""
    normal = np.tile([0.0, 0.0, 1.0], (len(place), 1))
    return sum(triangle_form_factors(place, normal, np.tile(t, (len(place), 1, 1))) for t in triangles)


def test_rectangle_and_shining_faces_agree_with_lamberts_formula():
    """An area lamp, and an emissive quad cut into 6 faces, of radiance 1."""
    centre, x, y = np.array([0.3, 0.2, 0.35]), np.array([0.3, 0.0, 0.0]), np.array([0.0, 0.2, 0.0])
    quad = np.array([centre - x - y, centre - x + y, centre + x + y, centre + x - y])
    place = points(per_side=24)
    exact = of_polygon(quad[[[0, 1, 2], [0, 2, 3]]], place.reshape(-1, 3)).reshape(64, -1).mean(1) * np.pi
    assert agrees(irradiance(scene([plane()]), [AreaLamp("Area", centre, x, y, DOWN, ONE)]), exact, 1e-3)
    shining = grid(quad[0], quad[1] - quad[0], quad[3] - quad[0], 3, 2).coloured((0, 0, 0)).shining(np.pi * ONE)
    assert agrees(irradiance(scene([plane()], [shining]), rays=1024), exact, 1e-3)


def test_open_sheets_shine_to_both_sides_and_solids_outwards():
    sheet = grid((-0.2, -0.2, 0.4), (0.4, 0, 0), (0, 0.4, 0)).coloured((0, 0, 0)).shining(ONE)
    (up, error), (down, other) = (irradiance(scene([plane(2)], [s])) for s in (sheet, sheet.flipped()))
    assert np.all(np.abs(up - down) < SIGMAS * np.hypot(error, other))
    assert up.min() > 100.0 * error.max()
    around = box((-2, -2, -2), (2, 2, 2)).shining(ONE)  # a room of the plane, which its outer side does not light
    inside = scene([plane(2)], [around]).bake_light("DIRECT")
    assert inside.valid.all()
    assert not inside.radiance.any()


def test_ellipse_far_above_is_a_quarter_pi_of_its_rectangle():
    x, y, place = np.array([0.02, 0, 0]), np.array([0, 0.01, 0]), [0.0, 0.0, 2.0]
    rectangle, ellipse = (
        irradiance(scene([plane(2)]), [AreaLamp("Area", place, x, y, DOWN, ONE, is_ellipse=e)])[0] for e in (0, 1)
    )
    np.testing.assert_allclose(ellipse, rectangle * np.pi / 4.0, rtol=1e-3)


def test_world_fills_what_nothing_covers():
    """An open plane receives pi L; beside a wall, the open share of the hemisphere: half at the foot of a high wall."""
    np.testing.assert_allclose(irradiance(scene([plane(2)]), world=(1.0, 0.5, 0.0))[0][0], [np.pi, np.pi / 2, 0], 1e-6)
    wall = grid((0, -500, 0), (0, 1000, 0), (0, 0, 1000)).coloured((0, 0, 0))
    strip = floor((0, -1), (1e-4, 1)).coloured(WHITE)
    mean, error = irradiance(scene([strip], [wall]), world=ONE)
    assert np.abs(mean - np.pi / 2).max() < SIGMAS * error.max() + 2e-3


def test_shadow_of_a_point():
    """A blocker half way casts one twice its size, and nothing else changes."""
    blocker = floor((-0.125, -0.125), (0.125, 0.125), z=0.5)
    lamp = PointLamp("Point", [0.0, 0.0, 1.0], ONE)
    lit, shaded = (scene([plane()], others).bake_light("DIRECT", [lamp]).radiance[:, 0] for others in ((), [blocker]))
    dark = np.abs(points().mean(1)[:, :2]).max(1) < 0.25
    assert np.count_nonzero(dark) == 4
    assert not shaded[dark].any()
    np.testing.assert_array_equal(shaded[~dark], lit[~dark])
    without = replace(lamp, casts_shadow=False)
    np.testing.assert_array_equal(scene([plane()], [blocker]).bake_light("DIRECT", [without]).radiance[:, 0], lit)


def test_a_patch_half_under_a_crate_has_the_light_of_its_open_half():
    """Under a lamp straight above and infinitely far, the covered half neither darkens nor counts."""
    s = scene([floor((-1, -1), (1, 1), 1, 1).coloured(WHITE)], [box((0, -2, -0.5), (3, 2, 0.5))])
    sun = SunLamp("Sun", [0.0, 0.0, 1.0], ONE)
    assert s.bake_light("DIRECT", [sun], BakeSettings(64)).radiance * np.pi == pytest.approx(1.0, rel=1e-6)


def test_a_lamp_inside_of_a_wall_is_named():
    s = scene([plane(2)], [box((-0.2, -0.2, 0.2), (0.2, 0.2, 0.6))])
    baked = s.bake_light("DIRECT", [PointLamp("Buried", [0.0, 0.0, 0.4], ONE), SunLamp("Sun", [0, 0, 1.0], ONE)])
    assert [w for w in baked.warnings if "'Buried'" in w and "move it out" in w]
    assert not [w for w in baked.warnings if "Sun" in w]


def test_nothing_that_shines_is_black_and_said():
    baked = scene([plane(2)]).bake_light("DIRECT")
    assert not baked.radiance.any()
    assert [w for w in baked.warnings if "nothing shines" in w]


def test_embree_and_brute_force_agree():
    s = scene([plane(2)], [box((-0.3, -0.2, 0.1), (0.2, 0.3, 0.4)), grid((0.5, 0, 0.2), (0, 0.2, 0), (0, 0, 0.2))])
    s = replace(s, surfaces=replace(s.surfaces, emission=s.surfaces.emission + np.float32(0.5)))
    lamps = [PointLamp("Point", [0.5, 0.5, 1.0], ONE, 0.1), SunLamp("Sun", [0.6, 0.0, 0.8], ONE, 0.1)]
    found, reference = (
        s.bake_light("DIRECT", lamps, BakeSettings(32), world=(0.1, 0.2, 0.3), brute=brute) for brute in (False, True)
    )
    np.testing.assert_allclose(found.radiance, reference.radiance, rtol=1e-4)


def test_threads_and_blocks_do_not_show():
    s = scene([plane()], [box((-0.3, -0.2, 0.1), (0.2, 0.3, 0.4)).shining(ONE)])
    lamps = [PointLamp("Point", [0.5, 0.5, 1.0], ONE, 0.1)]
    for quantity in ("DIRECT", "COMBINED", "RADIOSITY"):
        light = {"reflectors": 8} if quantity == "COMBINED" else {}
        one, two = (s.bake_light(quantity, lamps, BakeSettings(32, threads=t), **light).radiance for t in (1, 3))
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("sampler", Sampler)
def test_estimated_error_is_the_error(sampler):
    """Within a third, on soft shadows."""
    s = scene([plane(24)], [box((-0.3, -0.2, 0.1), (0.2, 0.3, 0.4))])
    lamps = [AreaLamp("Area", [0.5, 0.2, 0.8], np.array([0.2, 0, 0]), np.array([0, 0.2, 0]), DOWN, ONE)]
    reference = s.bake_light("DIRECT", lamps, BakeSettings(8192, seed=5)).radiance
    baked = s.bake_light("DIRECT", lamps, BakeSettings(16, sampler=sampler))
    error = np.sqrt(((baked.radiance - reference) ** 2).mean(0))
    np.testing.assert_allclose(baked.rmse, error, rtol=0.33)


def test_scale_and_place_do_not_matter():
    """The same scene a thousand times as large and far away, with a thousand squared times the intensity."""
    blocker = box((-0.3, -0.2, 0.1), (0.2, 0.3, 0.4))
    lamp = PointLamp("Point", np.array([0.5, 0.5, 1.0]), ONE, 0.1)
    small = scene([plane()], [blocker]).bake_light("DIRECT", [lamp])
    away = np.array([3e4, -1e4, 5e3])
    large = replace(lamp, position=1e3 * lamp.position + away, intensity=1e6 * ONE, radius=100.0)
    moved = scene([plane().moved(1e3, away)], [blocker.moved(1e3, away)]).bake_light("DIRECT", [large])
    np.testing.assert_allclose(moved.radiance, small.radiance, rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize("shadow", [True, False])
def test_samples_inside_of_solids_receive_nothing(shadow):
    """A floor 95 % of which lies under a crate: a lamp within it lights nothing, one without shadow the open part."""
    strip = floor((0, 0), (2, 1), 1, 1).coloured(WHITE)
    s = scene([strip], [box((0.1, -1, -0.5), (3, 2, 1.0))])
    sun = SunLamp("Sun", [0.0, 0.0, 1.0], ONE, casts_shadow=shadow)
    assert s.bake_light("DIRECT", [sun], BakeSettings(1024)).radiance * np.pi == pytest.approx(1.0, rel=1e-6)
    within = PointLamp("Within", [1.0, 0.5, 0.5], ONE)
    baked = s.bake_light("DIRECT", [within], BakeSettings(1024))
    assert not baked.radiance.any()
    assert [w for w in baked.warnings if "'Within'" in w]


def test_ambient_from_emission_has_no_sun_and_says_so():
    baked = scene([plane(2)]).bake_light("AMBIENT", [SunLamp("Sun", [0, 0, 1.0], ONE)], ambient="EMISSION")
    assert not baked.radiance.any()
    assert [w for w in baked.warnings if "use ambient light RECEIVED" in w]
