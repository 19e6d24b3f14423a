"""The obscurance estimator: numpy and embreex only, imports and tests without Blender."""
