"""The light that leaves patches: direct light, ambient light by obscurances, and radiosity to compare with.

In go what obscurances need, the emission of materials, lamps and the world. Out comes radiance in W/(m^2 sr), with the
ambient light and an estimate of the error.
"""

from .ambient import AmbientLight
from .bake import bake_light, lit_scene
from .direct import LitScene, gather_direct_light
from .lamps import AreaLamp, Lamp, PointLamp, SpotCone, SunLamp
from .lit_faces import LitFaces, light_up_faces
from .radiosity import check_size, gather_radiosity
from .records import BakedLight, LightSources, PatchMaterials
from .redistribution import redistribute
from .settings import MAX_REFLECTORS, Ambient, LightSettings, Quantity

__all__ = [
    "MAX_REFLECTORS",
    "Ambient",
    "AmbientLight",
    "AreaLamp",
    "BakedLight",
    "Lamp",
    "LightSettings",
    "LightSources",
    "LitFaces",
    "LitScene",
    "PatchMaterials",
    "PointLamp",
    "Quantity",
    "SpotCone",
    "SunLamp",
    "bake_light",
    "check_size",
    "gather_direct_light",
    "gather_radiosity",
    "light_up_faces",
    "lit_scene",
    "redistribute",
]
