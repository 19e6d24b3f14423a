"""Bakes obscurances with colour bleeding (Mendez, Sbert, Cata 2003) into meshes, as a Blender extension."""

_cli_command = None


def _parts():
    from .blender import properties
    from .ui import operators, panels

    return properties, operators, panels


def register():
    """Called by Blender when the extension is enabled."""
    global _cli_command
    import bpy

    from . import batch

    for part in _parts():
        part.register()
    _cli_command = bpy.utils.register_cli_command("obscurance", batch.main)


def unregister():
    """Undo `register`."""
    global _cli_command
    import bpy

    bpy.utils.unregister_cli_command(_cli_command)
    _cli_command = None
    for part in reversed(_parts()):
        part.unregister()
