"""`obscurance ...` and `python -m obscurance_addon ...`: as `blender --command obscurance ...`, on the bpy module."""

import os
import sys
import traceback
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and leave the process with its exit status."""
    try:
        status = _run(sys.argv[1:])
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 2
    except KeyboardInterrupt:
        print("obscurance: interrupted; the file at hand was not changed", file=sys.stderr)
        status = 130
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # the bpy module crashes (4.2) or hangs (4.5) at a normal exit while classes are registered


def _run(arguments: list[str]) -> int:
    from .command_line import parse

    parse(arguments)  # help and wrong usage answer at once, without loading Blender
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and error.name == "bpy":
            problem = "Blender's bpy module is not installed: pip install 'obscurance-addon[bpy]'"
        else:
            problem = f"Blender's bpy module does not load: {error}"
        print(f"obscurance: {problem}", file=sys.stderr)
        return 1
    from . import register
    from .command_line import main

    register()
    return main(arguments)


if __name__ == "__main__":
    main()
