"""The two scales: WHITE, in which open is 1, and PAPER, which is W itself."""

import bpy
import numpy as np
import pytest

from tests.blender.helpers import bake, baked, colors, cube, floor, sheet
from tests.blender.reading.light_helpers import diffuse

pytestmark = pytest.mark.usefixtures("empty_scene")

RED, BLUE, WHITE = (0.8, 0.0, 0.0), (0.1, 0.2, 0.6), (0.9, 0.9, 0.9)


def corner(floor_color, wall_color):
    """A floor of 4 strips of 4 x 0.5 m with a wall of 4 x 1 m on its edge; returns the floor."""
    ob = sheet("Floor", (0, 0, 0), (2, 0, 0), (0, 4, 0), 4, color=floor_color)
    sheet("Wall", (0, 0, 0), (0, 4, 0), (0, 0, 1), color=wall_color)
    return ob


def white_of(hit, miss, color, reference):
    """White where all that is hit has one color: `hit` is the mean of rho, `miss` the share of misses, (n,) each."""
    ratio = np.array(color) / reference
    return miss[:, None] + hit[:, None] * np.where(ratio < 1.0, ratio, 2.0 - np.exp(1.0 - np.maximum(ratio, 1.0)))


def luminance_of(areas, scene_colors):
    """Luminance of the mean color by area of what scatters light."""
    scene_colors = np.array(scene_colors)
    g = scene_colors @ (0.2126, 0.7152, 0.0722)
    weight = np.array(areas) * g**2 / (g**2 + 0.05**2)
    return weight @ g / weight.sum()


def test_white_relates_hits_to_the_luminance_of_the_scene():
    """Misses count 1, hits by their color over the mean luminance of 8 m2 of floor and 4 m2 of wall."""
    ob = corner(WHITE, BLUE)
    report = bake(ob, scale="PAPER")
    paper, r_ave = colors(ob), (2.0 * np.array(WHITE) + np.array(BLUE)) / 3.0
    assert report.r_ave == pytest.approx(r_ave, rel=1e-6)
    grey = baked(ob, use_bleeding=False)[:, 0]
    miss = (paper[:, 0] - BLUE[0] * grey) / (r_ave[0] - BLUE[0])
    expected = white_of(grey - miss, miss, BLUE, luminance_of((8.0, 4.0), (WHITE, BLUE)))
    assert np.allclose(baked(ob, scale="WHITE"), expected, atol=2e-6)
    assert expected[0, 0] < expected[0, 2] - 0.05  # the wall is blue


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


def test_a_channel_without_reflectance_keeps_its_misses_on_the_white_scale():
    """All materials pure red: what is near tints red, no value explodes, and a note says so."""
    ob = corner(RED, RED)
    grey = baked(ob, use_bleeding=False)[:, 0]
    report = bake(ob, scale="WHITE")
    white = colors(ob)
    miss = white[:, 1]
    assert np.allclose(white, white_of(grey - miss, miss, RED, luminance_of((8.0, 4.0), (RED, RED))), atol=2e-6)
    assert np.allclose(white[2:], 1.0, atol=1e-6)
    assert miss[0] < grey[0] - 0.05
    assert [note for note in report.warnings if "almost no green and blue" in note]


def test_a_channel_without_reflectance_is_0_on_the_paper_scale():
    """W = sum of rho R + misses x R_ave, both 0."""
    ob = corner(RED, RED)
    paper = baked(ob, scale="PAPER")
    assert (paper[:, 1:] == 0.0).all()
    assert np.allclose(paper[2:, 0], 0.8, atol=1e-6)


def test_one_colour_everywhere_is_grey_times_it():
    """With one reflectance R, PAPER is R times equation 2; with one grey, WHITE is equation 2."""
    ob = corner(BLUE, BLUE)
    grey = baked(ob, use_bleeding=False)
    assert np.allclose(baked(ob, scale="PAPER"), grey * BLUE, atol=2e-6)
    for ob in (bpy.data.objects["Floor"], bpy.data.objects["Wall"]):
        ob.data.materials.clear()
        ob.data.materials.append(diffuse("Grey", (0.3, 0.3, 0.3)))
    assert np.allclose(baked(bpy.data.objects["Floor"], scale="WHITE"), grey, atol=2e-6)


def test_the_estimated_error_is_on_the_scale_that_is_written():
    """RMSE on WHITE is that on PAPER over R_ave, where all is of one grey."""
    ob = corner(WHITE, WHITE)
    paper, white = bake(ob, scale="PAPER"), bake(ob, scale="WHITE")
    assert np.array(white.rmse) == pytest.approx(np.array(paper.rmse) / np.array(paper.r_ave), rel=1e-6)
    assert min(paper.rmse) > 0.0


def test_faces_inside_of_solids_take_no_part_in_the_mean():
    """Of a dark floor tile through the wall of a white box only the part outside darkens R_ave."""
    dark = np.array((0.1, 0.3, 0.05))
    ob = floor(color=tuple(dark))
    ob.scale = (0.2, 0.2, 1.0)
    box = cube("Box", color=WHITE)
    ob.location.x = half = max(v.co.x for v in box.data.vertices)
    report = bake(ob, box)
    walls, outside = 24.0 * half**2, 0.5 * 0.04 * sum(p.area for p in ob.data.polygons)
    expected = (walls * np.array(WHITE) + outside * dark) / (walls + outside)
    assert report.r_ave == pytest.approx(tuple(expected), rel=1e-3)
