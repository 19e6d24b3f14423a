"""Reads back what Blender's exporters wrote: on a full disk they end as if all were well."""

from __future__ import annotations

from pathlib import Path

from ...core.errors import ObscuranceError
from ...core.files import NotWholeError, check_whole


class ExportError(ObscuranceError):
    """An animation that could not be exported; the message says why, and the cure."""


def check_export(path: Path, name: str = "") -> None:
    """Make sure that a .usd, .usda, .usdc or .abc file is there, and whole.

    Parameters
    ----------
    path : Path
    name : str
        The name of the file for messages, where it is to have another one.

    Raises
    ------
    ExportError
        When there is none, or it is not whole.
    """
    name = name or path.name
    try:
        check_whole(path)
    except FileNotFoundError:
        raise ExportError(f"Blender wrote no file '{name}': check the folder") from None
    except NotWholeError:
        raise ExportError(
            f"Blender did not write all of '{name}': make room on the disk, or choose another folder"
        ) from None
