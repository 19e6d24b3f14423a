"""The two scales: WHITE, in which open is 1, and PAPER, which is W itself."""

import bpy
import numpy as np
import pytest

from tests.blender.helpers import bake, baked, colors, cube, floor, sheet

pytestmark = pytest.mark.usefixtures("empty_scene")

RED, BLUE, WHITE = (0.8, 0.0, 0.0), (0.1, 0.2, 0.6), (0.9, 0.9, 0.9)


def corner(floor_color, wall_color):
    """A floor of 4 strips of 4 x 0.5 m with a wall of 4 x 1 m on its edge; returns the floor."""
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4, color=floor_color)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=wall_color)
    return ob


def test_white_is_paper_over_mean_reflectance():
    """Per channel, with R_ave the mean by area over all surfaces: 8 m2 of floor and 4 m2 of wall."""
    ob = corner(WHITE, BLUE)
    paper = baked(ob, scale="PAPER")
    report = bake(ob, scale="WHITE")
    r_ave = (2.0 * np.array(WHITE) + np.array(BLUE)) / 3.0
    assert report.r_ave == pytest.approx(r_ave, rel=1e-6)
    assert np.allclose(colors(ob), paper / r_ave, rtol=1e-6)
    assert paper[0, 0] < paper[0, 2]  # the wall is blue


def test_open_faces_are_white_or_the_mean_reflectance():
    """Beyond the reach of the wall every ray misses."""
    ob = corner(WHITE, BLUE)
    assert np.allclose(baked(ob, scale="WHITE")[2:], 1.0, atol=1e-6)
    r_ave = (2.0 * np.array(WHITE) + np.array(BLUE)) / 3.0
    assert np.allclose(baked(ob, scale="PAPER")[2:], r_ave, atol=1e-6)


def test_without_bleeding_both_scales_are_equation_2():
    """Grey, equal bit for bit, whatever the scale and the materials."""
    ob = corner(WHITE, BLUE)
    white = baked(ob, use_bleeding=False, scale="WHITE")
    paper = baked(ob, use_bleeding=False, scale="PAPER")
    assert np.array_equal(white, paper)
    assert np.array_equal(white[:, 0], white[:, 1])
    assert np.array_equal(white[:, 0], white[:, 2])
    for name in ("Floor", "Wall"):
        bpy.data.objects[name].data.materials.clear()
    assert np.array_equal(baked(ob, use_bleeding=False), white)


def test_a_channel_without_reflectance_stores_equation_2_on_the_white_scale():
    """All materials pure red: red is W / R_ave as ever, green and blue are grey obscurances instead of 0 / 0."""
    ob = corner(RED, RED)
    grey = baked(ob, use_bleeding=False)
    white = baked(ob, scale="WHITE")
    assert np.allclose(white[:, 1:], grey[:, 1:], atol=1e-6)
    assert np.allclose(white[2:, 0], 1.0, atol=1e-6)
    assert grey[0, 0] < 0.95


def test_a_channel_without_reflectance_is_0_on_the_paper_scale():
    """W = sum of rho R + misses x R_ave, both 0."""
    ob = corner(RED, RED)
    paper = baked(ob, scale="PAPER")
    assert (paper[:, 1:] == 0.0).all()
    assert np.allclose(paper[2:, 0], 0.8, atol=1e-6)


def test_one_colour_everywhere_is_grey_times_it():
    """With one reflectance R, PAPER is R times equation 2, so WHITE is equation 2."""
    ob = corner(BLUE, BLUE)
    grey = baked(ob, use_bleeding=False)
    assert np.allclose(baked(ob, scale="WHITE"), grey, atol=2e-6)
    assert np.allclose(baked(ob, scale="PAPER"), grey * BLUE, atol=2e-6)


def test_the_estimated_error_is_on_the_scale_that_is_written():
    """RMSE on WHITE is that on PAPER over R_ave."""
    ob = corner(WHITE, BLUE)
    paper, white = bake(ob, scale="PAPER"), bake(ob, scale="WHITE")
    assert np.array(white.rmse) == pytest.approx(np.array(paper.rmse) / np.array(paper.r_ave), rel=1e-6)
    assert min(paper.rmse) > 0.0


def test_faces_inside_of_solids_take_no_part_in_the_mean():
    """A dark floor tile wholly inside of a white box does not darken R_ave, and its value is no obscurance of 0."""
    ob = floor(color=(0.1, 0.3, 0.05))
    ob.scale = (0.2, 0.2, 1.0)
    box = cube("Box", color=WHITE)
    report = bake(ob, box)
    assert report.r_ave == pytest.approx(WHITE, rel=1e-6)
    assert np.allclose(colors(ob), 1.0, atol=1e-6)
