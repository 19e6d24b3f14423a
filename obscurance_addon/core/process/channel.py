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

from ..errors import BackendError

_MAPPED_BYTES = 1 << 17  # larger messages go through a file: less than what pipes hold, so that nobody waits to send
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
        numbers, new, gone, following = dict(self._numbers), {}, [], self._next
        if keep is not None:
            kept = {id(part): part for part in keep}
            gone = [number for key, (number, _) in numbers.items() if key not in kept]
            numbers = {key: value for key, value in numbers.items() if key in kept}
            for key, part in kept.items():
                if key not in numbers:
                    numbers[key] = following, part
                    new[following] = part
                    following += 1
        buffers: list[pickle.PickleBuffer] = []
        heads = [
            _dumps((gone, new), {}, buffers),
            _dumps(message, {key: number for key, (number, _) in numbers.items()}, buffers),
        ]
        views = [*map(memoryview, heads), *(buffer.raw() for buffer in buffers)]
        sizes = [view.nbytes for view in views]
        padded = [part for view in views for part in (view, bytes(-view.nbytes % _ALIGNMENT))]
        name, inline = "", b""
        if sum(sizes) > _MAPPED_BYTES:
            name = self._written(padded)
        else:
            inline = b"".join(padded)
        self._connection.send_bytes(json.dumps({"file": name, "sizes": sizes}).encode())
        if not name:
            self._connection.send_bytes(inline)
        self._numbers, self._next = numbers, following

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
        index = json.loads(self._connection.recv_bytes())
        if index["file"]:
            path = self._folder / index["file"]
            with open(path, "rb") as file:
                memory = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
            self._received.append(path)
            self._tidy()
        else:
            memory = memoryview(bytearray(self._connection.recv_bytes()))
        views, start = [], 0
        for size in index["sizes"]:
            views.append(memory[start : start + size])
            start += size + -size % _ALIGNMENT
        buffers = iter(views[2:])
        gone, new = _Loader(io.BytesIO(views[0]), {}, buffers).load()
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
