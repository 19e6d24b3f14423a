"""The command line: bakes files without a window.

In go arguments. Out come baked files, reports, and an exit status.
"""

from .arguments import parse
from .batch import command, main
from .process import end_on_interrupt, own_temporary_folder
from .terminal import explain, flush

__all__ = ["command", "end_on_interrupt", "explain", "flush", "main", "own_temporary_folder", "parse"]
