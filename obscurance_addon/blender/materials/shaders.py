"""Shader nodes that scatter or emit light, by their identifier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.shading import BLACK, Constant, Shading, apply, lerp, saturate, shares_removed
from .nodes import Output, Reader

_WHITE = Constant((1.0,))


def _principled(reader: Reader, output: Output) -> Shading:
    alpha = apply(saturate, reader.value(output, "Alpha"))
    color, metallic, weight = reader.values(output, "Base Color", "Metallic", "Transmission Weight")
    glass = apply(shares_removed, apply(saturate, weight), metallic)  # metal is under all that transmits
    radiance = apply(np.multiply, *reader.values(output, "Emission Color", "Emission Strength"))
    through = apply(np.multiply, glass, apply(_glass_tint, color))
    return Shading(
        apply(np.multiply, apply(shares_removed, color, glass), alpha),
        apply(np.multiply, radiance, alpha),
        apply(lerp, alpha, _WHITE, through),
    )


def _glass_tint(color: np.ndarray) -> np.ndarray:
    """What passes one of the two surfaces of a glass body of this colour, as in Cycles' Principled BSDF."""
    return np.sqrt(saturate(color))


def _eevee_specular(reader: Reader, output: Output) -> Shading:
    transparency, diffuse, radiance = reader.values(output, "Transparency", "Base Color", "Emissive Color")
    return Shading(
        apply(shares_removed, diffuse, transparency),
        apply(shares_removed, radiance, transparency),
        apply(saturate, transparency),
    )


def _diffuse(reader: Reader, output: Output) -> Shading:
    return Shading(reader.value(output, "Color"))


def _toon(reader: Reader, output: Output) -> Shading:
    return _diffuse(reader, output) if output.node.component == "DIFFUSE" else Shading()


def _emission(reader: Reader, output: Output) -> Shading:
    return Shading(BLACK, apply(np.multiply, *reader.values(output, "Color", "Strength")))


def _mix_shader(reader: Reader, output: Output) -> Shading:
    factor = apply(saturate, reader.value(output, "Fac"))
    a, b = reader.surface(output, "Shader"), reader.surface(output, "Shader_001")
    return Shading(*(apply(lerp, factor, *pair) for pair in zip(a.expressions(), b.expressions(), strict=True)))


def _add_shader(reader: Reader, output: Output) -> Shading:
    a, b = reader.surface(output, "Shader"), reader.surface(output, "Shader_001")
    return Shading(*(apply(np.add, *pair) for pair in zip(a.expressions(), b.expressions(), strict=True)))


def _clear(reader: Reader, output: Output) -> Shading:
    """Light goes on straight, filtered by the colour; glass too, which bends it, as far as a mean over a face goes."""
    return Shading(transmission=reader.value(output, "Color"))


def _metal(reader: Reader, output: Output) -> Shading:
    """Metals scatter their colour: as much light as a mirror sends on, though to all sides."""
    if getattr(output.node, "fresnel_type", "F82") == "PHYSICAL_CONDUCTOR":
        return Shading(apply(_conductor_color, *reader.values(output, "IOR", "Extinction")))
    return Shading(reader.value(output, "Base Color"))


def _conductor_color(ior: np.ndarray, extinction: np.ndarray) -> np.ndarray:
    """Reflectance at normal incidence of a conductor (Fresnel)."""
    square = extinction * extinction
    return ((ior - 1.0) ** 2 + square) / ((ior + 1.0) ** 2 + square)


def _no_diffuse(reader: Reader, output: Output) -> Shading:
    return Shading()


SHADER_NODES: dict[str, Callable[[Reader, Output], Shading]] = {
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeEeveeSpecular": _eevee_specular,
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeSubsurfaceScattering": _diffuse,
    "ShaderNodeBsdfToon": _toon,
    "ShaderNodeEmission": _emission,
    "ShaderNodeBsdfTransparent": _clear,
    "ShaderNodeBsdfGlass": _clear,
    "ShaderNodeBsdfRefraction": _clear,
    "ShaderNodeBsdfGlossy": _diffuse,
    "ShaderNodeBsdfAnisotropic": _diffuse,
    "ShaderNodeBsdfMetallic": _metal,
    "ShaderNodeMixShader": _mix_shader,
    "ShaderNodeAddShader": _add_shader,
} | dict.fromkeys(
    (
        "ShaderNodeBackground",
        "ShaderNodeBsdfHair",
        "ShaderNodeBsdfHairPrincipled",
        "ShaderNodeBsdfRayPortal",
        "ShaderNodeBsdfSheen",
        "ShaderNodeBsdfTranslucent",
        "ShaderNodeHoldout",
        "ShaderNodeVolumeAbsorption",
        "ShaderNodeVolumeCoefficients",
        "ShaderNodeVolumePrincipled",
        "ShaderNodeVolumeScatter",
    ),
    _no_diffuse,
)
