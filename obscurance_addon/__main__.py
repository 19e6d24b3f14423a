"""`python -m obscurance_addon ...`: the same arguments as `blender --command obscurance ...`, on the bpy module."""

import os
import sys
import traceback


def _run() -> int:
    from .command_line import parse

    arguments = sys.argv[1:]
    parse(arguments)  # help and wrong usage answer at once, without loading Blender
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        print(
            f"obscurance: the bpy module does not load ({error}): pip install 'obscurance-addon[bpy]'", file=sys.stderr
        )
        return 1
    from . import register
    from .command_line import main as run

    register()
    return run(arguments)


def main() -> None:
    """Run the command line on the bpy module and leave, with its status."""
    try:
        status = _run()
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


if __name__ == "__main__":
    main()
