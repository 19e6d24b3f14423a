"""What a scene is to the method: surfaces that rays hit, patches that receive, and the cells that rays leave from.

In go vertices, triangles and reflectances. Out come patches cut into cells, closed solids told from open sheets, the
mean reflectance, and objects joined into one scene.
"""

from .components import connected_components
from .corners import corner_cells, face_of_corner, smooth_fans
from .filling import fill_invalid
from .meshes import mesh_object
from .objects import SceneObject, join_objects, join_opacities, occluding, same_numbers
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
from .transmission import (
    LEAST_TRANSMISSION,
    Lookup,
    Transmission,
    join_transmissions,
    opacity,
)

__all__ = [
    "LEAST_TRANSMISSION",
    "LUMINANCE",
    "OFFSET",
    "Cells",
    "Lookup",
    "Normalisation",
    "Patches",
    "SceneObject",
    "Shells",
    "Surfaces",
    "Transmission",
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
    "join_opacities",
    "join_transmissions",
    "mean_of_sums",
    "mean_reflectance",
    "mesh_object",
    "occluding",
    "opacity",
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
