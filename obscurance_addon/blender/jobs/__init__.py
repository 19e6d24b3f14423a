"""One bake of a scene from reading to writing, with progress and cancellation.

In go a context, objects and settings. Out come written results, and a report.
"""

from .job import TRACERS, BakeJob, BakeReport, check_destination, commit_count, is_baking, writable_objects
from .monitor import JobMonitor

__all__ = [
    "TRACERS",
    "BakeJob",
    "BakeReport",
    "JobMonitor",
    "check_destination",
    "commit_count",
    "is_baking",
    "writable_objects",
]
