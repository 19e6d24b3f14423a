"""The process of the command line: how it ends, and what it leaves."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

from ..core.files import PrivateFolder, let_go_of_all
from ..core.process import kill_all

INTERRUPTED = 130  # exit status, as of a shell

_temporary: list[PrivateFolder] = []


def end_on_interrupt() -> None:
    """Let Ctrl-C end this process at once, and no closed pipe ever do so.

    Python's own way, an exception, is lost wherever Blender calls Python: it prints the exception and goes on.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as of a job in the background of a script
        signal.signal(signal.SIGINT, _end)
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def _end(*_signal: object) -> NoReturn:
    """Leave nothing half-written; files that take the place of others do so in one step, at any moment."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(Exception):
        kill_all()
    with suppress(Exception):
        let_go_of_all()
    for folder in _temporary:
        folder.close()
    with suppress(OSError):  # not by a stream, which may be in the midst of something
        os.write(2, b"\nobscurance: interrupted; no file is half-written\n")
    os._exit(INTERRUPTED)


@contextmanager
def own_temporary_folder() -> Iterator[None]:
    """Have all temporary files, also those of a Blender that is imported afterwards, in a folder that goes at the end.

    If this process is killed, it goes when the next one begins.
    """
    try:
        folder = PrivateFolder()
    except OSError:  # whoever needs temporary files will say so
        yield
        return
    _temporary.append(folder)
    os.environ |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder.path))
    tempfile.tempdir = str(folder.path)
    try:
        yield
    finally:
        folder.close()
