"""Colour arithmetic of Blender's shader nodes, as Cycles does it. numpy only.

Every function takes and returns arrays whose last axis holds a colour (3) or a grey value (1); they broadcast.
Colours are linear unless said otherwise, and may lie outside 0 .. 1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of linear Rec. 709


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Linear values of sRGB-encoded ones (IEC 61966-2-1), float32 of any shape; values below 0 stay linear."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve).astype(np.float32)


def tame(values: np.ndarray, most: float) -> np.ndarray:
    """Values as float32 within -most .. most, 0 where they are no number."""
    return np.clip(np.nan_to_num(values), -most, most).astype(np.float32)


def saturate(a: np.ndarray) -> np.ndarray:
    """Clamped to 0 .. 1."""
    return np.clip(a, 0.0, 1.0)


def lerp(factor: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """From a, at factor 0, to b, at factor 1; beyond them outside."""
    return a + (b - a) * factor


def mean(a: np.ndarray) -> np.ndarray:
    """Grey mean of the channels."""
    return a.mean(axis=-1, keepdims=True)


def luminance(a: np.ndarray) -> np.ndarray:
    """Grey value of a colour; grey stays what it is."""
    return a if a.shape[-1] == 1 else (a @ LUMINANCE)[..., None]


def channel(index: int, a: np.ndarray) -> np.ndarray:
    """One channel as grey; grey is its own channel."""
    return a[..., :1] if a.shape[-1] == 1 else a[..., index : index + 1]


def combine(*channels: np.ndarray) -> np.ndarray:
    """Colour of three grey channels."""
    return np.concatenate(np.broadcast_arrays(*(a[..., :1] for a in channels)), axis=-1)


def divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b, and 0 where b is 0."""
    return np.where(b == 0.0, np.float32(0.0), a / np.where(b == 0.0, np.float32(1.0), b))


def power(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a ** b, and 0 where that is not real."""
    return np.where((a < 0.0) & (b != np.floor(b)), np.float32(0.0), np.power(a, b))


def gamma(color: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """color ** exponent; what is not positive stays."""
    return np.where(color > 0.0, np.power(np.maximum(color, 0.0), exponent), color)


def bright_contrast(color: np.ndarray, bright: np.ndarray, contrast: np.ndarray) -> np.ndarray:
    """Contrast about 0.5, then brightness, never negative."""
    return np.maximum((1.0 + contrast) * color + bright - 0.5 * contrast, 0.0)


def invert(factor: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Lerp to the complement."""
    return lerp(factor, color, 1.0 - color)


def clamp(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """At least low, and at most high even where high is below low."""
    return np.minimum(np.maximum(value, low), high)


def clamp_range(value: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between a and b, whichever is the lower one."""
    return clamp(value, np.minimum(a, b), np.maximum(a, b))


def map_range(
    value: np.ndarray, low: np.ndarray, high: np.ndarray, to_low: np.ndarray, to_high: np.ndarray
) -> np.ndarray:
    """Linear map that takes low .. high to to_low .. to_high; an empty range goes to to_low."""
    return to_low + divide(value - low, high - low) * (to_high - to_low)


def shares_removed(value: np.ndarray, *shares: np.ndarray) -> np.ndarray:
    """What is left of a value after each of these shares of the light, clamped to 0 .. 1, has gone elsewhere."""
    for share in shares:
        value = value * (1.0 - saturate(share))
    return value


def shift_hsv(
    hue: np.ndarray, saturation: np.ndarray, value: np.ndarray, factor: np.ndarray, color: np.ndarray
) -> np.ndarray:
    """Hue turned (0.5 leaves it), saturation and value multiplied, mixed in by a factor; never negative."""
    h, s, v = _to_hsv(color)
    shifted = _from_hsv(h + hue + 0.5, saturate(s * saturation), v * value)
    return np.maximum(lerp(factor, color, shifted), 0.0)


def _to_hsv(color: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r, g, b = (channel(i, color) for i in range(3))
    high = np.maximum(np.maximum(r, g), b)
    span = high - np.minimum(np.minimum(r, g), b)
    green_or_blue = np.where(high == g, 2.0 + divide(b - r, span), 4.0 + divide(r - g, span))
    sector = np.where(high == r, divide(g - b, span), green_or_blue)
    return np.mod(sector / 6.0, 1.0), divide(span, high), high


def _from_hsv(hue: np.ndarray, saturation: np.ndarray, value: np.ndarray) -> np.ndarray:
    sector = 6.0 * np.mod(hue, 1.0) + np.array([0.0, 4.0, 2.0], np.float32)
    ramp = saturate(np.abs(np.mod(sector, 6.0) - 3.0) - 1.0)
    return (value * (1.0 + saturation * (ramp - 1.0))).astype(np.float32)


def look_up(table: np.ndarray, stepped: bool, x: np.ndarray) -> np.ndarray:
    """Values of a table over 0 .. 1.

    Parameters
    ----------
    table : ndarray, (n, c)
        At n evenly spaced places, the first at 0 and the last at 1.
    stepped : bool
        The value at the place before x instead of the line between two places.
    x : ndarray, (..., 1)
        Clamped to 0 .. 1; NaN counts as 0.

    Returns
    -------
    ndarray, (..., c)
    """
    position = saturate(np.nan_to_num(x[..., 0])) * np.float32(len(table) - 1)
    index = np.minimum(position.astype(np.int64), len(table) - 2)
    weight = (position - index)[..., None]
    return lerp(weight >= 1.0 if stepped else weight, table[index], table[index + 1])


def curve_channels(tables: np.ndarray, factor: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Each channel through its own table, (3, n) as for `look_up`, mixed in by a factor."""
    curved = combine(*(look_up(tables[i][:, None], False, channel(i, color)) for i in range(3)))
    return lerp(factor, color, curved)


def blend(mode: str, factor: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Lerp from a to what one of the BLENDS makes of a and b."""
    return lerp(factor, a, BLENDS[mode](a, b))


def calculate(operation: str, *values: np.ndarray) -> np.ndarray:
    """What one of the operations in MATH makes of its operands."""
    return MATH[operation][1](*values)


BLENDS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "MIX": lambda a, b: b,
    "MULTIPLY": np.multiply,
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "SCREEN": lambda a, b: 1.0 - (1.0 - a) * (1.0 - b),
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
}

# Number of operands and function of the Math node's operations.
MATH: dict[str, tuple[int, Callable[..., np.ndarray]]] = {
    "ADD": (2, np.add),
    "SUBTRACT": (2, np.subtract),
    "MULTIPLY": (2, np.multiply),
    "DIVIDE": (2, divide),
    "POWER": (2, power),
    "MINIMUM": (2, np.minimum),
    "MAXIMUM": (2, np.maximum),
    "MULTIPLY_ADD": (3, lambda a, b, c: a * b + c),
    "LESS_THAN": (2, lambda a, b: (a < b).astype(np.float32)),
    "GREATER_THAN": (2, lambda a, b: (a > b).astype(np.float32)),
    "SQRT": (1, lambda a: np.sqrt(np.maximum(a, 0.0))),
    "ABSOLUTE": (1, np.abs),
}
