"""Shader nodes that give a colour or a number, by their identifier."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import bpy
import numpy as np

from ...core.shading import BLACK, AttributeSample, Constant, Expression, apply, arithmetic
from .images import image_sample
from .nodes import Output, Reader, UnreadableNodeError

TABLE_SIZE = 256  # places at which ramps and curves are sampled: one for each value of a byte


def _own_output(reader: Reader, output: Output) -> Expression:
    value = output.node.outputs[0].default_value
    return Constant((float(value),) if output.socket.type == "VALUE" else tuple(value[:3]))


def _color_attribute(reader: Reader, output: Output) -> Expression:
    return Constant((1.0,)) if output.socket.identifier == "Alpha" else AttributeSample(output.node.layer_name)


def _attribute(reader: Reader, output: Output) -> Expression:
    node = output.node
    if node.attribute_type != "GEOMETRY":
        raise UnreadableNodeError(f"{output.label} reads the object or the scene")
    if output.socket.identifier == "Alpha":
        return Constant((1.0,))
    sample = AttributeSample(node.attribute_name) if node.attribute_name else BLACK
    return apply(arithmetic.mean, sample) if output.socket.identifier == "Fac" else sample


def _mix_rgb(reader: Reader, output: Output) -> Expression:
    node = output.node
    return _blended(reader, output, node.blend_type, ("Fac", "Color1", "Color2"), (True, node.use_clamp))


def _mix(reader: Reader, output: Output) -> Expression:
    node = output.node
    kind = {"RGBA": "Color", "FLOAT": "Float", "VECTOR": "Vector"}.get(node.data_type)
    if kind is None:
        raise UnreadableNodeError(f"{output.label} mixes neither colours nor numbers")
    per_axis = kind == "Vector" and node.factor_mode == "NON_UNIFORM"
    inputs = ("Factor_Vector" if per_axis else "Factor_Float", f"A_{kind}", f"B_{kind}")
    if kind != "Color":
        return _blended(reader, output, "MIX", inputs, (node.clamp_factor, False))
    return _blended(reader, output, node.blend_type, inputs, (node.clamp_factor, node.clamp_result))


def _blended(
    reader: Reader, output: Output, mode: str, inputs: tuple[str, str, str], clamps: tuple[bool, bool]
) -> Expression:
    """Blend of the second and third input by the first; `clamps` says whether factor and result are clamped."""
    if mode not in arithmetic.BLENDS:
        reader.note(
            f"blend type {mode} of {output.label} is not understood, so its first color is used",
            cure="choose another blend type",
        )
        return reader.value(output, inputs[1])
    factor, a, b = reader.values(output, *inputs)
    mixed = apply(partial(arithmetic.blend, mode), apply(arithmetic.saturate, factor) if clamps[0] else factor, a, b)
    return apply(arithmetic.saturate, mixed) if clamps[1] else mixed


def _math(reader: Reader, output: Output) -> Expression:
    node = output.node
    if node.operation not in arithmetic.MATH:
        raise UnreadableNodeError(f"operation {node.operation} of {output.label} is not understood")
    count, _function = arithmetic.MATH[node.operation]
    result = apply(
        partial(arithmetic.calculate, node.operation),
        *reader.values(output, *("Value", "Value_001", "Value_002")[:count]),
    )
    return apply(arithmetic.saturate, result) if node.use_clamp else result


def _clamp(reader: Reader, output: Output) -> Expression:
    function = arithmetic.clamp_range if output.node.clamp_type == "RANGE" else arithmetic.clamp
    return apply(function, *reader.values(output, "Value", "Min", "Max"))


def _map_range(reader: Reader, output: Output) -> Expression:
    node = output.node
    if node.data_type != "FLOAT" or node.interpolation_type != "LINEAR":
        raise UnreadableNodeError(f"{output.label} does not map numbers linearly")
    inputs = reader.values(output, "Value", "From Min", "From Max", "To Min", "To Max")
    mapped = apply(arithmetic.map_range, *inputs)
    return apply(arithmetic.clamp_range, mapped, *inputs[3:]) if node.clamp else mapped


def _color_ramp(reader: Reader, output: Output) -> Expression:
    ramp, factor = output.node.color_ramp, reader.value(output, "Fac")
    channels = slice(3, 4) if output.socket.identifier == "Alpha" else slice(0, 3)
    if isinstance(factor, Constant):
        return Constant(tuple(ramp.evaluate(min(max(factor.values[0], 0.0), 1.0))[channels]))
    table = np.array([ramp.evaluate(x)[channels] for x in np.linspace(0.0, 1.0, TABLE_SIZE)], np.float32)
    return apply(partial(arithmetic.look_up, table, ramp.interpolation == "CONSTANT"), factor)


def _rgb_curves(reader: Reader, output: Output) -> Expression:
    mapping = output.node.mapping
    mapping.initialize()
    # Curve 3 is the combined one; it comes first.
    tables = np.stack([_curve_table(mapping, (3, i)) for i in range(3)])
    return apply(partial(arithmetic.curve_channels, tables), *reader.values(output, "Fac", "Color"))


def _curve_table(mapping: bpy.types.CurveMapping, curves: Sequence[int]) -> np.ndarray:
    """(TABLE_SIZE,) values over 0 .. 1 of curves applied one after the other."""
    values = np.linspace(0.0, 1.0, TABLE_SIZE).tolist()
    for index in curves:
        values = [mapping.evaluate(mapping.curves[index], x) for x in values]
    return np.array(values, np.float32)


def _separated(reader: Reader, output: Output) -> Expression:
    if getattr(output.node, "mode", "RGB") != "RGB":
        raise UnreadableNodeError(f"{output.label} separates something other than RGB")
    index = [socket.identifier for socket in output.node.outputs].index(output.socket.identifier)
    return apply(partial(arithmetic.channel, index), reader.value_at(output.inputs()[0]))


def _combined(reader: Reader, output: Output) -> Expression:
    if getattr(output.node, "mode", "RGB") != "RGB":
        raise UnreadableNodeError(f"{output.label} combines something other than RGB")
    return apply(arithmetic.combine, *(reader.value_at(target) for target in output.inputs()))


def _function(function: Callable[..., np.ndarray], *identifiers: str) -> Callable[[Reader, Output], Expression]:
    """A node that is nothing but a function of its inputs."""
    return lambda reader, output: apply(function, *reader.values(output, *identifiers))


VALUE_NODES: dict[str, Callable[[Reader, Output], Expression]] = {
    "ShaderNodeRGB": _own_output,
    "ShaderNodeValue": _own_output,
    "ShaderNodeTexImage": image_sample,
    "ShaderNodeVertexColor": _color_attribute,
    "ShaderNodeAttribute": _attribute,
    "ShaderNodeMixRGB": _mix_rgb,
    "ShaderNodeMix": _mix,
    "ShaderNodeMath": _math,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeValToRGB": _color_ramp,
    "ShaderNodeRGBCurve": _rgb_curves,
    "ShaderNodeSeparateColor": _separated,
    "ShaderNodeSeparateRGB": _separated,
    "ShaderNodeSeparateXYZ": _separated,
    "ShaderNodeCombineColor": _combined,
    "ShaderNodeCombineRGB": _combined,
    "ShaderNodeCombineXYZ": _combined,
    "ShaderNodeRGBToBW": _function(arithmetic.luminance, "Color"),
    "ShaderNodeGamma": _function(arithmetic.gamma, "Color", "Gamma"),
    "ShaderNodeBrightContrast": _function(arithmetic.bright_contrast, "Color", "Bright", "Contrast"),
    "ShaderNodeInvert": _function(arithmetic.invert, "Fac", "Color"),
    "ShaderNodeHueSaturation": _function(arithmetic.shift_hsv, "Hue", "Saturation", "Value", "Fac", "Color"),
}
