"""The method, on arrays: numpy and embreex only, imports and tests without Blender.

In go surfaces, patches and settings, or the snapshot of a scene. Out come obscurances or light per patch or texel, with
an estimate of their error.
"""
