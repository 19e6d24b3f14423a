"""Tests that need the bpy module."""
