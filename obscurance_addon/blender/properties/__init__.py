"""Settings that are saved in the .blend (`Scene.obscurance`), and their choices in the interface.

In goes what the user sets. Out come the settings of the core.
"""

from . import scene_settings
from .choices import EXPORT_FORMATS
from .scene_settings import ObscuranceSettings, property_again, setting_names

__all__ = ["EXPORT_FORMATS", "ObscuranceSettings", "property_again", "scene_settings", "setting_names"]
