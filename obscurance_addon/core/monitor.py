"""How a bake tells how far it is."""

from __future__ import annotations


class Monitor:
    """Hears how far a bake is (the base class does not care); may raise `BakeCancelledError` to stop it."""

    def phase(self, name: str, total: int) -> None:
        """A new phase begins with `total` units of work (triangles, rays or patches)."""

    def advance(self, amount: int) -> None:
        """That much more is done; called from any thread."""
