"""The command line: bakes files without a window.

In go arguments. Out come baked files, reports, and an exit status.
"""

from .arguments import parse
from .batch import main

__all__ = ["main", "parse"]
