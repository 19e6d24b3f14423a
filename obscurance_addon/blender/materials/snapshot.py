"""Diffuse reflectance, emission and transmission per face from Blender's materials.

`snapshot_material` reads a node tree on the main thread into a `Shading`, which knows nothing of Blender;
`shade_faces` turns shadings into values per face in any thread. Nodes are understood as Cycles renders them, as far
as they say how much light a face scatters diffusely, emits and lets through. What depends on the view, the light or
the position (Fresnel, procedural textures) has no value per face: the socket that it feeds keeps its own value, and a
note says so.
"""

from __future__ import annotations

import bpy

from ...core.notes import Notes
from ...core.shading import DEFAULT_REFLECTANCE, Constant, Shading
from .nodes import Input, node_tree_of
from .textures import ImageCache
from .tree_reader import TreeReader

_DISPLACE = "use a Displace modifier instead, or set Displacement in the material's settings to Bump Only"


def snapshot_material(material: bpy.types.Material | None, notes: Notes, images: ImageCache | None = None) -> Shading:
    """Read a material into a form that any thread may evaluate. Main thread only.

    Parameters
    ----------
    material : bpy.types.Material or None
        Original or evaluated. None, as of an empty slot, gives Cycles' default grey.
    notes : Notes
        Hears what could not be read and what was assumed instead.
    images : ImageCache, optional
        Share one among all materials of a bake, so that each image is read once.

    Returns
    -------
    Shading
    """
    if material is None:
        return Shading(Constant((DEFAULT_REFLECTANCE,)))
    tree = node_tree_of(material)
    if tree is None:
        return Shading(Constant(tuple(material.diffuse_color[:3])))
    reader = TreeReader(ImageCache() if images is None else images)
    end = tree.get_output_node("CYCLES")
    if end is None:
        shading = Shading()
        reader.note("there is no Material Output node, so the surface counts as black", cure="add one")
    else:
        surface = Input(end.inputs["Surface"], None)
        is_volume_alone = surface.origin() is None and Input(end.inputs["Volume"], None).origin() is not None
        # Nothing but a volume is no surface at all, as in Cycles.
        shading = Shading(transmission=Constant((1.0,))) if is_volume_alone else reader.surface_at(surface)
        if end.inputs["Displacement"].is_linked and material.displacement_method != "BUMP":
            reader.note("surfaces are displaced in renders only, so they are baked where the mesh is", cure=_DISPLACE)
    reader.tell(notes, "in materials", material.name)
    return shading
