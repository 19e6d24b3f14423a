"""Hair, hair curves and point clouds as meshes: Cycles renders them, but Blender gives no faces of them."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.notes import Notes
from ...core.order import MeshArrays
from ...core.scene import balls, thinned, tubes

MAX_TRIANGLES = 2_000_000  # of one object
_CURVE_RADIUS, _POINT_RADIUS = 0.005, 0.01  # where an attribute is missing
_TUBE_TRIANGLES, _BALL_TRIANGLES = 6, 20  # of each segment, and of each point
_FEWER = "lower their number, or expect the difference"

Strands = bpy.types.Curves | bpy.types.PointCloud


def has_strands(data: bpy.types.ID | None) -> bool:
    """Whether object data are curves of hair or points."""
    return isinstance(data, Strands)


def strands_mesh(data: Strands, name: str, notes: Notes) -> MeshArrays:
    """Curves as tubes and points as balls, in the space of their object."""
    points = _values(data, "position", "vector", 3)
    if isinstance(data, bpy.types.PointCloud):
        radius = _radius(data, _POINT_RADIUS)
        step = thinned(len(points) * _BALL_TRIANGLES, MAX_TRIANGLES)
        _note_thinned(step, name, notes)
        return _mesh(*balls(points[::step], radius[::step] * step**0.5))
    radius, start = _radius(data, _CURVE_RADIUS), np.empty(len(data.curve_offset_data), np.int32)
    data.curve_offset_data.foreach_get("value", start)
    step = thinned(len(points) * _TUBE_TRIANGLES, MAX_TRIANGLES)
    _note_thinned(step, name, notes)
    kept = np.zeros(len(start) - 1, bool)
    kept[::step] = True
    of_point, size = np.repeat(kept, np.diff(start)), np.diff(start)[kept]
    return _mesh(*tubes(points[of_point], radius[of_point] * step, np.concatenate([[0], np.cumsum(size)])))


def hair_systems(ob: bpy.types.Object) -> list[tuple[int, bpy.types.ParticleSystem]]:
    """The particle systems of an evaluated object that render as strands, with their numbers."""
    shown = {modifier.particle_system.name for modifier in ob.modifiers if _shows_hair(modifier)}
    return [(number, system) for number, system in enumerate(ob.particle_systems) if system.name in shown]


def hair_mesh(ob: bpy.types.Object, system: bpy.types.ParticleSystem, notes: Notes) -> MeshArrays:
    """Strands of a particle system as tubes, in the space of their evaluated object."""
    settings, parents, children = system.settings, len(system.particles), len(system.child_particles)
    first = parents if settings.child_type != "NONE" and children else 0  # children render in place of their parents
    strands = np.arange(first, parents + (children if first else 0))
    keys = 2**settings.display_step + 1
    step = thinned(len(strands) * (keys - 1) * _TUBE_TRIANGLES, MAX_TRIANGLES)
    strands = strands[::step]
    _note_thinned(step, ob.name, notes)
    points = [system.co_hair(ob, particle_no=i, step=k) for i in strands.tolist() for k in range(keys)]
    points = np.array(points, np.float64).reshape(-1, 3)
    matrix = np.linalg.pinv(np.array(ob.matrix_world, np.float64))
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    thickness = step * 0.5 * settings.radius_scale * _profile(settings, np.linspace(0.0, 1.0, keys))
    return _mesh(*tubes(points, np.tile(thickness, len(strands)), keys * np.arange(len(strands) + 1)))


def _shows_hair(modifier: bpy.types.Modifier) -> bool:
    if modifier.type != "PARTICLE_SYSTEM" or not modifier.show_viewport:
        return False
    settings = modifier.particle_system.settings
    return settings.type == "HAIR" and settings.render_type == "PATH"


def _profile(settings: bpy.types.ParticleSettings, along: np.ndarray) -> np.ndarray:
    """Thickness (k,) at places 0 .. 1 along a strand, as Cycles has it."""
    left = 1.0 - along
    shape = settings.shape
    left **= 1.0 + shape if shape < 0.0 else 1.0 / max(1.0 - shape, 1e-6)
    thickness = left * (settings.root_radius - settings.tip_radius) + settings.tip_radius
    if settings.use_close_tip:
        thickness[-1] = 0.0
    return thickness


def _note_thinned(step: int, name: str, notes: Notes) -> None:
    if step > 1:
        notes.add("so many strands or points that fewer and thicker ones stand for them", name, cure=_FEWER)


def _radius(data: Strands, missing: float) -> np.ndarray:
    return _values(data, "radius", "value", 1) if "radius" in data.attributes else np.full(len(data.points), missing)


def _values(data: Strands, name: str, field_name: str, width: int) -> np.ndarray:
    values = np.empty(len(data.points) * width, np.float32)
    data.attributes[name].data.foreach_get(field_name, values)
    return values.reshape(-1, width) if width > 1 else values


def _mesh(vertices: np.ndarray, triangles: np.ndarray) -> MeshArrays:
    """A mesh of triangles with the first material."""
    n = len(triangles)
    corners = np.arange(3 * n, dtype=np.int32)
    return MeshArrays(
        positions=vertices.astype(np.float32),
        corner_vertex=triangles.ravel(),
        face_start=np.append(corners[::3], np.int32(3 * n)),
        triangle_corners=corners.reshape(-1, 3),
        triangle_face=np.arange(n, dtype=np.int32),
        face_material=np.zeros(n, np.int32),
        corner_edge=np.zeros(3 * n, np.int32),
        sharp_edge=np.zeros(1, bool),
        sharp_face=np.zeros(n, bool),
    )
