"""Operators, panels and preferences: gather input, call one function, report; no rendering logic.

In goes what the user clicks and selects, with the settings of the scene. Out come calls of Blender's side, and its
reports and errors as Blender shows them.
"""

from . import material_operators, operators, panels, preferences, presets, result_operators

__all__ = ["material_operators", "operators", "panels", "preferences", "presets", "result_operators"]
