"""Image Texture nodes and the coordinates that reach them."""

from __future__ import annotations

import math

import numpy as np

from ...core.shading import Constant, Expression, ImageSample, UVProjection
from ..marks import MADE_HERE
from .nodes import MAX_DEPTH, NothingLinkedError, Output, Reader, UnreadableNodeError
from .textures import is_linear

_FIND = "find it (File > External Data > Find Missing Files), or unlink it"
_LOAD = "go to the frame to bake with"
_CHOOSE = "choose sRGB or a linear color space"
_ONE_TILE = "use one image for each material, or expect the mean"
_LINK_UV = "link a UV map to the image's Vector, through Mapping at most, or expect the mean"


def image_sample(reader: Reader, output: Output) -> Expression:
    """Colour or alpha of an Image Texture node; white where the image is a lightmap that a bake made.

    As for colour attributes, what an earlier bake left there must not darken the next one.

    Raises
    ------
    UnreadableNodeError
        There is no image, or it has no pixels.
    """
    node, image = output.node, output.node.image
    if image is None:
        raise UnreadableNodeError(f"{output.label} has no image", "choose an image in it, or unlink it")
    if MADE_HERE in image:
        return Constant((1.0,))
    texture = reader.images.texture(image, node.outputs["Alpha"].is_linked)
    if texture is None:
        raise UnreadableNodeError("image missing or empty", _FIND, image.name)
    projection = None
    if image.source == "TILED" and len(image.tiles) > 1:
        reader.note("image with several tiles, so the mean of its first one is used", image.name, cure=_ONE_TILE)
    else:
        try:
            name, matrix = _coordinates(reader, output)
            projection = UVProjection(name, matrix[:2, [0, 1, 3]])
        except UnreadableNodeError as problem:
            reader.note(f"{problem}, so the mean of the image is used", image.name, cure=_LINK_UV)
    if image.source in {"SEQUENCE", "MOVIE"}:
        reader.note("animated image, of which the frame that is loaded is used", image.name, cure=_LOAD)
    if not is_linear(image) and image.colorspace_settings.name != "sRGB":
        space = image.colorspace_settings.name
        reader.note(f"color space {space} of an image is taken as sRGB", image.name, cure=_CHOOSE)
    closest = node.interpolation == "Closest"
    return ImageSample(texture, projection, node.extension, closest, output.socket.identifier == "Alpha")


def _coordinates(reader: Reader, output: Output) -> tuple[str, np.ndarray]:
    """Texture coordinates that reach an image: name of a UV map, '' the active one, and 4 x 4 matrix applied to it.

    Raises
    ------
    UnreadableNodeError
        The coordinates are not an affine picture of a UV map.
    """
    target, matrix = output.input("Vector"), np.eye(4)
    for _ in range(MAX_DEPTH):
        origin = target.origin()
        if origin is None:
            if target.socket.node.bl_idname == "ShaderNodeMapping":
                # The same point everywhere: the socket's own value, whatever the UV.
                matrix = matrix @ np.array([[0, 0, 0, x] for x in (*target.socket.default_value, 1.0)])
            return "", matrix
        try:
            behind = origin.behind()
        except NothingLinkedError:
            return "", matrix
        if behind is None and origin.node.bl_idname == "ShaderNodeMapping":
            matrix = matrix @ _mapping_matrix(reader, origin)
            behind = origin.input("Vector")
        if behind is None:
            return _uv_name(origin), matrix
        target = behind
    raise UnreadableNodeError("coordinates come through too many nodes")


def _uv_name(output: Output) -> str:
    node = output.node
    if node.bl_idname == "ShaderNodeUVMap" and not node.from_instancer:
        return node.uv_map
    if node.bl_idname == "ShaderNodeTexCoord" and output.socket.identifier == "UV" and not node.from_instancer:
        return ""
    if node.bl_idname == "ShaderNodeAttribute" and node.attribute_type == "GEOMETRY" and node.attribute_name:
        return node.attribute_name
    raise UnreadableNodeError(f"{output.socket.name} of {output.label} is not a UV map")


def _mapping_matrix(reader: Reader, output: Output) -> np.ndarray:
    """4 x 4 matrix of a Mapping node with constant inputs; the rotation is about x, then y, then z."""
    kind = output.node.vector_type
    inputs = reader.values(output, "Location", "Rotation", "Scale")
    if kind == "NORMAL" or not all(isinstance(value, Constant) for value in inputs):
        raise UnreadableNodeError(f"{output.label} has the type Normal, or inputs that vary")
    location, angles, scale = (np.broadcast_to(np.array(value.values, np.float64), 3) for value in inputs)
    rotation = np.eye(3)
    for axis, angle in enumerate(angles):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[i, j], [i, j]] = math.cos(angle)
        turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
        rotation = turn @ rotation
    matrix = np.eye(4)
    if kind == "TEXTURE":
        inverse = np.divide(1.0, scale, out=np.zeros(3), where=scale != 0.0)
        matrix[:3, :3] = np.diag(inverse) @ rotation.T
        matrix[:3, 3] = -matrix[:3, :3] @ location
    else:
        matrix[:3, :3] = rotation @ np.diag(scale)
        matrix[:3, 3] = location if kind == "POINT" else 0.0
    return matrix
