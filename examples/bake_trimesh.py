"""Bakes obscurances onto a mesh of trimesh, without Blender: python examples/bake_trimesh.py OUT.ply

An icosphere hangs over a red floor; what comes out are the colours of all faces.
"""

import sys

import numpy as np
import trimesh

from obscurance_addon.core import BakeSettings, bake_obscurances, join_objects, mesh_object

ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
floor = trimesh.Trimesh([[-2, -2, -0.6], [2, -2, -0.6], [2, 2, -0.6], [-2, 2, -0.6]], [[0, 1, 2], [0, 2, 3]])
floor = floor.subdivide_to_size(0.1)
red, white = [0.7, 0.1, 0.1], [0.8, 0.8, 0.8]

scene = join_objects(
    [
        mesh_object(ball.vertices, ball.faces, white),
        mesh_object(floor.vertices, floor.faces, red, first_id=len(ball.faces)),
    ]
)
baked = bake_obscurances(
    scene.surfaces,
    scene.patches,
    BakeSettings(rays=64, distance=1.0),
    neighbours=scene.neighbours,
    patch_reflectance=scene.patch_reflectance,
)

mesh = trimesh.util.concatenate([ball, floor])
mesh.visual.face_colors = np.clip(255.0 * baked.white(), 0.0, 255.0).astype(np.uint8)
mesh.export(sys.argv[1])
print(f"{len(mesh.faces):,} faces, estimated error {baked.white_rmse().max():.2g}")
