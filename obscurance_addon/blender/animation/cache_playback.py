"""Plays the frame cache that a scene names."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ...core.errors import ObscuranceError
from ...core.notes import named
from .frame_cache import FrameCache


class CachePlayback:
    """Writes cached values; looks at the folder anew whenever it was written.

    Parameters
    ----------
    tell : callable
        Called with what the user should know.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._cache: FrameCache | None = None
        self._opened: tuple[str, float] | None = None  # folder, and when it had been written

    def has(self, scene: bpy.types.Scene) -> bool:
        """Whether the cache of the scene, if it has one, reaches to its frame."""
        folder = bpy.path.abspath(scene.obscurance.frame_cache) if scene.obscurance.frame_cache else ""
        opened = (folder, FrameCache.written_at(folder)) if folder else None
        if opened != self._opened:
            self._opened, self._cache = opened, None
            try:
                self._cache = FrameCache.open(folder) if folder else None
            except ObscuranceError as error:  # then frames are computed
                self._tell(str(error))
        return self._cache is not None and self._cache.has(scene.frame_current)

    def show(self, scene: bpy.types.Scene) -> str:
        """Write the values of the frame of the scene, which the cache has; what was done, in words.

        Raises
        ------
        FrameCacheError
            When they cannot be read, or have no place.
        """
        changed, missing = self._cache.show(scene.frame_current)
        if missing:
            self._tell(
                f"the frame cache has values for {named(missing)}, which the scene does not have: bake the frames again"
            )
        return f"Frame {scene.frame_current} from the cache, {len(changed)} objects changed"

    def forget_shown(self) -> None:
        """Write all values next time, whatever was written before."""
        if self._cache is not None:
            self._cache.forget_shown()
