"""Messages between two processes: small ones through a pipe, arrays through mapped files in a private folder."""

from __future__ import annotations

import functools
import importlib
import io
import json
import mmap
import pickle
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from ..errors import BackendError

_MAPPED_BYTES = 1 << 17  # larger messages go through a file: less than what pipes hold, so that nobody waits to send
_ALIGNMENT = 64
_LENGTH_BYTES = 4
_PACKAGE = __name__.rpartition(".core.")[0]  # each process may know the package by another name
_OTHERS = {("functools", "partial"), ("builtins", "set"), ("builtins", "frozenset"), ("builtins", "slice")}


class Channel:
    """One end of a connection to another process.

    Parameters
    ----------
    connection : multiprocessing.connection.Connection
    folder : Path
        Private to the two processes; mapped files lie there until they are received.
    """

    def __init__(self, connection: Connection, folder: Path) -> None:
        self._connection, self._folder, self._files = connection, folder, 0
        self._parts: dict[int, object] = {}  # by id, what the other end keeps; so it stays alive here too
        self._numbers: dict[int, int] = {}  # of these, by id
        self._kept: dict[int, object] = {}  # by number, what the other end keeps here
        self._next = 0
        self._received: list[Path] = []

    def send(self, message: object, keep: Iterable[object] | None = None) -> None:
        """Send a message of dataclasses of the core, plain objects and arrays.

        Parameters
        ----------
        message : object
        keep : iterable of object, optional
            Parts of it that the other end keeps: where it has them from an earlier message, only their number is sent.
            What was kept before and is not among them is forgotten; None leaves all as it is.

        Raises
        ------
        BackendError
            When the disk is full; the channel is as it was.
        OSError, ValueError
            When the other end has gone.
        """
        parts, numbers, new, gone, following = self._parts, self._numbers, {}, [], self._next
        if keep is not None:
            parts = {id(part): part for part in keep}
            gone = [number for key, number in numbers.items() if key not in parts]
            numbers = {key: number for key, number in numbers.items() if key in parts}
            for key, part in parts.items():
                if key not in numbers:
                    numbers[key] = following
                    new[following] = part
                    following += 1
        buffers: list[pickle.PickleBuffer] = []
        heads = [_dumps((gone, new), {}, buffers) if gone or new else b"", _dumps(message, numbers, buffers)]
        views = [*map(memoryview, heads), *(buffer.raw() for buffer in buffers)]
        sizes = [view.nbytes for view in views]
        padded = [part for view in views for part in (view, bytes(-view.nbytes % _ALIGNMENT))]
        name = ""
        if sum(sizes) > _MAPPED_BYTES:
            name, padded = self._written(padded), []
        index = json.dumps({"file": name, "sizes": sizes}).encode()
        index += b" " * (-(_LENGTH_BYTES + len(index)) % _ALIGNMENT)
        self._connection.send_bytes(b"".join([len(index).to_bytes(_LENGTH_BYTES), index, *padded]))
        self._parts, self._numbers, self._next = parts, numbers, following

    def _written(self, parts: list) -> str:
        """Write a file for the other end, whole or not at all; its name."""
        self._files += 1
        name = f"{id(self):x}-{self._files}"
        try:
            with open(self._folder / name, "wb") as file:
                file.writelines(parts)
        except OSError as error:
            with suppress(OSError):
                (self._folder / name).unlink()
            raise BackendError(
                f"the scene finds no room in the folder for temporary files, {self._folder.parent} ({error.strerror}): "
                "free some there, or choose another one in the preferences (File Paths)"
            ) from error
        return name

    def poll(self, seconds: float | None) -> bool:
        """Whether there is a message, or the other end has gone; waits so long for it, for None without end."""
        return self._connection.poll(seconds)

    def receive(self) -> object:
        """The next message. Its arrays may be written to.

        Raises
        ------
        EOFError, OSError
            When the other end has gone.
        """
        self._tidy()
        got = memoryview(bytearray(self._connection.recv_bytes()))
        end = _LENGTH_BYTES + int.from_bytes(got[:_LENGTH_BYTES])
        index = json.loads(bytes(got[_LENGTH_BYTES:end]))
        if index["file"]:
            path = self._folder / index["file"]
            with open(path, "rb") as file:
                memory = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
            self._received.append(path)
            self._tidy()
        else:
            memory = got[end:]
        views, start = [], 0
        for size in index["sizes"]:
            views.append(memory[start : start + size])
            start += size + -size % _ALIGNMENT
        buffers = iter(views[2:])
        gone, new = _Loader(io.BytesIO(views[0]), {}, buffers).load() if len(views[0]) else ([], {})
        for number in gone:
            del self._kept[number]
        self._kept.update(new)
        return _Loader(io.BytesIO(views[1]), self._kept, buffers).load()

    def _tidy(self) -> None:
        """Remove files that were received; Windows keeps each for as long as an array of it is in use."""
        left = []
        for path in self._received:
            try:
                path.unlink(missing_ok=True)
            except PermissionError:
                left.append(path)
        self._received = left

    def close(self) -> None:
        """Close this end; the other one notices."""
        self._connection.close()


def _dumps(message: object, numbers: dict[int, int], buffers: list[pickle.PickleBuffer]) -> bytes:
    if not numbers:
        return pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    file = io.BytesIO()
    _Pickler(file, numbers, buffers).dump(message)
    return file.getvalue()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, numbers: dict[int, int], buffers: list[pickle.PickleBuffer]) -> None:
        super().__init__(file, protocol=5, buffer_callback=buffers.append)
        self._numbers = numbers

    def persistent_id(self, part: object) -> int | None:
        return self._numbers.get(id(part))


class _Loader(pickle.Unpickler):
    """Makes nothing but arrays, a few plain objects, and classes of the core, by whichever name they were sent."""

    def __init__(self, file: io.BytesIO, kept: dict[int, object], buffers: Iterable[memoryview]) -> None:
        super().__init__(file, buffers=buffers)
        self._kept_parts = kept

    def persistent_load(self, number: int) -> object:
        return self._kept_parts[number]

    def find_class(self, module: str, name: str) -> object:
        return _found(module, name)


@functools.cache
def _found(module: str, name: str) -> object:
    """A class or function of the core, of numpy, or one of a few others."""
    package, _, rest = module.partition(".core.")
    if rest and package.rpartition(".")[2] == _PACKAGE.rpartition(".")[2]:
        module = f"{_PACKAGE}.core.{rest}"
    elif module.partition(".")[0] != "numpy" and (module, name) not in _OTHERS:
        raise pickle.UnpicklingError(f"a message names {module}.{name}")
    return functools.reduce(getattr, name.split("."), importlib.import_module(module))
