"""The measurements of the Cornell box, and its measured spectra as linear RGB.

Source: Cornell University Program of Computer Graphics, "Cornell Box Data",
https://www.graphics.cornell.edu/online/box/data.html. Lengths in millimetres; x runs to the left as seen from the
camera, y up, z away from it.
"""

from __future__ import annotations

import numpy as np

Point = tuple[float, float, float]

CAMERA_POSITION = (278.0, 273.0, -800.0)
CAMERA_DIRECTION = (0.0, 0.0, 1.0)
CAMERA_FOCAL_LENGTH = 35.0
CAMERA_SENSOR_WIDTH = 25.0

# Corners from the left front one, counter-clockwise as seen from above: left front, right front, right back, left back.
FLOOR: tuple[Point, ...] = ((552.8, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 559.2), (549.6, 0.0, 559.2))
CEILING: tuple[Point, ...] = ((556.0, 548.8, 0.0), (0.0, 548.8, 0.0), (0.0, 548.8, 559.2), (556.0, 548.8, 559.2))
LIGHT: tuple[Point, ...] = ((343.0, 548.8, 227.0), (213.0, 548.8, 227.0), (213.0, 548.8, 332.0), (343.0, 548.8, 332.0))

# Tops of the blocks in the published order, which is counter-clockwise as seen from above; the blocks stand upright on
# the floor.
SHORT_BLOCK_TOP: tuple[Point, ...] = (
    (130.0, 165.0, 65.0),
    (82.0, 165.0, 225.0),
    (240.0, 165.0, 272.0),
    (290.0, 165.0, 114.0),
)
TALL_BLOCK_TOP: tuple[Point, ...] = (
    (423.0, 330.0, 247.0),
    (265.0, 330.0, 296.0),
    (314.0, 330.0, 456.0),
    (472.0, 330.0, 406.0),
)

WAVELENGTHS = np.arange(400.0, 701.0, 4.0)
"""Nanometres at which the reflectances were measured."""

# fmt: off
WHITE_SPECTRUM = np.array([
    .343, .445, .551, .624, .665, .687, .708, .723, .715, .710, .745, .758, .739, .767, .777, .765, .751, .745, .748,
    .729, .745, .757, .753, .750, .746, .747, .735, .732, .739, .734, .725, .721, .733, .725, .732, .743, .744, .748,
    .728, .716, .733, .726, .713, .740, .754, .764, .752, .736, .734, .741, .740, .732, .745, .755, .751, .744, .731,
    .733, .744, .731, .712, .708, .729, .730, .727, .707, .703, .729, .750, .760, .751, .739, .724, .730, .740, .737,
])
GREEN_SPECTRUM = np.array([
    .092, .096, .098, .097, .098, .095, .095, .097, .095, .094, .097, .098, .096, .101, .103, .104, .107, .109, .112,
    .115, .125, .140, .160, .187, .229, .285, .343, .390, .435, .464, .472, .476, .481, .462, .447, .441, .426, .406,
    .373, .347, .337, .314, .285, .277, .266, .250, .230, .207, .186, .171, .160, .148, .141, .136, .130, .126, .123,
    .121, .122, .119, .114, .115, .117, .117, .118, .120, .122, .128, .132, .139, .144, .146, .150, .152, .157, .159,
])
RED_SPECTRUM = np.array([
    .040, .046, .048, .053, .049, .050, .053, .055, .057, .056, .059, .057, .061, .061, .060, .062, .062, .062, .061,
    .062, .060, .059, .057, .058, .058, .058, .056, .055, .056, .059, .057, .055, .059, .059, .058, .059, .061, .061,
    .063, .063, .067, .068, .072, .080, .090, .099, .124, .154, .192, .255, .287, .349, .402, .443, .487, .513, .558,
    .584, .620, .606, .609, .651, .612, .610, .650, .638, .627, .620, .630, .628, .642, .639, .657, .639, .635, .642,
])
# fmt: on

LIGHT_SPECTRUM = np.interp(WAVELENGTHS, [400.0, 500.0, 600.0, 700.0], [0.0, 8.0, 15.6, 18.4])
"""Emission of the light, published at four wavelengths in arbitrary units; straight lines between them."""

LIGHT_REFLECTANCE = 0.78
"""Reflectance of the light's surface, the same at every wavelength."""

XYZ_TO_REC709 = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
"""Linear part of IEC 61966-2-1."""

D65_WHITE = np.array([0.9505, 1.0, 1.0890])
"""XYZ of the white point of Rec.709, as in IEC 61966-2-1."""

BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Cone responses of the Bradford chromatic adaptation (as used by ICC profiles)."""


def to_linear_rgb(spectrum: np.ndarray) -> tuple[float, float, float]:
    """Convert a spectrum to linear Rec.709 such that a spectrum of ones gives (1, 1, 1).

    The spectrum is integrated with the CIE 1931 observer under an equal-energy illuminant, its white is adapted to D65
    by Bradford's method, and the result is expressed in Rec.709 primaries.

    Parameters
    ----------
    spectrum : ndarray, shape (76,)
        Values at `WAVELENGTHS`: a reflectance or an emission.

    Returns
    -------
    tuple of 3 float
        Linear red, green, blue, in the unit of the spectrum.
    """
    observer = _observer()
    normalised = observer / observer[1].sum()
    cones_of_white, cones_of_d65 = BRADFORD @ normalised.sum(axis=1), BRADFORD @ D65_WHITE
    adaptation = np.linalg.inv(BRADFORD) @ np.diag(cones_of_d65 / cones_of_white) @ BRADFORD
    red, green, blue = XYZ_TO_REC709 @ adaptation @ normalised @ spectrum
    return float(red), float(green), float(blue)


def _observer() -> np.ndarray:
    """Return the CIE 1931 colour matching functions at `WAVELENGTHS`, shape (3, 76).

    Piecewise Gaussian fit of Wyman, Sloan and Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching
    Functions", Journal of Computer Graphics Techniques 2(2), 2013: weight, centre, width below it, width above it.
    """
    lobes = (
        ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
        ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
        ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
    )

    def lobe(weight: float, centre: float, below: float, above: float) -> np.ndarray:
        offset = WAVELENGTHS - centre
        return weight * np.exp(-0.5 * (offset / np.where(offset < 0.0, below, above)) ** 2)

    return np.array([sum(lobe(*values) for values in channel) for channel in lobes])
