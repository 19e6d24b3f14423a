"""The parent's side of a child process: starts it, talks to it, and tells how it ended."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterable
from pathlib import Path

from ..errors import BackendError
from ..files import PrivateFolder
from .channel import Channel
from .page import ProgressPage

_START = Path(__file__).with_name("start.py")
_PACKAGE_FOLDER = Path(__file__).parents[2]

_running: weakref.WeakSet[ChildProcess] = weakref.WeakSet()
_commands: set[subprocess.Popen] = set()

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
            self._private = PrivateFolder()
            made.append(self._private.close)
            self.folder = self._private.path
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
        _running.add(self)

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
        _running.discard(self)
        self._process.kill()
        self._process.wait()
        self._process.stdin.close()
        self._channel.close()
        self.page.close()
        self._private.close()

    def kill(self) -> None:
        """Kill it without waiting, at any moment, from a signal handler too; nothing may be asked of it any more."""
        self._process.kill()
        self._private.close()

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


def kill_all() -> None:
    """Kill all child processes without waiting, and remove what they leave, for a process that ends at once."""
    for child in [*_running, *_commands]:
        child.kill()


def run_command(command: list[str], env: dict[str, str] | None) -> tuple[int, bytes]:
    """Run a command that `kill_all` ends too; its exit code, and all that it printed. Raises OSError."""
    with subprocess.Popen(
        command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        _commands.add(process)
        try:
            said, _ = process.communicate()
        finally:
            process.kill()
            _commands.discard(process)
    return process.returncode, said


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
