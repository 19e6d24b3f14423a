"""Blender's side of a bake: reads scenes, writes results, and keeps results up to date; it holds no rendering logic.

In go Blender's context, objects and settings. Out come results in the .blend.
"""
