"""What the user's preferences say, or what holds where the add-on runs without being enabled, as in scripts."""

from __future__ import annotations

import bpy

ADDON = __package__.rpartition(".")[0]  # "bl_ext.<repository>.obscurance_addon" once installed
_MIB = 1 << 20


def stored_preferences() -> bpy.types.AddonPreferences | None:
    """The preferences of the add-on; None when it is not enabled as an add-on."""
    addon = bpy.context.preferences.addons.get(ADDON)
    return addon.preferences if addon else None


def preferred_threads() -> int:
    """Number of processors to use where the scene leaves it open; 0 for all of them."""
    preferences = stored_preferences()
    return preferences.threads if preferences else 0


def cache_ceiling_bytes() -> int:
    """What may be kept in memory between bakes; nothing without preferences."""
    preferences = stored_preferences()
    return preferences.cache_ceiling * _MIB if preferences else 0
