"""A whole bake as a work order: the snapshot of a scene and settings go in, values per element come out.

In go snapshots (plain dataclasses of arrays, with nothing of Blender's in them) and settings. Out come values with a
report, computed by whoever carries the order out: this process, or a child process.
"""

from .arrays import shade
from .bake_order import BakeOrder, BakeResult
from .child_runs import SERVER, ChildRun, KeptChild
from .followers import ChildFollower, Follower, LocalFollower, make_follower
from .following import Followed, FollowOrder
from .monitor import JobMonitor
from .output import CORNER_SUFFIX, MAX_EXPOSURE, ImageFormat, OutputSettings, Scale, SharedMeshes, Target
from .report import BakeReport
from .runs import Run, ThreadRun
from .snapshot import BakedObject, Change, MeshArrays, ObjectSnapshot, SceneSnapshot

__all__ = [
    "CORNER_SUFFIX",
    "MAX_EXPOSURE",
    "SERVER",
    "BakeOrder",
    "BakeReport",
    "BakeResult",
    "BakedObject",
    "Change",
    "ChildFollower",
    "ChildRun",
    "FollowOrder",
    "Followed",
    "Follower",
    "ImageFormat",
    "JobMonitor",
    "KeptChild",
    "LocalFollower",
    "MeshArrays",
    "ObjectSnapshot",
    "OutputSettings",
    "Run",
    "Scale",
    "SceneSnapshot",
    "SharedMeshes",
    "Target",
    "ThreadRun",
    "make_follower",
    "shade",
]
