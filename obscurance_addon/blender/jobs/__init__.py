"""One bake of a scene from reading to writing, with progress and cancellation.

In go a context, objects and settings. Out come written results, and a report.
"""

from .job import CHILD, TRACERS, BakeJob, check_destination, commit_count, is_baking, writable_objects

__all__ = [
    "CHILD",
    "TRACERS",
    "BakeJob",
    "check_destination",
    "commit_count",
    "is_baking",
    "writable_objects",
]
