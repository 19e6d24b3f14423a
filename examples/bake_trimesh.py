"""Bakes obscurances into the face colours of any mesh file that trimesh reads, without Blender.

    pip install '.[examples]'
    python examples/bake_trimesh.py MESH.obj BAKED.ply

Colours of faces or vertices are taken as reflectance, all else is light grey; out comes colour times obscurance.
"""

import sys

import numpy as np
import trimesh

from obscurance_addon.core import BakeSettings, bake_objects, mesh_object

GAMMA = 2.2  # files hold colours for a display, light adds up in linear ones

mesh = trimesh.load_mesh(sys.argv[1])  # merges equal vertices, so that closed meshes are known as solids
if mesh.visual.kind not in ("face", "vertex"):
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=[230, 230, 230])
reflectance = (mesh.visual.face_colors[:, :3] / 255.0) ** GAMMA

baked = bake_objects([mesh_object(mesh.vertices, mesh.faces, reflectance)], BakeSettings(rays=256))

shaded = np.clip(reflectance * baked.white, 0.0, 1.0) ** (1.0 / GAMMA)
mesh.visual.face_colors = np.round(255.0 * shaded).astype(np.uint8)
mesh.export(sys.argv[2])
print(f"{len(mesh.faces)} faces, {baked.rays:,} rays, estimated error {baked.white_rmse.max():.3f}")
