"""What rays meet; the only package that calls a ray tracer.

In go surfaces, cells and samples. Out come first hits, or whether there is one, with doubled faces and solids taken
care of.
"""

from .bodies import Bodies, BodyShapes
from .build import BuiltScene, Held, boxes_in_reach, build_scene, reach_of
from .cache import IntersectorCache
from .embree import EmbreeIntersector
from .first_hits import meet_doubled_faces, pass_doubled_faces, shadowed
from .intersector import MISS, Hits, Intersector
from .layers import Layer, LayeredIntersector, nothing
from .reach import SceneSize, scene_size
from .rooms import Rooms, ShellPoints, settle_rooms
from .samples import BLOCK_RAYS, TABLE_ROWS, PatchSamples, scramble_of
from .splitting import make_intersector
from .traced_scene import FAR, NEAR, TracedScene, limit_and_scale, needs_palette, palette_colours
from .transparency import LEAST_LIGHT, MAX_SURFACES, Passage, Transparency

__all__ = [
    "BLOCK_RAYS",
    "FAR",
    "LEAST_LIGHT",
    "MAX_SURFACES",
    "MISS",
    "NEAR",
    "TABLE_ROWS",
    "Bodies",
    "BodyShapes",
    "BuiltScene",
    "EmbreeIntersector",
    "Held",
    "Hits",
    "Intersector",
    "IntersectorCache",
    "Layer",
    "LayeredIntersector",
    "Passage",
    "PatchSamples",
    "Rooms",
    "SceneSize",
    "ShellPoints",
    "TracedScene",
    "Transparency",
    "boxes_in_reach",
    "build_scene",
    "limit_and_scale",
    "make_intersector",
    "meet_doubled_faces",
    "needs_palette",
    "nothing",
    "palette_colours",
    "pass_doubled_faces",
    "reach_of",
    "scene_size",
    "scramble_of",
    "settle_rooms",
    "shadowed",
]
