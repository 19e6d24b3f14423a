"""Folders for temporary files that belong to one process, and go with it."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from .locks import abandoned, locked

_PREFIX, _OWNER = "obscurance-", "owner"


class PrivateFolder:
    """A folder below that for temporary files; those of processes that were killed are removed when one is made.

    Attributes
    ----------
    path : Path

    Raises
    ------
    OSError
        When it cannot be made.
    """

    def __init__(self) -> None:
        _sweep()
        hidden = Path(tempfile.mkdtemp(prefix=f".{_PREFIX}"))
        self.path = hidden.with_name(hidden.name.removeprefix("."))
        self._owner = None
        try:
            self._owner = locked(hidden / _OWNER)
            hidden.rename(self.path)  # to the name that a sweep looks for, now that it is locked
        except BaseException:
            self.close()
            shutil.rmtree(hidden, ignore_errors=True)
            raise

    def close(self) -> None:
        """Remove it and what it holds; harmless when it is gone."""
        if self._owner is not None:
            self._owner.close()
        shutil.rmtree(self.path, ignore_errors=True)


def _sweep() -> None:
    """Remove the folders of processes that were killed: nobody locks these."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*/{_OWNER}"):
        owner = abandoned(path)
        if owner is not None:
            with owner:
                shutil.rmtree(path.parent, ignore_errors=True)
