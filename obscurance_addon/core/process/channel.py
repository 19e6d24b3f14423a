"""Messages between two processes: small ones through a pipe, arrays through mapped files in a private folder."""

from __future__ import annotations

import io
import json
import mmap
import pickle
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

_MAPPED_BYTES = 1 << 18  # arrays of a message that are larger together go through a file
_ALIGNMENT = 64
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
        self._numbers: dict[int, tuple[int, object]] = {}  # id of an object -> its number, and the object itself
        self._kept: dict[int, object] = {}  # by number, what the other end keeps here
        self._next = 0

    def send(self, message: object, keep: Iterable[object] | None = None) -> None:
        """Send a message of dataclasses of the core, plain objects and arrays.

        Parameters
        ----------
        message : object
        keep : iterable of object, optional
            Parts of it that the other end keeps: where it has them from an earlier message, only their number is sent.
            What was kept before and is not among them is forgotten; None leaves all as it is.
        """
        new: dict[int, object] = {}
        gone: list[int] = []
        if keep is not None:
            kept = {id(part): part for part in keep}
            gone = [number for key, (number, _) in self._numbers.items() if key not in kept]
            self._numbers = {key: value for key, value in self._numbers.items() if key in kept}
            for key, part in kept.items():
                if key not in self._numbers:
                    self._numbers[key] = self._next, part
                    new[self._next] = part
                    self._next += 1
        buffers: list[pickle.PickleBuffer] = []
        heads = [
            _dumps((gone, new), {}, buffers),
            _dumps(message, {key: number for key, (number, _) in self._numbers.items()}, buffers),
        ]
        raw = [buffer.raw() for buffer in buffers]
        sizes = [view.nbytes for view in raw]
        padded = [part for view in raw for part in (view, bytes(-view.nbytes % _ALIGNMENT))]
        name = ""
        if sum(sizes) > _MAPPED_BYTES:
            self._files += 1
            name = f"{id(self):x}-{self._files}"
            with open(self._folder / name, "wb") as file:
                file.writelines(padded)
        index = json.dumps({"file": name, "sizes": sizes, "heads": [len(head) for head in heads]}).encode()
        self._connection.send_bytes(index)
        self._connection.send_bytes(b"".join(heads))
        if not name:
            self._connection.send_bytes(b"".join(padded))

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
        index = json.loads(self._connection.recv_bytes())
        heads = self._connection.recv_bytes()
        if index["file"]:
            path = self._folder / index["file"]
            with open(path, "rb") as file:
                memory = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
            with suppress(PermissionError):  # Windows keeps a mapped file, which goes with its folder
                path.unlink()
        else:
            memory = memoryview(bytearray(self._connection.recv_bytes()))
        views, start = [], 0
        for size in index["sizes"]:
            views.append(memory[start : start + size])
            start += size + -size % _ALIGNMENT
        buffers = iter(views)
        first = index["heads"][0]
        gone, new = _Loader(io.BytesIO(heads[:first]), {}, buffers).load()
        for number in gone:
            del self._kept[number]
        self._kept.update(new)
        return _Loader(io.BytesIO(heads[first:]), self._kept, buffers).load()

    def close(self) -> None:
        """Close this end; the other one notices."""
        self._connection.close()


def _dumps(message: object, numbers: dict[int, int], buffers: list[pickle.PickleBuffer]) -> bytes:
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
        package, _, rest = module.partition(".core.")
        if rest and package.rpartition(".")[2] == _PACKAGE.rpartition(".")[2]:
            return super().find_class(f"{_PACKAGE}.core.{rest}", name)
        if module.partition(".")[0] == "numpy" or (module, name) in _OTHERS:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"a message names {module}.{name}")
