"""One file with the values of one frame: colours (n, 3) float32 of each object that changed in it.

It is what `np.savez` writes: a zip with `names.npy`, a JSON list of the objects, and `0.npy`, `1.npy`... for each.
Of such a file nothing is evaluated, unpacked or believed when it is read: how many members it has and how long they are
is known before, from the index of the cache and from the meshes of the scene, and nothing longer is read.
"""

from __future__ import annotations

import io
import json
import os
import re
import struct
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .plain_file import exactly, opened

_MEMBER = struct.Struct("<4s5H3I2H")  # of a zip: mark, version, flags, method, time, date, crc, 2 sizes, name, extra
_LONG_SIZES = struct.Struct("<HHQQ")  # the extra field of sizes with 64 bits: its kind and length, 2 sizes
_MEMBER_MARK, _STORED, _LONG, _LONG_KIND = b"PK\3\4", 0, 0xFFFFFFFF, 1
_ARRAY = struct.Struct("<8sH")  # of .npy: mark and version, length of the header
_ARRAY_MARK = b"\x93NUMPY\x01\x00"
_HEADER_BYTES = 1024  # at most
_COLORS = re.compile(rb"\{'descr': '<f4', 'fortran_order': False, 'shape': \((\d{1,12}), 3\), \} *\n")
_TEXT = re.compile(rb"\{'descr': '<U(\d{1,12})', 'fortran_order': False, 'shape': \(\), \} *\n")
_COLOR_BYTES, _CHARACTER_BYTES = 12, 4
is_name = re.compile(r"frame_-?\d{5,7}\.npz").fullmatch


class OtherElementsError(Exception):
    """The file holds another number of values for an object than there are places; the message is its name."""


def name_of(frame: int) -> str:
    """The name of the file of a frame."""
    return f"frame_{frame:06d}.npz"


def write(path: Path, values: Mapping[str, np.ndarray]) -> None:
    """Write the values (n, 3) of objects by name; raises OSError."""
    arrays = {str(i): np.ascontiguousarray(colours, "<f4") for i, colours in enumerate(values.values())}
    made = io.BytesIO()
    np.savez(made, names=np.array(json.dumps(list(values))), **arrays)
    with open(path, "wb") as file:
        file.write(made.getbuffer())
        file.flush()
        os.fsync(file.fileno())  # some systems notice only then that the disk is full


def read(path: Path, stored: Collection[str], wanted: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Read the values of some of the objects in a file.

    Parameters
    ----------
    path : Path
    stored : collection of str
        Names of all objects in the file.
    wanted : mapping of str to int
        How many values some of them have.

    Returns
    -------
    dict of str to ndarray, (n, 3) float32
        Finite.

    Raises
    ------
    OSError, ValueError, RecursionError
        When the file is not what `write` writes.
    OtherElementsError
        When an object has another number of values.
    """
    found = {}
    with opened(path) as file:
        names = _Member(file, "names.npy").names(stored)
        for number, name in enumerate(names):
            member = _Member(file, f"{number}.npy")
            if name in wanted:
                found[name] = member.colors(name, wanted[name])
            member.leave()
    return found


class _Member:
    """The member of the zip that begins where the file stands, which must have this name and not be packed."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        mark, _, _, method, _, _, self._crc, packed, size, of_name, of_extra = _MEMBER.unpack(
            exactly(file, _MEMBER.size)
        )
        if mark != _MEMBER_MARK or method != _STORED or exactly(file, of_name) != name.encode():
            raise ValueError("a file is not of a frame cache")
        extra = exactly(file, of_extra)
        if packed == _LONG and len(extra) >= _LONG_SIZES.size:
            kind, _, size, packed = _LONG_SIZES.unpack_from(extra)
            if kind != _LONG_KIND:
                raise ValueError("a file is not of a frame cache")
        self._file, self._end = file, file.tell() + size
        if packed != size or self._end > os.fstat(file.fileno()).st_size:
            raise ValueError("a file is cut off")

    def leave(self) -> None:
        """Go to what follows it."""
        self._file.seek(self._end)

    def names(self, stored: Collection[str]) -> list[str]:
        """The names that it lists, which are those of `stored` in any order."""
        text = self._array(_TEXT, _CHARACTER_BYTES, len(json.dumps(list(stored)))).decode("utf-32-le")
        names = json.loads(text)
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError("a file is not of a frame cache")
        if sorted(names) != sorted(stored):
            raise ValueError("a file holds other objects than the index says")
        return names

    def colors(self, name: str, count: int) -> np.ndarray:
        """The values (count, 3) of an object."""
        try:
            data = self._array(_COLORS, _COLOR_BYTES, count)
        except OtherLengthError:
            raise OtherElementsError(name) from None
        values = np.frombuffer(data, "<f4").reshape(-1, 3)
        if not np.isfinite(values).all():
            raise ValueError("a file holds values that are not numbers")
        return values

    def _array(self, kind: re.Pattern, item_bytes: int, count: int) -> bytes:
        """The data of the .npy that it is, with so many items; raises OtherLengthError."""
        start = exactly(self._file, _ARRAY.size)
        mark, length = _ARRAY.unpack(start)
        if mark != _ARRAY_MARK or length > _HEADER_BYTES:
            raise ValueError("a file is not of a frame cache")
        header = exactly(self._file, length)
        described = kind.fullmatch(header)
        if described is None or self._file.tell() + int(described[1]) * item_bytes != self._end:
            raise ValueError("a file is not of a frame cache")
        if int(described[1]) != count:
            raise OtherLengthError("a file holds other objects than the index says")
        data = exactly(self._file, count * item_bytes)
        if zlib.crc32(data, zlib.crc32(header, zlib.crc32(start))) != self._crc:
            raise ValueError("a file is damaged")
        return data


class OtherLengthError(ValueError):
    """An array has another length than it must have."""
