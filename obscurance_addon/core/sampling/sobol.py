"""Owen-scrambled Sobol points in four dimensions, with numpy alone (Blender ships no scipy).

Direction numbers of Joe and Kuo (2008) for dimensions 2 to 4; dimension 1 is the van der Corput sequence. The nested
uniform scrambling is hash-based: Laine and Karras (2011) with the constants of Burley, "Practical Hash-based Owen
Scrambling" (JCGT 2020).
"""

from __future__ import annotations

import numpy as np

DIMENSIONS = 4
_BITS = 32
_PRIMITIVES = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)))  # (degree s, coefficients a, initial m) of Joe and Kuo


def _direction_numbers() -> np.ndarray:
    columns = np.zeros((DIMENSIONS, _BITS), np.uint64)
    columns[0] = 1 << np.arange(_BITS - 1, -1, -1, dtype=np.uint64)
    for dimension, (degree, coefficients, initial) in enumerate(_PRIMITIVES, start=1):
        m = list(initial)
        for k in range(degree, _BITS):
            value = m[k - degree] ^ (m[k - degree] << degree)
            for j in range(1, degree):
                if coefficients >> (degree - 1 - j) & 1:
                    value ^= m[k - j] << j
            m.append(value)
        columns[dimension] = [m[k] << (_BITS - 1 - k) for k in range(_BITS)]
    return columns.astype(np.uint32)


_DIRECTIONS = _direction_numbers()


def sobol_points(first: int, count: int) -> np.ndarray:
    """Unscrambled Sobol points `first` .. `first + count - 1`.

    Returns
    -------
    ndarray, (count, 4) uint32
        Coordinates as 32-bit fixed point fractions.
    """
    index = np.arange(first, first + count, dtype=np.uint64)
    points = np.zeros((count, DIMENSIONS), np.uint32)
    for bit in range(int(first + count).bit_length()):
        is_set = (index >> np.uint64(bit) & np.uint64(1)).astype(bool)
        points[is_set] ^= _DIRECTIONS[:, bit]
    return points


def hash32(x: np.ndarray) -> np.ndarray:
    """Mix 32-bit integers well ("lowbias32" by Wellons): (...) uint32 -> (...) uint32."""
    x = np.array(x, np.uint32)
    x ^= x >> np.uint32(16)
    x *= np.uint32(0x7FEB352D)
    x ^= x >> np.uint32(15)
    x *= np.uint32(0x846CA68B)
    x ^= x >> np.uint32(16)
    return x


def owen_scramble(points: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Nested uniform scrambling of fixed point fractions.

    Parameters
    ----------
    points : ndarray, uint32
        Fractions to scramble; broadcast against `seeds`.
    seeds : ndarray, uint32
        One seed for each independent scrambling (and each dimension).

    Returns
    -------
    ndarray, uint32
        Scrambled fractions.
    """
    x = _reverse_bits(points) + seeds
    for constant in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        x ^= x * np.uint32(constant)
    return _reverse_bits(x)


def to_unit(points: np.ndarray) -> np.ndarray:
    """Fixed point fractions -> float64 in the open interval (0, 1)."""
    return (points + 0.5) * 2.0**-32


def _reverse_bits(x: np.ndarray) -> np.ndarray:
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        shift, mask = np.uint32(shift), np.uint32(mask)
        x = (x >> shift & mask) | (x & mask) << shift
    return x >> np.uint32(16) | x << np.uint32(16)
