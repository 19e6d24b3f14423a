"""Child processes: what may crash, hang or hold the interpreter lock runs in a process of its own.

In go the name of a module of the core with a function `serve`, and messages of plain objects and arrays. Out come its
answers, or an error that says how the process ended.
"""

from .channel import Channel
from .child import ChildEndedError, ChildProcess, kill_all, run_command
from .page import ProgressPage

__all__ = ["Channel", "ChildEndedError", "ChildProcess", "ProgressPage", "kill_all", "run_command"]
