"""The child process of `core.lightmap.unwrapping`: cuts meshes into flat charts and packs these.

In goes one message with the arrays of all meshes. Out come messages about each step, and at the end the places of all
faces, or why there are none.
"""
