"""The add-on registered once, and an empty file for every test."""

import functools

import bpy
import pytest

import obscurance_addon
from obscurance_addon.blender.animation.live_preview import PREVIEW
from tests.blender.animation.preview_helpers import at, build_room


@functools.cache  # each folder of tests has the fixtures for itself
def _register():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    obscurance_addon.register()


@pytest.fixture(scope="session")
def registered():
    """The add-on as Blender enables it; the run ends without Blender's shutdown, so nothing unregisters it."""
    _register()


@pytest.fixture
def empty_scene(registered):
    """A file with one scene and no objects, in which the add-on's settings have their defaults."""
    # The preferences stay, so that Blender's own add-ons are not loaded anew for every test.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene


@pytest.fixture
def room(empty_scene):
    """A room open to one side, with a red wall and two blocks, by name."""
    yield build_room(empty_scene)
    PREVIEW.stop()


@pytest.fixture
def preview(room, empty_scene):
    """The room, with Live Preview on."""
    empty_scene.obscurance.live_preview = True
    at(1)
    return room
