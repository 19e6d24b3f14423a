"""What a user should know of a bake: one line for each kind of thing, however many objects it is about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

_LINE = 80  # characters of names in a line; the first one stands whatever its length


def named(names: Iterable[object]) -> str:
    """Names for a message: each once, in quotes and in order, and the number of those for which a line has no room."""
    quoted = [repr(name) for name in sorted({str(name) for name in names})]
    kept = 1
    while kept < len(quoted) and len(", ".join(quoted[: kept + 1])) <= _LINE:
        kept += 1
    others = len(quoted) - kept
    return ", ".join(quoted[:kept]) + (f" and {others:,} other{'s' if others > 1 else ''}" if others > 0 else "")


class Notes:
    """Gathers what is to be said, and says it once for all objects of which it is true."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], dict[str, None]] = {}

    def __bool__(self) -> bool:
        return bool(self._names)

    def add(self, what: str, *names: str, cure: str = "") -> None:
        """Say something of objects, materials or files; `what` reads well before a colon and their names."""
        self._names.setdefault((what, cure), {}).update(dict.fromkeys(names))

    def __iter__(self) -> Iterator[tuple[str, tuple[str, ...], str]]:
        """What, whose names, and the cure."""
        return ((what, tuple(names), cure) for (what, cure), names in self._names.items())

    def lines(self) -> list[str]:
        """One line for each kind: what, whose names, and the cure, without a full stop."""
        return [
            what + (f": {named(names)}" if names else "") + (f"; {cure}" if cure else "") for what, names, cure in self
        ]
