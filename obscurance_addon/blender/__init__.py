"""Blender in and out: the only package that knows bpy, apart from the user interface and the batch command."""
