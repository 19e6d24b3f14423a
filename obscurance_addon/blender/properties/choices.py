"""What a user may choose from: values of the core with a label and a tooltip each."""

from __future__ import annotations

from ...core.falloff import Falloff
from ...core.light import Ambient, Quantity
from ...core.lightmap import Unwrapper, UvMode
from ...core.order import ImageFormat, Scale, SharedMeshes, Target
from ...core.settings import Sampler
from ...core.updates import UpdateMode
from ..reading import Modifiers
from ..writing import ExportFormat


def _items(*choices: tuple) -> list[tuple[str, str, str]]:
    """Choices as an EnumProperty takes them."""
    return [(str(getattr(value, "value", value)), label, tip) for value, label, tip in choices]


QUANTITIES = _items(
    (Quantity.OBSCURANCE, "Obscurance", "How open each place is, tinted by its surroundings; no light is needed"),
    (Quantity.AMBIENT, "Ambient Light", "All indirect light, to be added to the direct light of a renderer"),
    (Quantity.DIRECT, "Direct Light", "The light of lamps, shining faces and the world, with shadows"),
    (Quantity.COMBINED, "Combined Light", "Direct and ambient light, and what faces emit: a finished lighting"),
    (
        Quantity.RADIOSITY,
        "Radiosity",
        "The same with all indirect light computed in full, as a reference: slow, and for whole faces only",
    ),
)
AMBIENTS = _items(
    (Ambient.RECEIVED, "Light Received", "From the direct light that surfaces receive and scatter"),
    (Ambient.EMISSION, "Light Emitted", "From what lamps and surfaces emit, as published in 2003"),
)
REFLECTOR_MODES = _items(
    ("AUTO", "Automatic", "Take the surfaces that scatter most direct light, where they are few"),
    ("NUMBER", "Number", "Take the number of surfaces given below"),
)
FALLOFFS = _items(
    (Falloff.SQRT, "Square Root", "The influence fades fast near a surface and joins open space without an edge"),
    (Falloff.CBRT, "Cube Root", "The influence fades fastest, so that only close contact darkens"),
    (Falloff.LINEAR, "Linear", "The influence fades evenly with distance"),
    (Falloff.EXPONENTIAL, "Exponential", "The influence fades between linear and square root"),
    (
        Falloff.STEP,
        "Step",
        "Anything within the distance blocks fully: this is classical ambient occlusion, without bleeding",
    ),
)
TARGETS = _items(
    (Target.FACE, "Faces", "Each face gets one color, in a face attribute"),
    (Target.CORNER, "Face Corners", "Colors vary smoothly over faces and break at sharp edges"),
    (Target.POINT, "Vertices", "Each vertex gets one color, and colors vary smoothly over all edges"),
    (Target.LIGHTMAP, "Lightmap", "One image holds all selected objects, with many colors on each face"),
)
UV_MODES = _items(
    (UvMode.UNWRAP, "Unwrap", "Make a UV map in which no two faces share a place, packed for all selected objects"),
    (UvMode.KEEP, "Keep UV Map", "Use a UV map that the objects have; where faces overlap in it, they share one color"),
)
UNWRAPPERS = _items(
    (Unwrapper.UVUNWRAP, "uvunwrap", "Fast also with large meshes, and with few charts"),
    (Unwrapper.XATLAS, "xatlas", "The one of earlier versions, slow with large meshes"),
)
RESOLUTIONS = _items(
    ("SIZE", "Size", "One square image, filled as densely as it can be"),
    ("DENSITY", "Texel Density", "The density given below, in as many image tiles as it takes"),
)
IMAGE_FORMATS = _items(
    (ImageFormat.EXR_HALF, "OpenEXR Half", "Linear colors without a limit, 16 bits a channel"),
    (ImageFormat.EXR_FULL, "OpenEXR Full", "Linear colors without a limit, 32 bits a channel"),
    (ImageFormat.PNG_8, "PNG 8 Bit", "Colors up to 1, sRGB-encoded, 8 bits a channel"),
    (ImageFormat.PNG_16, "PNG 16 Bit", "Colors up to 1, sRGB-encoded, 16 bits a channel"),
    (ImageFormat.HDR, "Radiance HDR", "Linear colors without a limit, 8 bits a channel and a common exponent"),
)
SCALES = _items(
    (Scale.WHITE, "White", "Open faces are white, so that the layer can be multiplied with a material's color"),
    (Scale.PAPER, "Paper", "Values are obscurances as published: open faces have the scene's mean reflectance"),
)
SHARED = _items(
    (SharedMeshes.SEPARATE, "Separate", "Each object that shares a mesh gets a copy of its own"),
    (SharedMeshes.AVERAGE, "Average", "The mesh stays shared and takes the mean of its objects"),
)
MODIFIERS = _items(
    (Modifiers.VIEWPORT, "Viewport", "Bake modifiers, levels of subdivision and hair as the viewport shows them"),
    (Modifiers.RENDER, "Render", "Bake them as they render, also what is switched off in the viewport"),
)
SAMPLERS = _items(
    (Sampler.SOBOL, "Sobol", "Rays follow scrambled Sobol points, which leave far less noise for the same number"),
    (Sampler.RANDOM, "Random", "Rays are random, as a comparison"),
)
DISTANCE_MODES = _items(
    (
        "AUTO",
        "Automatic",
        "Rays reach a fifth of the size of what is baked and stands by it, without skies and what is far away",
    ),
    ("METRES", "Metres", "Rays reach the distance given below"),
)
UPDATE_MODES = _items(
    (UpdateMode.EXACT, "Exactly", "All faces that what moves can reach, so that the result is that of a full bake"),
    (UpdateMode.LIST, "2003 List", "Faces on the list of the published method, which misses some, as a comparison"),
)
EXPORT_FORMATS = _items(
    (ExportFormat.GLTF, "glTF", "Make the copy that arrives as COLOR_0, with values limited to 1"),
    (ExportFormat.USD, "USD", "Make the copy that arrives as the display color"),
    (ExportFormat.ALEMBIC, "Alembic", "Make the copy that arrives as the color set Cd, with 8 bits and values up to 1"),
)
