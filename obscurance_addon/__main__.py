"""`obscurance ...` and `python -m obscurance_addon ...`: as `blender --command obscurance ...`, on the bpy module."""

import contextlib
import os
import signal
import sys
import traceback
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and leave the process with its exit status."""
    _open_closed_streams()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)  # until the command line sets its own: numpy's import loses the exception
    try:
        status = _run(sys.argv[1:])
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 2
    except BaseException:
        from .command_line import explain

        explain(traceback.format_exc())
        status = 1
    with contextlib.suppress(Exception):
        from .command_line import flush

        flush()
    os._exit(status)  # the bpy module crashes (4.2) or hangs (4.5) at a normal exit while classes are registered


def _end(*_signal: object) -> NoReturn:
    """Leave at Ctrl-C, while there is nothing to clean up."""
    with contextlib.suppress(OSError):
        os.write(2, b"\nobscurance: interrupted\n")
    os._exit(130)


def _open_closed_streams() -> None:
    """Let standard streams that are closed lead nowhere, or the next file that is opened would be one of them."""
    for handle in range(3):
        try:
            os.fstat(handle)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free


def _run(arguments: list[str]) -> int:
    from .command_line import end_on_interrupt, own_temporary_folder, parse

    end_on_interrupt()
    parse(arguments)  # help and wrong usage answer at once, without loading Blender
    with own_temporary_folder():
        return _run_in_blender(arguments)


def _run_in_blender(arguments: list[str]) -> int:
    from .command_line import explain, main

    try:
        import bpy  # noqa: F401
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and error.name == "bpy":
            problem = "Blender's bpy module is not installed: pip install 'obscurance-addon[bpy]'"
        else:
            problem = f"Blender's bpy module does not load: {error}"
        explain(f"obscurance: {problem}\n")
        return 1
    from . import register

    register()
    return main(arguments)


if __name__ == "__main__":
    main()
