"""Shows results: 3D views that show baked colors, and materials that take baked light.

In go objects with results. Out come viewport shading and node groups, both of which can be taken back.
"""

from .ambient_nodes import add_ambient, remove_ambient, shows_ambient
from .viewport_shading import activate_result, forget_views, hide_result, lightmaps_are_shown, show_result, shows_result

__all__ = [
    "activate_result",
    "add_ambient",
    "forget_views",
    "hide_result",
    "lightmaps_are_shown",
    "remove_ambient",
    "show_result",
    "shows_ambient",
    "shows_result",
]
