"""Obscurances of a scene that changes: those of a full bake, for the rays of what the change can reach.

In go objects by key, then those that changed. Out come the values of the patches that a change has influence on.
"""

from .incremental import IncrementalBake
from .list_bake import ListBake
from .results import Update, UpdateMode

__all__ = ["IncrementalBake", "ListBake", "Update", "UpdateMode"]
