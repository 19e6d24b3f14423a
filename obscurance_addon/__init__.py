"""Bakes obscurances with colour bleeding (Mendez, Sbert, Cata 2003) into meshes, as a Blender extension."""

import sys

# "Reload Scripts" runs this file again and nothing else, so the rest would stay the old one. Only modules of the add-on
# itself are forgotten; `importlib.reload` of each would leave old classes in the modules that had imported them.
for _name in [name for name in sys.modules if name.startswith(f"{__name__}.")]:
    del sys.modules[_name]

_cli_command = None


def _parts():
    from .blender.animation import handlers
    from .blender.properties import scene_settings
    from .blender.writing import records
    from .ui import material_operators, operators, panels, preferences, presets, result_operators

    operator_parts = operators, result_operators, material_operators
    return scene_settings, records, preferences, *operator_parts, presets, panels, handlers


def register():
    """Called by Blender when the extension is enabled."""
    global _cli_command
    import bpy

    from .command_line import command

    for part in _parts():
        part.register()
    _cli_command = bpy.utils.register_cli_command("obscurance", command)


def unregister():
    """Undo `register`."""
    global _cli_command
    import bpy

    bpy.utils.unregister_cli_command(_cli_command)
    _cli_command = None
    for part in reversed(_parts()):
        part.unregister()
