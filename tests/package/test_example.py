"""The example runs as its docstring says."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from obscurance_addon import core

ROOT = Path(core.__file__).parents[2]

trimesh = pytest.importorskip("trimesh", reason="the example needs pip install '.[examples]'")
from trimesh.exchange.ply import load_ply  # noqa: E402


def test_a_box_on_a_floor_is_dark_where_they_meet(tmp_path):
    """Open faces keep their colour; faces of the floor near to the box are darker than those far from it."""
    floor = trimesh.creation.box((8, 8, 0.1)).subdivide_to_size(0.5)
    block = trimesh.creation.box((2, 2, 2)).subdivide_to_size(0.5).apply_translation((0, 0, 1.05))
    trimesh.util.concatenate([floor, block]).export(tmp_path / "mesh.obj")
    command = [sys.executable, ROOT / "examples" / "bake_trimesh.py", tmp_path / "mesh.obj", tmp_path / "baked.ply"]
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "baked.ply").open("rb") as written:  # trimesh.load_mesh would need scipy
        baked = trimesh.Trimesh(**load_ply(written), process=False)
    assert baked.visual.kind == "face"
    grey, centres = baked.visual.face_colors[:, 0].astype(int), baked.triangles_center
    assert done.stdout.startswith(f"{len(grey)} faces, ")
    upwards = (baked.face_normals[:, 2] > 0.9) & (np.abs(centres[:, 2]) < 0.1)
    gap = np.abs(centres[:, :2]).max(1) - 1.0  # to the wall of the block
    near, far = (upwards & chosen for chosen in ((gap > 0) & (gap < 0.3), gap > 2.7))
    open_faces = far | (centres[:, 2] > 2.0)  # the block is out of reach, or below
    assert (grey[open_faces] == 230).all(), "the example paints meshes without colours in 230"
    assert grey[near].max() < 230
