"""Where the values of a bake go, and on which scale."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from ..errors import SettingsError
from ..settings import member_of

MAX_EXPOSURE = 32.0  # stops

CORNER_SUFFIX = " Color"  # of the copy that the viewport shows


class Target(enum.StrEnum):
    """What a value belongs to."""

    FACE = "FACE"
    CORNER = "CORNER"
    POINT = "POINT"
    LIGHTMAP = "LIGHTMAP"  # the texels of an image


class Scale(enum.StrEnum):
    """What number an open face gets."""

    WHITE = "WHITE"  # open is white, a layer to multiply by
    PAPER = "PAPER"  # W of eq. 5 as it is


class SharedMeshes(enum.StrEnum):
    """What happens to a mesh that several baked objects use."""

    SEPARATE = "SEPARATE"  # each object gets a copy of its own
    AVERAGE = "AVERAGE"  # one mesh, the mean of its objects' values


class ImageFormat(enum.StrEnum):
    """How the pixels are stored: EXR and HDR linear and unbounded, PNG sRGB-encoded and clamped to 0 .. 1."""

    EXR_HALF = "EXR_HALF"
    EXR_FULL = "EXR_FULL"
    PNG_8 = "PNG_8"
    PNG_16 = "PNG_16"
    HDR = "HDR"

    @property
    def extension(self) -> str:
        return "." + self.value.partition("_")[0].lower()

    @property
    def is_linear(self) -> bool:
        return self not in {ImageFormat.PNG_8, ImageFormat.PNG_16}


@dataclass(frozen=True)
class OutputSettings:
    """Where the result goes.

    Parameters
    ----------
    target : Target
    attribute_name : str
        Of the colour attribute; with target LIGHTMAP of the image, and of the UV map that unwrapping makes.
    scale : Scale
    shared_meshes : SharedMeshes
    corner_copy : bool
        With target FACE, also write a flat CORNER colour attribute, which viewport, painting and exporters can see.
    exposure : float
        Stops by which light is brightened before it is stored, -32 .. 32. Obscurances have none.
    image_path : str
        File of the lightmap; '' packs it into the .blend.
    image_format : ImageFormat

    Raises
    ------
    SettingsError
        When the exposure is out of range, or a lightmap should be the mean over the users of a mesh.
    """

    target: Target = Target.FACE
    attribute_name: str = "Obscurance"
    scale: Scale = Scale.WHITE
    shared_meshes: SharedMeshes = SharedMeshes.SEPARATE
    corner_copy: bool = True
    exposure: float = 0.0
    image_path: str = ""
    image_format: ImageFormat = ImageFormat.EXR_HALF

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", Target(self.target))
        object.__setattr__(self, "scale", Scale(self.scale))
        object.__setattr__(self, "shared_meshes", SharedMeshes(self.shared_meshes))
        object.__setattr__(self, "image_format", member_of(ImageFormat, self.image_format, "image format"))
        if self.target is Target.LIGHTMAP and self.shared_meshes is SharedMeshes.AVERAGE:
            raise SettingsError("a lightmap has room for each object: use shared meshes SEPARATE with it")
        if not -MAX_EXPOSURE <= self.exposure <= MAX_EXPOSURE:
            raise SettingsError(
                f"exposure is {self.exposure:g} stops, allowed are -{MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}"
            )

    def layers(self) -> list[tuple[str, str]]:
        """Names and domains of the colour attributes to write, the one to show first."""
        if self.target is Target.LIGHTMAP:
            return []
        layers = [(self.attribute_name, self.target.value)]
        if self.target is Target.FACE and self.corner_copy:
            layers.insert(0, (self.attribute_name + CORNER_SUFFIX, "CORNER"))
        return layers

    def layer_names(self) -> list[str]:
        """Names of `layers`."""
        return [name for name, _domain in self.layers()]

    @property
    def needs_rest(self) -> bool:
        """Whether values belong to places on the unmodified mesh, which modifiers must carry along."""
        return self.target in {Target.CORNER, Target.POINT}
