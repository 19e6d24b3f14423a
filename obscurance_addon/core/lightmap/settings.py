"""What a lightmap is asked to be, checked once at construction."""

from __future__ import annotations

import enum
import math
import numbers
from dataclasses import dataclass, replace

from ..errors import SettingsError
from ..settings import member_of, whole_number

MIN_SIZE, MAX_SIZE = 256, 8192
MAX_MARGIN = 64
CHART_SIDE = 4  # texels of a small chart, about; more of them than leave each so much are not worth a page
MARGIN_SIZE = 1024  # the page size for which the margin is given
MIN_ERROR_BOUND, MAX_ERROR_BOUND = 1e-4, 0.5


class UvMode(enum.StrEnum):
    """Where each face lies in the lightmap."""

    UNWRAP = "UNWRAP"  # charts are made and packed anew
    KEEP = "KEEP"  # as an existing UV map says


class Unwrapper(enum.StrEnum):
    """The library that cuts and packs charts."""

    XATLAS = "XATLAS"
    UVUNWRAP = "UVUNWRAP"

    @property
    def library(self) -> str:
        """The name of its package."""
        return self.value.lower()


@dataclass(frozen=True)
class LightmapSettings:
    """Settings of a lightmap.

    Parameters
    ----------
    size : int
        Texels along the side of a page, 256 .. 8192.
    texels_per_metre : float or None
        Density of texels; as many pages as it takes. None takes the greatest density that fits one page.
    uv_mode : UvMode
    unwrapper : Unwrapper
    uv_map : str
        The UV map to keep; '' takes the one that each mesh renders with.
    margin : int
        Texels by which charts are continued, at a page size of 1024; it grows with the page. 0 .. 64.
    adaptive : bool
        Interpolate where obscurances vary smoothly, instead of casting rays from every texel.
    error_bound : float
        How far an interpolated value may be off, where an open texel is 1; 0.0001 .. 0.5.

    Raises
    ------
    SettingsError
        When a value is out of range.
    """

    size: int = 1024
    texels_per_metre: float | None = None
    uv_mode: UvMode = UvMode.UNWRAP
    unwrapper: Unwrapper = Unwrapper.UVUNWRAP
    uv_map: str = ""
    margin: int = 16
    adaptive: bool = True
    error_bound: float = 0.01

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", whole_number("lightmap size", self.size, MIN_SIZE, MAX_SIZE))
        object.__setattr__(self, "uv_mode", member_of(UvMode, self.uv_mode, "UV mode"))
        object.__setattr__(self, "unwrapper", member_of(Unwrapper, self.unwrapper, "unwrapper"))
        object.__setattr__(self, "margin", whole_number("margin", self.margin, 0, MAX_MARGIN))
        density = self.texels_per_metre
        if density is not None and not (isinstance(density, numbers.Real) and 0.0 < density < math.inf):
            raise SettingsError(f"texels per metre is {density!r}: give a number above 0, or a size alone")
        if not MIN_ERROR_BOUND <= self.error_bound <= MAX_ERROR_BOUND:
            raise SettingsError(
                f"error bound is {self.error_bound:g}, allowed are {MIN_ERROR_BOUND:g} to {MAX_ERROR_BOUND:g}"
            )

    @property
    def margin_texels(self) -> int:
        """The margin at this page size."""
        return -(-self.margin * self.size // MARGIN_SIZE)

    def cure_for(self, charts: int) -> str:
        """What helps where so many charts do not fit a page of this size, half a sentence."""
        sizes = [2**k for k in range(MIN_SIZE.bit_length() - 1, MAX_SIZE.bit_length()) if 2**k > self.size]
        for margin in (self.margin, *(2**k for k in range(MAX_MARGIN.bit_length())[::-1] if 2**k < self.margin), 0):
            for size in (self.size, *sizes) if margin < self.margin else sizes:
                other = replace(self, size=size, margin=margin)
                if charts * (CHART_SIDE + other.padding) ** 2 <= size**2:
                    larger = f"raise the size to {size} (Size, --size {size})" if size > self.size else ""
                    lower = f"lower the margin to {margin} (Margin, --margin {margin})" if margin < self.margin else ""
                    return " and ".join(filter(None, (larger, lower)))
        return "unwrap fewer objects at once, or give a density of texels, which takes as many pages as it needs"

    @property
    def padding(self) -> int:
        """Texels kept free between charts: a quarter of the margin, enough for two levels of a texture pyramid."""
        return max(2, self.margin_texels // 4)
