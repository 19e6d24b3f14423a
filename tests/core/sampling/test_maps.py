"""Maps from the square: inverse undone, density met, frames orthonormal, table as described."""

import numpy as np
import pytest

from obscurance_addon.core.sampling import maps as sampling
from obscurance_addon.core.settings import Sampler


def lattice(n: int) -> np.ndarray:
    """(n * n, 2) centres of the cells of a square lattice."""
    side = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)


def test_triangle_map_is_undone_by_its_inverse():
    u = np.random.default_rng(2).random((10000, 2))
    np.testing.assert_allclose(sampling.invert_triangle_sample(sampling.sample_triangle(u)), u, atol=1e-15)


def test_triangle_map_fills_the_triangle_uniformly():
    """The area of the image of each lattice cell is the same: the map's Jacobian is 1/2 everywhere."""
    u, h = lattice(64), 1e-4
    right, up = h * np.eye(2)
    du = sampling.sample_triangle(u + right) - sampling.sample_triangle(u)
    dv = sampling.sample_triangle(u + up) - sampling.sample_triangle(u)
    off_diagonal = np.abs(u[:, 0] - u[:, 1]) > 2 * h
    jacobian = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]) / h**2
    np.testing.assert_allclose(jacobian[off_diagonal], 0.5, rtol=1e-9)
    b = sampling.sample_triangle(u)
    assert (b >= 0.0).all()
    assert (b.sum(1) <= 1.0).all()
    assert sampling.triangle_pdf(0.25) * 0.25 == 1.0


def test_disc_map_is_uniform():
    """The mean of x^2 and of r^2 over the disc are 1/4 and 1/2; the density is 1 over its area."""
    disc = sampling.sample_disc(lattice(256))
    np.testing.assert_allclose((disc**2).mean(0), 0.25, rtol=1e-4)
    assert (np.linalg.norm(disc, axis=1) < 1.0).all()
    assert sampling.disc_pdf() * np.pi == 1.0


@pytest.mark.parametrize("cosine", [0.9999, 0.5, -0.3, -1.0])
def test_cone_map_is_uniform_by_solid_angle(cosine):
    """The cosine with the axis is uniform between the rim and 1, directions are unit vectors around the axis."""
    u = lattice(256).astype(np.float32)
    axis = np.tile(np.float32([0.6, 0.0, 0.8]), (len(u), 1))
    directions, along = sampling.sample_cone(axis, np.float32(cosine), u)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.einsum("ij,ij->i", directions, axis), along, atol=1e-6)
    np.testing.assert_allclose(directions.mean(0), axis[0] * (1.0 + cosine) / 2.0, atol=1e-4)
    np.testing.assert_allclose(np.quantile(along, [0.25, 0.5]), [1 - (1 - cosine) * q for q in (0.75, 0.5)], atol=1e-2)
    assert sampling.cone_pdf(cosine) * 2.0 * np.pi * (1.0 - cosine) == pytest.approx(1.0)


def test_hemisphere_map_is_undone_by_its_inverse():
    u = np.random.default_rng(3).random((10000, 2))
    directions = sampling.sample_cosine_hemisphere(u)
    np.testing.assert_allclose(sampling.invert_cosine_hemisphere_sample(directions), u, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)
    assert (directions[:, 2] >= 0.0).all()


def test_hemisphere_map_has_the_density_it_states():
    """Jacobian of the map: solid angle per unit of the square = 1 / pdf."""
    u, h = lattice(64), 1e-6
    inside = (np.abs(u - 0.5).max(1) < 0.49) & (np.abs(np.abs(u[:, 0] - 0.5) - np.abs(u[:, 1] - 0.5)) > 2 * h)
    u = u[inside]
    right, up = h * np.eye(2)
    at = sampling.sample_cosine_hemisphere(u)
    du = (sampling.sample_cosine_hemisphere(u + right) - sampling.sample_cosine_hemisphere(u - right)) / (2 * h)
    dv = (sampling.sample_cosine_hemisphere(u + up) - sampling.sample_cosine_hemisphere(u - up)) / (2 * h)
    solid_angle = np.linalg.norm(np.cross(du, dv), axis=1)
    np.testing.assert_allclose(solid_angle * sampling.cosine_hemisphere_pdf(at[:, 2]), 1.0, rtol=1e-5)


def test_hemisphere_moments():
    """Means of x, y, z and z^2 under cos/pi: 0, 0, 2/3, 1/2; the lattice leaves h^1.5 = 9e-5 at the horizon's root."""
    d = sampling.sample_cosine_hemisphere(lattice(512))
    np.testing.assert_allclose(d.mean(0), [0.0, 0.0, 2.0 / 3.0], atol=512**-1.5)
    assert (d[:, 2] ** 2).mean() == pytest.approx(0.5, abs=1e-5)


def test_hemisphere_map_at_the_centre_and_edges_of_the_square():
    d = sampling.sample_cosine_hemisphere(np.array([[0.5, 0.5], [1.0, 0.5], [0.5, 0.0], [0.0, 0.0]]))
    expected = [[0, 0, 1], [1, 0, 0], [0, -1, 0], [-(0.5**0.5), -(0.5**0.5), 0]]
    np.testing.assert_allclose(d, expected, atol=1e-15)


def test_frames_are_right_handed_and_orthonormal():
    normals = np.random.default_rng(4).normal(size=(5000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    special = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 1, -0.0], [1e-9, 0, -1], [1e-9, 0, 1]])
    normals = np.concatenate([normals, special])
    frames = sampling.orthonormal_frames(normals)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(normals), 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-14)
    np.testing.assert_array_equal(frames[:, 2], normals)


@pytest.mark.parametrize("sampler", list(Sampler))
def test_samples_of_other_scrambles_and_seeds_differ(sampler):
    table = sampling.ray_table(sampler, 5, np.array([0, 1, 255]), 0, 64)
    assert table.shape == (5, 3, 64)
    assert table.dtype == np.float32
    np.testing.assert_array_equal(table, sampling.ray_table(sampler, 5, np.array([0, 1, 255]), 0, 64))
    np.testing.assert_array_equal(table[:, 1:2], sampling.ray_table(sampler, 5, np.array([1]), 0, 64))
    other = sampling.ray_table(sampler, 6, np.array([0, 1, 255]), 0, 64)
    rays = np.concatenate([table, other], 1).reshape(5, -1)
    assert len(np.unique(rays, axis=1).T) == 6 * 64


def test_sobol_table_of_a_range_continues_the_sequence():
    whole = sampling.ray_table(Sampler.SOBOL, 5, np.arange(3), 0, 96)
    np.testing.assert_array_equal(sampling.ray_table(Sampler.SOBOL, 5, np.arange(3), 32, 64), whole[..., 32:])


def test_directions_may_take_the_dimensions_of_places():
    """The same points of the unit square, for one or for the other."""
    places, favoured = (
        sampling.ray_table(Sampler.SOBOL, 5, np.arange(3), 0, 64, sampling.UNIT, False, favours)
        for favours in (False, True)
    )
    np.testing.assert_array_equal(favoured, places[[2, 3, 0, 1]])


def test_random_passes_do_not_repeat():
    one, two = (sampling.ray_table(Sampler.RANDOM, 5, np.arange(3), first, 1024) for first in (0, 1024))
    assert not np.isin(one[0], two[0]).all(1).any()
    assert abs(np.corrcoef(one[0].ravel(), two[0].ravel())[0, 1]) < 5.0 / np.sqrt(3 * 1024)
