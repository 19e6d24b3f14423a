"""Where the links of a node tree lead: through reroutes and muted nodes, and into and out of groups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import bpy

from ...core.shading import Constant, Expression, Shading
from ..marks import BAKED_LIGHT
from .textures import ImageCache

# Deeper trees are not followed: each node takes several frames of Python's stack.
MAX_DEPTH = 100
NUMBERS = {"VALUE", "INT", "BOOLEAN"}


class UnreadableNodeError(Exception):
    """A node has no value that holds for a point of a surface, whatever looks at it.

    `cure` is for the user, or ''; `image` names the image whose fault it is, if it is one's.
    """

    def __init__(self, problem: str = "", cure: str = "", image: str | None = None) -> None:
        super().__init__(problem)
        self.cure, self.image = cure, image


class NothingLinkedError(UnreadableNodeError):
    """A link leads nowhere, which counts as no link at all."""


@dataclass(frozen=True)
class Scope:
    """The group instance that the nodes being read are inside of, and where that instance is."""

    instance: bpy.types.Node
    outer: Scope | None

    def key(self) -> tuple[int, ...]:
        """What tells this scope from all others."""
        return (self.instance.as_pointer(), *(self.outer.key() if self.outer else ()))


@dataclass(frozen=True)
class Input:
    """One input of a node in its scope."""

    socket: bpy.types.NodeSocket
    scope: Scope | None

    @property
    def label(self) -> str:
        return f"{self.socket.name} of {label(self.socket.node)}"

    @property
    def is_reroute(self) -> bool:
        """Whether it is a reroute's input, which has no value of its own."""
        return self.socket.node.bl_idname == "NodeReroute"

    def origin(self) -> Output | None:
        """The output that is linked to this input, None if there is none."""
        for link in self.socket.links:
            if link.is_valid and not link.is_muted:
                return Output(link.from_node, link.from_socket, self.scope)
        return None

    def own_value(self) -> Constant:
        """The value shown when nothing is linked: grey for numbers, colour for colours and vectors.

        Raises
        ------
        UnreadableNodeError
            The socket shows neither.
        """
        if self.is_reroute:
            raise NothingLinkedError
        value = getattr(self.socket, "default_value", None)
        if self.socket.type in {"RGBA", "VECTOR"}:
            return Constant((*value[:3], *(0.0,) * (3 - len(value[:3]))))
        if self.socket.type in NUMBERS:
            return Constant((float(value),))
        raise UnreadableNodeError(f"{self.label} holds neither colour nor number")


@dataclass(frozen=True)
class Output:
    """One output of a node in its scope."""

    node: bpy.types.Node
    socket: bpy.types.NodeSocket
    scope: Scope | None

    @property
    def label(self) -> str:
        return label(self.node)

    def key(self) -> tuple:
        """What tells this output from all others."""
        return self.node.as_pointer(), self.socket.identifier, self.scope.key() if self.scope else ()

    def input(self, identifier: str) -> Input:
        """One of the node's inputs, by identifier: names repeat, and change between Blender's versions.

        Raises
        ------
        UnreadableNodeError
            There is no such input.
        """
        socket = _socket(self.node.inputs, identifier)
        if socket is None:
            raise UnreadableNodeError(f"{self.label} has no input {identifier}")
        return Input(socket, self.scope)

    def inputs(self) -> list[Input]:
        """All of the node's inputs."""
        return [Input(socket, self.scope) for socket in self.node.inputs]

    def behind(self) -> Input | None:
        """The input whose value this output only hands on (muted node, reroute, group); None for all other nodes.

        A group that adds baked light counts as handing on: what it adds is the result of a bake.

        Raises
        ------
        NothingLinkedError
            The node hands something on, but nothing to this output.
        """
        node, identifier = self.node, self.socket.identifier
        if node.mute:
            inside = (link.from_socket for link in node.internal_links if link.to_socket == self.socket)
            found = Input(next(inside, None), self.scope)
        elif node.bl_idname == "NodeReroute":
            found = Input(node.inputs[0], self.scope)
        elif node.bl_idname == "NodeGroupInput" and self.scope is not None:
            found = Input(_socket(self.scope.instance.inputs, identifier), self.scope.outer)
        elif hasattr(node, "node_tree") and node.node_tree is not None and BAKED_LIGHT in node.node_tree:
            found = Input(node.inputs[0], self.scope)
        elif hasattr(node, "node_tree"):
            inner = node.node_tree.nodes if node.node_tree else ()
            ends = (n.inputs for n in inner if n.bl_idname == "NodeGroupOutput" and n.is_active_output)
            found = Input(_socket(next(ends, ()), identifier), Scope(node, self.scope))
        else:
            return None
        if found.socket is None:
            raise NothingLinkedError
        return found


class Reader(Protocol):
    """What the readers of single nodes ask of the reader of the tree, `tree_reader.TreeReader`."""

    images: ImageCache

    def note(self, problem: str, *images: str, cure: str = ...) -> None:
        """Remember a problem, once: of these images, or of the tree."""
        ...

    def value(self, output: Output, identifier: str) -> Expression:
        """What one input of the output's node receives, in that input's own type."""
        ...

    def values(self, output: Output, *identifiers: str) -> list[Expression]:
        """What these inputs of the output's node receive."""
        ...

    def surface(self, output: Output, identifier: str) -> Shading:
        """What one shader input of the output's node receives."""
        ...

    def value_at(self, target: Input) -> Expression:
        """What an input receives, in its own type; its own value if nothing readable is linked."""
        ...


def node_tree_of(material: bpy.types.Material) -> bpy.types.NodeTree | None:
    """The nodes of a material, None where it is rendered without."""
    # New versions always use nodes, and warn when asked.
    return material.node_tree if bpy.app.version >= (5, 0, 0) or material.use_nodes else None


def label(node: bpy.types.Node) -> str:
    """A node's kind for messages, or its group: what nodes of many materials have in common."""
    tree = getattr(node, "node_tree", None)
    return f"node group '{tree.name}'" if tree is not None else f"node '{node.bl_label}'"


def _socket(sockets: bpy.types.bpy_prop_collection, identifier: str) -> bpy.types.NodeSocket | None:
    return next((socket for socket in sockets if socket.identifier == identifier), None)
