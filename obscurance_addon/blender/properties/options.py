"""Options of properties. What may change over time without a surprise is keyable; where results go, and how, is not."""

import bpy

KEYABLE: set[str] = {"ANIMATABLE"}
FIXED: set[str] = set()
# Of paths that may begin with //; older versions take them without being told.
RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else FIXED
