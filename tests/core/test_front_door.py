"""The core as a library: from a mesh to its obscurances through one door."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from obscurance_addon.core import BakeSettings, GeometryError, bake_obscurances, join_objects, mesh_object

ROOT = Path(__file__).parents[2]


def baked(*objects, **settings):
    scene = join_objects(objects)
    return bake_obscurances(
        scene.surfaces,
        scene.patches,
        BakeSettings(**{"rays": 64, "distance": 1.0} | settings),
        neighbours=scene.neighbours,
        patch_reflectance=scene.patch_reflectance,
    )


def test_the_example_runs_and_shows_contact_and_colour(tmp_path):
    """The ball is darker below and redder there than above; the floor is dark below it only."""
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "bake_trimesh.py", tmp_path / "out.ply"],
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    mesh = trimesh.load(tmp_path / "out.ply", process=False)
    colour, centre = mesh.visual.face_colors[:, :3].astype(float), mesh.triangles_center
    on_ball, below, above = centre[:, 2] > -0.55, centre[:, 2] < -0.4, centre[:, 2] > 0.4
    bottom, top = (colour[on_ball & part].mean(0) for part in (below, above))
    assert (bottom[1:] < 0.7 * top[1:]).all()
    assert bottom[0] > 1.3 * bottom[1]
    far = np.linalg.norm(centre[:, :2], axis=1)
    assert (colour[~on_ball & (far > 1.6)] == 255.0).all()  # nothing is within reach
    assert colour[~on_ball & (far < 0.2), 0].max() < 255.0  # the ball hides more red than it reflects


def test_a_convex_solid_alone_is_open():
    """Its faces see nothing but the sky, exactly."""
    box = trimesh.creation.box()
    result = baked(mesh_object(box.vertices, box.faces))
    np.testing.assert_array_equal(result.grey, 1.0)
    assert result.valid.all()


def test_a_ball_around_everything_hides_it():
    """A closed solid around another: what is inside of it takes no rays."""
    inner, outer = (trimesh.creation.icosphere(subdivisions=2, radius=r) for r in (0.5, 1.0))
    result = baked(
        mesh_object(inner.vertices, inner.faces), mesh_object(outer.vertices, outer.faces, first_id=len(inner.faces))
    )
    assert not result.valid[: len(inner.faces)].any()
    assert result.valid[len(inner.faces) :].all()


@pytest.mark.parametrize(
    ("vertices", "triangles", "reflectance", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], 0.5, r"\(3, 2\)"),
        (np.zeros((3, 3)), [[0, 1, 2, 0]], 0.5, r"\(1, 4\)"),
        (np.eye(3), [[0, 1, 3]], 0.5, "vertices 0 to 3 of 3"),
        (np.eye(3), [[-1, 1, 2]], 0.5, "vertices -1 to 2 of 3"),
        (np.eye(3), [[0, 1, 2]], np.ones((2, 3)), "reflectance of 1 triangles"),
    ],
)
def test_arrays_that_make_no_mesh_are_refused(vertices, triangles, reflectance, message):
    with pytest.raises(GeometryError, match=message):
        mesh_object(vertices, triangles, reflectance)
