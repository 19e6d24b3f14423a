"""The fixtures of all tests that need Blender."""

from tests.blender.fixtures import empty_scene, preview, registered, room

__all__ = ["empty_scene", "preview", "registered", "room"]
