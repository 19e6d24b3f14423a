"""The add-on registered once, and an empty file for every test."""

import bpy
import pytest

import obscurance_addon


@pytest.fixture(scope="session")
def registered():
    """The add-on as Blender enables it; the run ends without Blender's shutdown, so nothing unregisters it."""
    obscurance_addon.register()


@pytest.fixture
def empty_scene(registered):
    """A file with one scene and no objects, in which the add-on's settings have their defaults."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene
