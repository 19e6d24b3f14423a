"""Reads back what Blender's exporters wrote: on a full disk they end as if all were well.

Each format says at its end, or from there on, where everything lies, so that a file that was cut off shows.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

from ...core.errors import ObscuranceError

_CRATE_START = struct.Struct("<8s8sq")  # of .usdc: mark, version, where the table of sections lies
_CRATE_SECTION = struct.Struct("<16sqq")  # name, start, size
_CRATE_SECTIONS = {b"TOKENS", b"STRINGS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS"}
_OGAWA_START = struct.Struct("<5sBHQ")  # of .abc: mark, whether it was completed, version, where the first group lies
_OGAWA_COMPLETE, _OGAWA_DATA = 0xFF, 1 << 63
_MOST_SECTIONS, _MOST_CHILDREN = 64, 64
_TEXT_END_BYTES = 64


class ExportError(ObscuranceError):
    """An animation that could not be exported; the message says why, and the cure."""


def check_export(path: Path, name: str = "") -> None:
    """Make sure that a .usd, .usda, .usdc or .abc file ends where it says, and holds what it says at its end.

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
        with open(path, "rb") as file:
            start = file.read(8)
            file.seek(0)
            if start == b"PXR-USDC":
                whole = _is_whole_crate(file)
            elif start.startswith(b"#usda"):
                whole = _is_whole_text(file)
            else:
                whole = start.startswith(b"Ogawa") and _is_whole_ogawa(file)
    except FileNotFoundError:
        raise ExportError(f"Blender wrote no file '{name}': check the folder") from None
    except struct.error:  # it ends within a table
        whole = False
    if not whole:
        raise ExportError(f"Blender did not write all of '{name}': make room on the disk, or choose another folder")


def _is_whole_crate(file: BinaryIO) -> bool:
    size = _size(file)
    _, _, table = _CRATE_START.unpack(file.read(_CRATE_START.size))
    if not _CRATE_START.size <= table <= size - 8:
        return False
    file.seek(table)
    (count,) = struct.unpack("<Q", file.read(8))
    if count > _MOST_SECTIONS:
        return False
    sections = [_CRATE_SECTION.unpack(file.read(_CRATE_SECTION.size)) for _ in range(count)]
    inside = all(start > 0 and 0 <= length <= size - start for _, start, length in sections)
    return inside and {name.rstrip(b"\0") for name, _, _ in sections} >= _CRATE_SECTIONS


def _is_whole_text(file: BinaryIO) -> bool:
    """Whether its last line closes a prim that is in no other one, and so is not indented."""
    file.seek(max(0, _size(file) - _TEXT_END_BYTES))
    return file.read().rstrip().endswith(b"\n}")


def _is_whole_ogawa(file: BinaryIO) -> bool:
    size = _size(file)
    _, complete, _, group = _OGAWA_START.unpack(file.read(_OGAWA_START.size))
    if complete != _OGAWA_COMPLETE or not _OGAWA_START.size <= group <= size - 8:
        return False
    file.seek(group)
    (count,) = struct.unpack("<Q", file.read(8))
    if not 0 < count <= _MOST_CHILDREN:
        return False
    children = struct.unpack(f"<{count}Q", file.read(8 * count))
    return all(child & ~_OGAWA_DATA <= size - 8 for child in children)


def _size(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size
