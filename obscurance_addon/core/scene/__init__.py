"""What a scene is to the method: surfaces that rays hit, patches that receive, and the cells that rays leave from.

In go vertices, triangles and reflectances. Out come patches cut into cells, closed solids told from open sheets, the
mean reflectance, and objects joined into one scene.
"""

from .components import connected_components
from .corners import corner_cells, face_of_corner, smooth_fans
from .filling import fill_invalid
from .meshes import mesh_object
from .objects import SceneObject, join_objects, same_numbers
from .patches import (
    OFFSET,
    Cells,
    Normalisation,
    Patches,
    Surfaces,
    as_triangles,
    bounding_box,
    join_cells,
    prepare_cells,
    triangle_areas,
    usable_triangles,
)
from .reflectance import LUMINANCE, hidden_sums, mean_of_sums, mean_reflectance, scattering_mean, surface_sums
from .solids import Shells, find_shells, finite_or_nan
from .strands import balls, thinned, tubes

__all__ = [
    "LUMINANCE",
    "OFFSET",
    "Cells",
    "Normalisation",
    "Patches",
    "SceneObject",
    "Shells",
    "Surfaces",
    "as_triangles",
    "balls",
    "bounding_box",
    "connected_components",
    "corner_cells",
    "face_of_corner",
    "fill_invalid",
    "find_shells",
    "finite_or_nan",
    "hidden_sums",
    "join_cells",
    "join_objects",
    "mean_of_sums",
    "mean_reflectance",
    "mesh_object",
    "prepare_cells",
    "same_numbers",
    "scattering_mean",
    "smooth_fans",
    "surface_sums",
    "thinned",
    "triangle_areas",
    "tubes",
    "usable_triangles",
]
