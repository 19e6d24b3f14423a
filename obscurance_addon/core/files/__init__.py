"""Files of the user: checked before, written whole or not at all, and nothing left by runs that were killed.

In go paths. Out come files that replace others only once they are whole, and errors that name the path and the cure.
"""

from .parts import Parts, finished, let_go_of_all, replaced, written_whole
from .private_folder import PrivateFolder
from .targets import TargetError, check_folder_target, check_target, identities, is_stream
from .wholeness import CHECKS, NotWholeError, check_whole

__all__ = [
    "CHECKS",
    "NotWholeError",
    "Parts",
    "PrivateFolder",
    "TargetError",
    "check_folder_target",
    "check_target",
    "check_whole",
    "finished",
    "identities",
    "is_stream",
    "let_go_of_all",
    "replaced",
    "written_whole",
]
