"""The first lines of a child process: `python -P start.py PACKAGE NAME HANDLE FOLDER MODULE`.

PACKAGE is the folder of the add-on, NAME its last name; HANDLE the end of the pipe that was inherited; FOLDER is
private to both processes. MODULE, of the core, has a function `serve(channel, folder)`.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import shutil
import sys
import tempfile
import threading
import traceback
from multiprocessing import connection
from pathlib import Path


def main(package: str, name: str, handle: int, folder: Path, module: str) -> None:
    tempfile.tempdir = str(folder)  # what this process makes goes when the folder goes
    threading.Thread(target=end_with_parent, args=(folder,), daemon=True).start()
    kind = connection.PipeConnection if sys.platform == "win32" else connection.Connection
    load_package(Path(package), name)
    channel_type = importlib.import_module(f"{name}.core.process.channel").Channel
    channel = channel_type(kind(handle), folder)
    try:
        importlib.import_module(f"{name}.core.{module}").serve(channel, folder)
        channel.poll(None)  # the parent closes its end once it has taken the last message from the folder
    except (EOFError, BrokenPipeError, ConnectionResetError):
        end(folder, 0)
    except BaseException:
        traceback.print_exc()  # which the parent reads in the folder
        sys.stderr.flush()
        os._exit(1)
    sys.stderr.flush()
    end(folder, 0)


def end_with_parent(folder: Path) -> None:
    """Wait for the pipe from the parent to close, whatever ended it, and leave nothing behind."""
    while os.read(0, 1):
        continue
    end(folder, 1)


def end(folder: Path, status: int) -> None:
    """Leave at once: the native libraries have nothing to save, and some wait for their threads at a normal exit."""
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(status)


def load_package(folder: Path, name: str) -> None:
    """Import the add-on from its folder, which need not be on the search path."""
    where = [str(folder)]
    spec = importlib.util.spec_from_file_location(name, folder / "__init__.py", submodule_search_locations=where)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # as the import system does; the folder has no place on sys.path
    spec.loader.exec_module(module)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]), sys.argv[5])
