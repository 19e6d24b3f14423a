"""Whether a file is whole: Blender and its libraries may report success on a full disk, and leave a file that is cut.

Each check follows the structure of a format to its last byte, without decoding what is in between.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

_LITTLE_ROOM_BYTES = 1 << 16
_ZSTD, _ZSTD_SEEK_END = b"\x28\xb5\x2f\xfd", b"\xb1\xea\x92\x8f"
_PNG, _PNG_END = b"\x89PNG\r\n\x1a\n", b"\0\0\0\0IEND\xaeB`\x82"
_EXR, _EXR_LINES = b"\x76\x2f\x31\x01", {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
_USD_SECTION_BYTES, _USD_MAX_SECTIONS = 32, 64
_OGAWA_FROZEN = b"Ogawa\xff"


class NotWholeError(OSError):
    """A file ends too early, although its writer reported success."""

    def __init__(self, path: Path) -> None:
        full = shutil.disk_usage(path.parent).free < _LITTLE_ROOM_BYTES
        super().__init__(errno.ENOSPC, "the disk is full" if full else "not all of it was written", str(path))


def check_whole(path: Path) -> None:
    """Check a file of one of the formats in `CHECKS`, by the end of its name; raises NotWholeError."""
    CHECKS[path.suffix.lower()](path)


def check_blend(path: Path) -> None:
    """A .blend, plain or compressed, as Blender writes it on this machine."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(17)
        if head.startswith(_ZSTD):
            whole = _zstd_ends(file, size)
        else:
            whole = head.startswith(b"BLENDER") and _blocks_end(file, head, size)
    _require(whole, path)


def check_png(path: Path) -> None:
    """Its chunks follow each other to the last one."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        at = len(_PNG) if file.read(len(_PNG)) == _PNG else size
        while at + len(_PNG_END) < size:
            file.seek(at)
            at += int.from_bytes(_exactly(file, 4)) + len(_PNG_END)
        file.seek(max(0, size - len(_PNG_END)))
        _require(at + len(_PNG_END) == size and file.read() == _PNG_END, path)


def check_exr(path: Path) -> None:
    """Each row of chunks that its header asks for has a place in the file, and the last one ends it."""
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            _require(file.read(4) == _EXR, path)
            file.read(4)
            attributes = _exr_attributes(file)
            _x0, first, _x1, last = struct.unpack("<4i", attributes[b"dataWindow"])
            lines = _EXR_LINES[attributes[b"compression"][0]]
            count = -(-(last - first + 1) // lines)
            places = struct.unpack(f"<{count}Q", _exactly(file, 8 * count))
            file.seek(max(places) + 4)
            end = max(places) + 8 + int.from_bytes(_exactly(file, 4), "little")
        _require(min(places) > 0 and end == size, path)
    except (EOFError, KeyError, struct.error) as error:
        raise NotWholeError(path) from error


def check_hdr(path: Path) -> None:
    """A Radiance file as `write_hdr` makes it, whose scanlines are stored as they are."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(256)
        at = head.find(b"\n\n") + 2
        end = head.find(b"\n", at) + 1
        words = head[at:end].split()
        _require(len(words) == 4 and head.startswith(b"#?RADIANCE"), path)
        height, width = int(words[1]), int(words[3])
        row = 4 + 4 * (width + -(-width // 128)) if 8 <= width < 32768 else 4 * width
        _require(size == end + height * row, path)


def check_usd(path: Path) -> None:
    """USD, binary or text."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if file.read(8) == b"PXR-USDC":
            file.seek(16)
            whole = _sections_end(file, int.from_bytes(file.read(8), "little"), size)
        else:
            file.seek(0)
            whole = file.read(5) == b"#usda"
            file.seek(max(0, size - 64))
            whole = whole and file.read().rstrip().endswith(b"\n}")  # of the prim around all others
    _require(whole, path)


def check_alembic(path: Path) -> None:
    """Alembic in Ogawa, which marks a file as frozen when it was closed in order."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(16)
        root = int.from_bytes(head[8:], "little")
        whole = head.startswith(_OGAWA_FROZEN) and 16 <= root <= size - 8
        if whole:
            file.seek(root)
            count = int.from_bytes(file.read(8), "little")
            whole = 0 < count < (size - root) // 8
            places = struct.unpack(f"<{count}Q", file.read(8 * count)) if whole else ()
            whole = whole and all((place & ~(1 << 63)) < size for place in places)
    _require(whole, path)


def check_json(path: Path) -> None:
    """JSON text in UTF-8."""
    try:
        json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise NotWholeError(path) from error


CHECKS: dict[str, Callable[[Path], None]] = {
    ".blend": check_blend,
    ".png": check_png,
    ".exr": check_exr,
    ".hdr": check_hdr,
    ".usd": check_usd,
    ".usda": check_usd,
    ".usdc": check_usd,
    ".abc": check_alembic,
    ".json": check_json,
}


def _require(whole: bool, path: Path) -> None:
    if not whole:
        raise NotWholeError(path)


def _exactly(file: BinaryIO, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise EOFError
    return data


def _zstd_ends(file: BinaryIO, size: int) -> bool:
    """Whether the frames of a seekable zstd file fill it as the table at its end says."""
    file.seek(max(0, size - 9))
    tail = file.read()
    if len(tail) != 9 or not tail.endswith(_ZSTD_SEEK_END):
        return False
    entry = 12 if tail[4] & 0x80 else 8  # with checksums
    count = int.from_bytes(tail[:4], "little")
    table = 8 + count * entry + 9
    if table > size:
        return False
    file.seek(size - table + 8)
    entries = file.read(count * entry)
    return table + sum(int.from_bytes(entries[i : i + 4], "little") for i in range(0, len(entries), entry)) == size


def _blocks_end(file: BinaryIO, head: bytes, size: int) -> bool:
    """Whether the blocks of a plain .blend follow each other to the one that ends it."""
    if head[7:9].isdigit():  # since 5.0: the size of the header, and longer blocks
        at, block, length = int(head[7:9]), 32, struct.Struct("<16xq")
    else:
        at, block, length = 12, 24 if head[7:8] == b"-" else 20, struct.Struct("<4xi")
    while at + 8 <= size:
        file.seek(at)
        start = file.read(block)
        if len(start) < block or start[:4] == b"ENDB":
            return at + block == size
        at += block + length.unpack_from(start)[0]
    return False


def _exr_attributes(file: BinaryIO) -> dict[bytes, bytes]:
    """Values of the attributes in the header of an OpenEXR file, by name."""
    attributes = {}
    while name := _text(file):
        _text(file)  # its type
        attributes[name] = _exactly(file, int.from_bytes(_exactly(file, 4), "little"))
    return attributes


def _text(file: BinaryIO) -> bytes:
    """Bytes up to a zero."""
    found = b""
    while (byte := _exactly(file, 1)) != b"\0":
        found += byte
    return found


def _sections_end(file: BinaryIO, at: int, size: int) -> bool:
    """Whether all that the table of contents at `at` names lies in a file."""
    if not 0 < at < size:
        return False
    file.seek(at)
    count = int.from_bytes(file.read(8), "little")
    if not 0 < count <= _USD_MAX_SECTIONS or at + 8 + count * _USD_SECTION_BYTES > size:
        return False
    sections = file.read(count * _USD_SECTION_BYTES)
    places = (struct.unpack_from("<16x2q", sections, i) for i in range(0, len(sections), _USD_SECTION_BYTES))
    return all(start > 0 and length >= 0 and start + length <= size for start, length in places)
