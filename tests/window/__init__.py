"""The installed extension in a real Blender with a window; see `cases/` for how a test looks."""
