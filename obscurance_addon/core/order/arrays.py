"""A scene snapshot made ready for the core: surfaces, patches, and where each value goes. numpy only, any thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import GeometryError
from ..light import PatchMaterials
from ..notes import Notes
from ..scene import Patches, Shells, Surfaces, join_opacities, join_transmissions, occluding
from ..shading import DEFAULT_REFLECTANCE, FaceShading, shade_faces
from .output import Target
from .patch_parts import (
    PatchPart,
    WorldObject,
    baked_part,
    faces_with_triangles,
    other_part,
    unbaked_faces,
)
from .snapshot import ObjectSnapshot, SceneSnapshot
from .solid_meshes import snapshot_with_shells
from .traced_parts import material_slots, traced_surfaces

_RECALCULATE = "turn them (in Edit Mode, Mesh > Normals > Recalculate Outside)"
MAX_TRIANGLES = 60_000_000  # about 12 GiB in the ray tracer; instances count each time


@dataclass(frozen=True)
class ObjectRange:
    """Where the values of one object lie among the patches.

    Attributes
    ----------
    first, end : int
        Range of the object's patches.
    element_patch : ndarray, (n,) int
        Patch, counted from `first`, of each face, corner or vertex of the unmodified mesh.
    """

    first: int
    end: int
    element_patch: np.ndarray


@dataclass(frozen=True)
class BakeArrays:
    """What `core.obscurance.bake_obscurances` and `core.light.bake_light` take, and the ranges of their result.

    `materials` has area means over each patch, reflectance 0 .. 0.95: first the patches to bake, then, where light is
    needed, `others`: the faces of everything that is not baked.
    """

    surfaces: Surfaces
    patches: Patches
    others: Patches
    materials: PatchMaterials
    neighbours: tuple[np.ndarray, np.ndarray]
    ranges: list[ObjectRange]
    warnings: list[str]


def prepare_arrays(snapshot: SceneSnapshot, target: Target, needs_light: bool = False) -> BakeArrays:
    """Turn a snapshot into the arrays of a bake.

    Parameters
    ----------
    snapshot : SceneSnapshot
    target : Target
    needs_light : bool
        Cut up what is not baked into patches too.

    Raises
    ------
    GeometryError
        When the scene has more triangles than can be traced.
    """
    snapshot = snapshot_with_shells(snapshot)  # which leaves one that has them as it is
    objects = snapshot.objects()
    n_triangles = sum(len(ob.mesh.triangle_corners) for ob in objects)
    if n_triangles > MAX_TRIANGLES:
        raise GeometryError(
            f"the scene has {n_triangles:,} triangles, instances counted each time, but at most {MAX_TRIANGLES:,} "
            "can be traced: hide distant instances from renders"
        )
    notes = Notes()
    shaded: dict[tuple[int, ...], FaceShading] = {}  # instances that look the same are shaded once
    worlds = []
    for ob in objects:
        key = (id(ob.mesh), id(ob.surface), *map(id, ob.shadings))
        if key not in shaded:
            shaded[key] = shade(ob, needs_light)
        worlds.append(WorldObject.of(ob, shaded[key]))
    parts = [baked_part(baked, world, target) for baked, world in zip(snapshot.baked, worlds, strict=False)]
    for ob, world in zip(objects, worlds, strict=True):
        _note_shape(ob, world, notes)
    others, owners = [], list(range(len(parts)))  # owners: the object of each part
    for number, (ob, world) in enumerate(zip(objects, worlds, strict=True) if needs_light else ()):
        faces = unbaked_faces(ob.mesh) if number < len(parts) else faces_with_triangles(ob.mesh)
        faces &= ~world.is_absent()
        if faces.any():
            others.append(other_part(ob, world, number, faces))
            owners.append(number)
    starts = np.cumsum([0] + [len(part.ids) for part in parts])
    node_starts = np.cumsum([0] + [part.n_nodes for part in parts])
    first_patch = np.cumsum([0] + [len(part.ids) for part in [*parts, *others]])
    everything = [*parts, *others]
    surfaces = _join_surfaces(objects, worlds, [part.face_patch for part in everything], owners, first_patch)
    first_triangle = surfaces.object_starts[owners]
    return BakeArrays(
        surfaces=surfaces,
        patches=_join_patches(parts, first_triangle[: len(parts)]),
        others=_join_patches(others, first_triangle[len(parts) :]),
        materials=PatchMaterials(
            np.concatenate([part.reflectance for part in everything]),
            np.concatenate([part.emission for part in everything]),
            gives=_given(objects, owners, everything),
            opacity=join_opacities([(len(part.ids), part.opacity) for part in everything]),
        ),
        neighbours=(
            np.concatenate([part.element_patch_of_node + first for part, first in zip(parts, starts, strict=False)]),
            np.concatenate([part.node + first for part, first in zip(parts, node_starts, strict=False)]),
        ),
        ranges=[
            ObjectRange(int(first), int(first) + len(part.ids), part.element_patch)
            for part, first in zip(parts, starts, strict=False)
        ],
        warnings=notes.lines(),
    )


def _note_shape(ob: ObjectSnapshot, world: WorldObject, notes: Notes) -> None:
    """Say what is wrong with the shape of an object."""
    if not world.finite.all():
        what = "vertices have no finite position, so their faces were left out"
        notes.add(what, ob.name, cure="repair the mesh or its modifiers")
    if ob.mesh.flipped_faces:
        what = "faces look the other way than the rest of their surface, and were baked as if turned"
        notes.add(what, ob.name, cure=_RECALCULATE)
    if lost := world.flattened(ob):
        axes = ("one axis", "two axes", "all axes")[lost - 1]
        what = f"the scale of these objects, or of their parents, is 0 along {axes}, so faces have no area"
        notes.add(what, ob.name, cure="set the scale, or hide them from renders")


def shade(ob: ObjectSnapshot, needs_light: bool = False) -> FaceShading:
    """What the faces scatter, emit and let through.

    Without light, faces that shine and scatter nothing have the reflectance of a surface without a material: how much
    of the ambient light a lamp keeps away is not told by what it emits.
    """
    found = shade_faces(ob.shadings, material_slots(ob), ob.surface)
    lamps = found.emission.any(1) & ~found.reflectance.any(1)
    if not needs_light and lamps.any():
        opaque = 1.0 if found.transmission is None else 1.0 - found.transmission[lamps]
        found.reflectance[lamps] = DEFAULT_REFLECTANCE * opaque
    return found


def _given(objects: list[ObjectSnapshot], owners: list[int], parts: list[PatchPart]) -> np.ndarray | None:
    """`PatchMaterials.gives`."""
    if all(ob.gives_color for ob in objects):
        return None
    owned = zip(owners, parts, strict=True)
    return np.concatenate([np.full(len(part.ids), objects[owner].gives_color) for owner, part in owned])


def _join_patches(parts: list[PatchPart], first_triangle: np.ndarray) -> Patches:
    """The patches of parts of objects whose triangles begin at `first_triangle`."""
    if not parts:
        return Patches.none()
    shells = [np.where(part.shell > 0, part.shell + at, 0) for part, at in zip(parts, first_triangle, strict=True)]
    starts = np.cumsum([0] + [len(part.ids) for part in parts])
    return Patches(
        np.concatenate([part.cells for part in parts]),
        np.concatenate([part.patch + first for part, first in zip(parts, starts, strict=False)]),
        np.concatenate([part.ids for part in parts]),
        np.concatenate(shells).astype(np.int32),
    )


def _join_surfaces(
    objects: list[ObjectSnapshot],
    worlds: list[WorldObject],
    face_patches: list[np.ndarray],
    owners: list[int],
    first_patch: np.ndarray,
) -> Surfaces:
    """All triangles; `face_patches` tell the patch of each face of the objects named by `owners`, -1 for none."""
    scene_patch = [np.full(len(ob.mesh.face_start) - 1, -1, np.int64) for ob in objects]
    for owner, of_face, first in zip(owners, face_patches, first_patch, strict=False):
        if objects[owner].gives_color:
            scene_patch[owner][of_face >= 0] = of_face[of_face >= 0] + first
    parts = [traced_surfaces(*each) for each in zip(objects, worlds, scene_patch, strict=True)]
    vertex_starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    triangle_starts = np.cumsum([0] + [len(part.triangles) for part in parts])
    return Surfaces(
        vertices=np.concatenate([part.vertices for part in parts]),
        triangles=np.concatenate(
            [part.triangles + np.int32(first) for part, first in zip(parts, vertex_starts, strict=False)]
        ),
        reflectance=np.concatenate([part.reflectance for part in parts]),
        shells=Shells.joined([part.shells for part in parts]),
        object_starts=triangle_starts[:-1],
        emission=np.concatenate([part.emission for part in parts]),
        patch=np.concatenate([part.patch for part in parts]),
        transmission=join_transmissions([(len(part.triangles), part.transmission) for part in parts]),
        occludes=None
        if all(part.occludes is None for part in parts)
        else np.concatenate([occluding(part) for part in parts]),
    )
