"""The parent's side of a child process: starts it, talks to it, and tells how it ended."""

from __future__ import annotations

import logging
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO

from ..errors import BackendError
from .channel import Channel
from .page import ProgressPage

try:
    import fcntl
except ImportError:  # Windows, whose system cleans up temporary files
    fcntl = None

_PREFIX, _OWNER = "obscurance-", "owner"
_START = Path(__file__).with_name("start.py")
_PACKAGE_FOLDER = Path(__file__).parents[2]

_log = logging.getLogger(__name__)


class ChildEndedError(BackendError):
    """A child process ended, or could not be started; the message says how."""


class ChildProcess:
    """A process that serves one module of the core until `end`, or until this process ends, however it does.

    Parameters
    ----------
    module : str
        Below `core`, with a function `serve(channel, folder)`.

    Attributes
    ----------
    folder : Path
        Private to both; gone afterwards.
    page : ProgressPage
        That it may write.
    answered : bool
        Whether it ever sent anything.

    Raises
    ------
    ChildEndedError
        When the system does not start it.
    """

    def __init__(self, module: str) -> None:
        self.answered = False
        made: list[Callable[[], None]] = []  # what is to be undone
        try:
            _sweep()
            self.folder, self._owned = _new_folder(made)
            self.page = ProgressPage(self.folder)
            made.append(self.page.close)
            ours, theirs = multiprocessing.Pipe()
            made.append(ours.close)
            with theirs, open(self.folder / "printed", "wb") as printed:
                self._process = _popen(theirs.fileno(), self.folder, module, printed)
        except OSError as error:
            for undo in reversed(made):
                undo()
            raise ChildEndedError(f"the system does not start it ({error})") from error
        self._channel = Channel(ours, self.folder)

    @property
    def pid(self) -> int:
        return self._process.pid

    def is_alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def send(self, message: object, keep: Iterable[object] | None = None) -> None:
        """As of `Channel.send`; raises ChildEndedError where there is no one to receive."""
        try:
            self._channel.send(message, keep)
        except (OSError, ValueError) as error:
            raise self._ended() from error

    def poll(self, seconds: float) -> bool:
        """Wait so long for a message; True also where it has ended."""
        try:
            return self._channel.poll(seconds)
        except (OSError, EOFError):
            return True

    def receive(self) -> object:
        """The next message; waits for it. Raises ChildEndedError where none can come any more."""
        try:
            message = self._channel.receive()
        except (EOFError, OSError) as error:
            raise self._ended() from error
        self.answered = True
        return message

    def end(self) -> None:
        """End it at once, and remove what it left; harmless when it has ended."""
        self._process.kill()
        self._process.wait()
        self._process.stdin.close()
        self._channel.close()
        self.page.close()
        if self._owned is not None:
            self._owned.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def printed(self) -> list[str]:
        """Lines that it or its libraries printed."""
        try:
            return (self.folder / "printed").read_text(errors="replace").strip().splitlines()
        except OSError:
            return []

    def _ended(self) -> ChildEndedError:
        """Why it ended, as an error to raise."""
        try:
            code = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            return ChildEndedError("it does not answer any more")
        said = self.printed()
        if said:
            _log.warning("a child process said: %s", "\n".join(said))
        if code < 0:
            name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
            why = ", as systems do when memory runs out" if name == "SIGKILL" else ""
            return ChildEndedError(f"it was ended by signal {-code} ({name}{why})")
        return ChildEndedError(said[-1] if said else f"exit code {code}")


def _popen(handle: int, folder: Path, module: str, printed: object) -> subprocess.Popen:
    """Start a child that inherits one end of a pipe."""
    name = __name__.rpartition(".core.")[0].rpartition(".")[2]
    arguments = [str(_START), str(_PACKAGE_FOLDER), name, str(handle), str(folder), module]
    common = {
        "args": [sys.executable, "-P", *arguments],
        "env": os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        "stdin": subprocess.PIPE,  # the child ends when it is closed
        "stdout": printed,
        "stderr": printed,
    }
    if sys.platform != "win32":
        return subprocess.Popen(pass_fds=(handle,), **common)
    os.set_handle_inheritable(handle, True)
    startup = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})
    return subprocess.Popen(startupinfo=startup, creationflags=subprocess.CREATE_NO_WINDOW, **common)


def _new_folder(made: list[Callable[[], None]]) -> tuple[Path, IO | None]:
    """A private folder, and the file in it that this process keeps locked where files can be locked.

    It gets the name that `_sweep` looks for once that is so.
    """
    hidden = Path(tempfile.mkdtemp(prefix=f".{_PREFIX}"))
    folder = hidden.with_name(hidden.name.removeprefix("."))
    made += [lambda: shutil.rmtree(hidden, ignore_errors=True), lambda: shutil.rmtree(folder, ignore_errors=True)]
    owned = None
    if fcntl is not None:
        try:
            owned = open(hidden / _OWNER, "wb")  # noqa: SIM115 - closed with the child
            made.append(owned.close)
            fcntl.flock(owned, fcntl.LOCK_EX)
        except OSError:  # a file system without locks: what two kills leave stays
            (hidden / _OWNER).unlink(missing_ok=True)
    hidden.rename(folder)
    return folder, owned


def _sweep() -> None:
    """Remove the folders of processes that were killed together with their children: nobody locks these."""
    if fcntl is None:
        return
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*/{_OWNER}"):
        try:
            with open(path, "r+b") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path.parent, ignore_errors=True)
        except OSError:
            continue  # its owner lives, or it is somebody else's
