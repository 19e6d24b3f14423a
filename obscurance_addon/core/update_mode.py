"""Which patches are baked again when something moves."""

from __future__ import annotations

import enum


class UpdateMode(enum.StrEnum):
    """How influenced patches are found."""

    EXACT = "EXACT"  # all that a change can reach
    LIST = "LIST"  # those on the list of the 2003 paper, section 5
