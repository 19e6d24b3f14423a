"""Shader nodes that scatter or emit light, by their identifier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.shading import BLACK, Shading, apply, lerp, saturate, shares_removed
from .nodes import Output, Reader


def _principled(reader: Reader, output: Output) -> Shading:
    alpha = apply(saturate, reader.value(output, "Alpha"))
    diffuse = apply(shares_removed, *reader.values(output, "Base Color", "Metallic", "Transmission Weight"))
    radiance = apply(np.multiply, *reader.values(output, "Emission Color", "Emission Strength"))
    return Shading(apply(np.multiply, diffuse, alpha), apply(np.multiply, radiance, alpha))


def _eevee_specular(reader: Reader, output: Output) -> Shading:
    transparency, diffuse, radiance = reader.values(output, "Transparency", "Base Color", "Emissive Color")
    return Shading(apply(shares_removed, diffuse, transparency), apply(shares_removed, radiance, transparency))


def _diffuse(reader: Reader, output: Output) -> Shading:
    return Shading(reader.value(output, "Color"))


def _toon(reader: Reader, output: Output) -> Shading:
    return _diffuse(reader, output) if output.node.component == "DIFFUSE" else Shading()


def _emission(reader: Reader, output: Output) -> Shading:
    return Shading(BLACK, apply(np.multiply, *reader.values(output, "Color", "Strength")))


def _mix_shader(reader: Reader, output: Output) -> Shading:
    factor = apply(saturate, reader.value(output, "Fac"))
    a, b = reader.surface(output, "Shader"), reader.surface(output, "Shader_001")
    return Shading(apply(lerp, factor, a.reflectance, b.reflectance), apply(lerp, factor, a.radiance, b.radiance))


def _add_shader(reader: Reader, output: Output) -> Shading:
    a, b = reader.surface(output, "Shader"), reader.surface(output, "Shader_001")
    return Shading(apply(np.add, a.reflectance, b.reflectance), apply(np.add, a.radiance, b.radiance))


def _no_diffuse(reader: Reader, output: Output) -> Shading:
    return Shading()


SHADER_NODES: dict[str, Callable[[Reader, Output], Shading]] = {
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeEeveeSpecular": _eevee_specular,
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeSubsurfaceScattering": _diffuse,
    "ShaderNodeBsdfToon": _toon,
    "ShaderNodeEmission": _emission,
    "ShaderNodeMixShader": _mix_shader,
    "ShaderNodeAddShader": _add_shader,
} | dict.fromkeys(
    (
        "ShaderNodeBackground",
        "ShaderNodeBsdfAnisotropic",
        "ShaderNodeBsdfGlass",
        "ShaderNodeBsdfGlossy",
        "ShaderNodeBsdfHair",
        "ShaderNodeBsdfHairPrincipled",
        "ShaderNodeBsdfMetallic",
        "ShaderNodeBsdfRayPortal",
        "ShaderNodeBsdfRefraction",
        "ShaderNodeBsdfSheen",
        "ShaderNodeBsdfTranslucent",
        "ShaderNodeBsdfTransparent",
        "ShaderNodeHoldout",
        "ShaderNodeVolumeAbsorption",
        "ShaderNodeVolumeCoefficients",
        "ShaderNodeVolumePrincipled",
        "ShaderNodeVolumeScatter",
    ),
    _no_diffuse,
)
