"""Plays the frame cache that a scene names."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ...core.errors import ObscuranceError
from ...core.notes import named
from ..frame_caches import FrameCache, FrameCacheError


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
        self._opened: tuple | None = None  # folder, and what told that it was written

    def has(self, scene: bpy.types.Scene) -> bool:
        """Whether the cache of the scene, if it has one, reaches to its frame."""
        opened = _what_is_at(scene)
        if opened != self._opened:
            self._opened, self._cache = opened, None
            try:
                self._cache = FrameCache.open(opened[0]) if opened else None
            except ObscuranceError as error:  # then frames are computed
                self._tell(str(error))
        return self._cache is not None and self._cache.has(scene.frame_current)

    def show(self, scene: bpy.types.Scene) -> str:
        """Write the values of the frame of the scene, which the cache has; what was done, in words.

        Raises
        ------
        FrameCacheError
            When they cannot be read, or have no place. The message is the same for all frames of a broken cache.
        """
        try:
            changed, missing = self._cache.show(scene.frame_current)
        except FrameCacheError:
            if _what_is_at(scene) == self._opened or not self.has(scene):
                raise
            changed, missing = self._cache.show(scene.frame_current)  # it was baked again meanwhile
        if missing:
            self._tell(
                f"the frame cache has values for {named(missing)}, which the scene does not have: bake the frames again"
            )
        return f"Frame {scene.frame_current} from the cache, {len(changed)} objects changed"

    def forget_shown(self) -> None:
        """Write all values next time, whatever was written before."""
        if self._cache is not None:
            self._cache.forget_shown()


def _what_is_at(scene: bpy.types.Scene) -> tuple | None:
    """The folder of the cache that a scene names, and what tells when it was written; None where it names none."""
    if not scene.obscurance.frame_cache:
        return None
    folder = bpy.path.abspath(scene.obscurance.frame_cache)
    return folder, FrameCache.written_at(folder)
