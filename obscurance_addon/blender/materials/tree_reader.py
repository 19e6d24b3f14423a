"""Reads node trees: what arrives at an input, as an expression or a shading."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ...core.notes import Notes
from ...core.shading import BLACK, DEFAULT_REFLECTANCE, Constant, Expression, Shading, apply, luminance, mean
from .nodes import MAX_DEPTH, NUMBERS, Input, NothingLinkedError, Output, UnreadableNodeError
from .shaders import SHADER_NODES
from .textures import ImageCache
from .values import VALUE_NODES

SET_MEAN = "set that value to the mean of what you see, or bake the nodes into an image"
_REPLACE = "link a shader that is built in, such as Principled BSDF or Emission"
_SIMPLIFY = "shorten the tree"


class TreeReader:
    """Follows the links of one material's tree and remembers what it could not read.

    Parameters
    ----------
    images : ImageCache

    Attributes
    ----------
    problems : Notes
        What could not be read and what was assumed instead: of the images that are named, or of the whole tree.
    """

    def __init__(self, images: ImageCache) -> None:
        self.images = images
        self.problems = Notes()
        self._known: dict[tuple, Expression | Shading] = {}
        self._open: set[tuple] = set()

    def note(self, problem: str, *images: str, cure: str = SET_MEAN) -> None:
        """Remember a problem, once: of these images, or of the tree."""
        self.problems.add(problem, *images, cure=cure)

    def tell(self, notes: Notes, where: str, name: str, cure_all: str = "") -> None:
        """Hand on all problems; those of the tree as of a thing of this name; `cure_all` instead of each one's cure."""
        for what, names, cure in self.problems:
            notes.add(what if names else f"{what}, {where}", *(names or (name,)), cure=cure_all or cure)

    def value(self, output: Output, identifier: str) -> Expression:
        """What one input of the output's node receives, in that input's own type."""
        return self.value_at(output.input(identifier))

    def values(self, output: Output, *identifiers: str) -> list[Expression]:
        """What these inputs of the output's node receive."""
        return [self.value_at(output.input(identifier)) for identifier in identifiers]

    def surface(self, output: Output, identifier: str) -> Shading:
        """What one shader input of the output's node receives."""
        return self.surface_at(output.input(identifier))

    def value_at(self, target: Input) -> Expression:
        """What an input receives, in its own type; its own value if nothing readable is linked."""
        origin = target.origin()
        try:
            if origin is None:
                return target.own_value()
            return _converted(self._value_of(origin), origin.socket.type, target.socket.type)
        except UnreadableNodeError as problem:
            if target.is_reroute:
                raise
            own = target.own_value()
            if not isinstance(problem, NothingLinkedError):
                self._note_unreadable(problem, "the sockets that it feeds keep their own value")
            return own

    def surface_at(self, target: Input) -> Shading:
        """What a shader input receives; black if nothing readable is linked."""
        origin = target.origin()
        try:
            return Shading() if origin is None else self._surface_of(origin)
        except NothingLinkedError:
            return Shading()
        except UnreadableNodeError as problem:
            self._note_unreadable(problem, "what it feeds counts as black")
            return Shading()

    def _note_unreadable(self, problem: UnreadableNodeError, instead: str) -> None:
        names = () if problem.image is None else (problem.image,)
        self.note(f"{problem}, so {instead}", *names, cure=problem.cure or SET_MEAN)

    def _value_of(self, output: Output) -> Expression:
        with self._entered(output) as key:
            if key not in self._known:
                behind = output.behind()
                if behind is not None:
                    self._known[key] = _converted(self.value_at(behind), behind.socket.type, output.socket.type)
                elif output.node.bl_idname in VALUE_NODES:
                    self._known[key] = VALUE_NODES[output.node.bl_idname](self, output)
                else:
                    raise UnreadableNodeError(f"{output.label} cannot be followed")
            return self._known[key]

    def _surface_of(self, output: Output) -> Shading:
        if output.socket.type != "SHADER":
            # Blender turns a colour that is linked to a shader socket into emission.
            return Shading(BLACK, self._value_of(output))
        with self._entered(output) as key:
            if key not in self._known:
                behind = output.behind()
                if behind is not None:
                    self._known[key] = self.surface_at(behind)
                elif output.node.bl_idname in SHADER_NODES:
                    self._known[key] = SHADER_NODES[output.node.bl_idname](self, output)
                else:
                    self.note(
                        f"{output.label} is not understood, so it counts as {DEFAULT_REFLECTANCE} grey", cure=_REPLACE
                    )
                    self._known[key] = Shading(Constant((DEFAULT_REFLECTANCE,)))
            return self._known[key]

    @contextmanager
    def _entered(self, output: Output) -> Iterator[tuple]:
        key = output.key()
        if key in self._open or len(self._open) >= MAX_DEPTH:
            raise UnreadableNodeError(f"{output.label} is in a loop, or more than {MAX_DEPTH} nodes deep", _SIMPLIFY)
        self._open.add(key)
        try:
            yield key
        finally:
            self._open.remove(key)


def _converted(value: Expression, source: str, target: str) -> Expression:
    """As Blender converts between sockets: colours become numbers by luminance, vectors by their mean."""
    if target not in NUMBERS or source not in {"RGBA", "VECTOR"}:
        return value
    return apply(luminance if source == "RGBA" else mean, value)
