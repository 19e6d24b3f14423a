"""Arguments of the command line, and the settings that they change."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from ..core.errors import ObscuranceError
from ..core.falloff import Falloff
from ..core.light import Ambient, LightSettings, Quantity
from ..core.lightmap import LightmapSettings, Unwrapper, UvMode
from ..core.order import ImageFormat, OutputSettings, Target
from ..core.settings import BakeSettings, Sampler
from ..version import version
from .targets import Targets, images


def parse(arguments: list[str]) -> argparse.Namespace:
    """Parse and check arguments; leaves with exit status 2 when they make no sense."""
    parser = argparse.ArgumentParser(prog="obscurance", description="Bake obscurances into .blend files.")
    parser.add_argument("--version", action="version", version=version())
    commands = parser.add_subparsers(dest="command", required=True)
    bake = commands.add_parser("bake", help="bake obscurances into color attributes")
    bake.add_argument("scenes", nargs="+", type=Path, metavar="SCENE.blend")
    where = bake.add_mutually_exclusive_group()
    where.add_argument("--output", type=Path, metavar="OUT.blend", help="file to write (default: in place)")
    where.add_argument("--output-dir", type=Path, metavar="DIR", help="folder to write files of the same names to")
    bake.add_argument("--scene", metavar="NAME", help="scene to bake (default: the one that is open in the file)")
    bake.add_argument("--objects", nargs="+", metavar="NAME", help="objects to bake (default: all that render)")
    bake.add_argument("--quantity", choices=[q.value for q in Quantity], help="what is stored (default: OBSCURANCE)")
    bake.add_argument("--ambient", choices=[a.value for a in Ambient], help="what ambient light is computed from")
    bake.add_argument(
        "--reflectors",
        type=_reflectors,
        metavar="AUTO|N",
        default=argparse.SUPPRESS,
        help="surfaces that pass on direct light, 0 for none",
    )
    bake.add_argument(
        "--indirect-only", action=argparse.BooleanOptionalAction, help="with RADIOSITY, leave out direct light"
    )
    bake.add_argument("--exposure", type=float, metavar="STOPS", help="brighten light before it is stored")
    bake.add_argument("--target", choices=["FACE", "CORNER", "POINT", "LIGHTMAP"])
    bake.add_argument(
        "--attribute",
        dest="attribute_name",
        metavar="NAME",
        help="name of the attribute, or of lightmap and UV map (default: Obscurance)",
    )
    bake.add_argument(
        "--corner-copy", action=argparse.BooleanOptionalAction, help="with target FACE, also write face corners or not"
    )
    fineness = bake.add_mutually_exclusive_group()
    fineness.add_argument("--rays", type=int, metavar="N", help="rays per patch")
    fineness.add_argument("--ray-budget", type=int, metavar="N", help="total number of rays, shared out by area")
    bake.add_argument(
        "--distance", type=_distance, metavar="METRES|auto", help="reach of the rays", default=argparse.SUPPRESS
    )
    bake.add_argument("--falloff", choices=[f.value for f in Falloff])
    bake.add_argument(
        "--bleeding", dest="use_bleeding", action=argparse.BooleanOptionalAction, help="tint by the surroundings or not"
    )
    bake.add_argument("--scale", choices=["WHITE", "PAPER"])
    bake.add_argument("--shared-meshes", choices=["SEPARATE", "AVERAGE"])
    bake.add_argument(
        "--modifiers",
        choices=["VIEWPORT", "RENDER"],
        help="bake modifiers and levels as shown, or as they render",
    )
    bake.add_argument("--sampler", choices=[s.value for s in Sampler])
    bake.add_argument("--seed", type=int, metavar="N")
    bake.add_argument("--threads", type=int, metavar="N", help="0 for all processors")
    _add_lightmap(bake.add_argument_group("with target LIGHTMAP"))
    _add_frames(bake.add_argument_group("animation"))
    bake.add_argument("--report", type=Path, metavar="FILE.json", help="write what was done as JSON")
    bake.add_argument(
        "--trust-paths",
        action="store_true",
        help="write lightmaps where the .blend asks for, also outside of the output's folder",
    )
    bake.add_argument("--quiet", action="store_true", help="print errors only")
    options = parser.parse_args(_joined(arguments))
    if options.output and len(options.scenes) > 1:
        bake.error("--output takes one scene: give --output-dir for several")
    names = [scene.name for scene in options.scenes]
    if options.output_dir and len(set(names)) < len(names):
        bake.error("two scenes have the same file name, so --output-dir would write one over the other")
    if options.image_path and len(set(images(options))) < len(options.scenes):
        bake.error("--image would be written by several scenes: start it with // and have each in a folder of its own")
    if options.frames is None and (options.frame_cache or options.export):
        bake.error("--frame-cache and --export are of animations: give --frames too")
    if options.frames is not None and options.target == Target.LIGHTMAP:
        bake.error("--frames bakes attributes: give another --target than LIGHTMAP")
    if options.frames is not None and options.modifiers == "RENDER":
        bake.error("--frames bakes what the viewport shows: leave out --modifiers, and set levels alike in both")
    if len(options.scenes) > 1 and (options.frame_cache or options.export):
        bake.error("--frame-cache and --export take one scene")
    try:
        BakeSettings(**estimator_changes(options))
        LightSettings(**light_changes(options))
        OutputSettings(**output_changes(options))
        LightmapSettings(**lightmap_changes(options))
        options.targets = Targets(options)
    except ObscuranceError as error:
        bake.error(str(error))
    return options


def _add_lightmap(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--size", type=int, metavar="N", help="texels along a side of the image (default: 1024)")
    group.add_argument(
        "--texels-per-metre", type=float, metavar="X", help="density of texels, in as many image tiles as it takes"
    )
    group.add_argument("--uv-mode", choices=[mode.value for mode in UvMode], help="unwrap, or keep a UV map")
    group.add_argument(
        "--unwrapper", choices=[kind.value for kind in Unwrapper], help="the library that unwraps (default: UVUNWRAP)"
    )
    group.add_argument("--uv-map", metavar="NAME", help="UV map to keep (default: the one that renders)")
    group.add_argument("--margin", type=int, metavar="N", help="texels around faces at size 1024 (default: 16)")
    group.add_argument(
        "--adaptive", action=argparse.BooleanOptionalAction, help="interpolate where the surroundings are smooth"
    )
    group.add_argument("--error-bound", type=float, metavar="X", help="of interpolated values (default: 0.01)")
    group.add_argument(
        "--image", dest="image_path", metavar="PATH", help="file of the lightmap, // being the scene's folder"
    )
    group.add_argument("--image-format", choices=[kind.value for kind in ImageFormat])


def _add_frames(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--frames", type=_frames, metavar="FIRST-LAST", help="bake every frame of a range into a frame cache"
    )
    group.add_argument(
        "--frame-cache",
        type=Path,
        metavar="DIR",
        help="folder of the frame cache (default: beside the output, its name and _frames)",
    )
    group.add_argument(
        "--export", type=Path, metavar="FILE.usdc|FILE.abc", help="write the animation with its colors as well"
    )


def _joined(arguments: list[str]) -> list[str]:
    """The arguments with negative frames joined to their option, which argparse takes for an option else."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--frames" and re.match(r"-\d", argument):
            joined[-1] += "=" + argument
        else:
            joined.append(argument)
    return joined


def _frames(text: str) -> tuple[int, int]:
    """First and last frame."""
    found = re.fullmatch(r"(-?\d+)-(-?\d+)", text) or re.fullmatch(r"(-?\d+)()", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"'{text}' is no range of frames: write it as 1-250")
    first, last = int(found[1]), int(found[2] or found[1])
    if last < first:
        raise argparse.ArgumentTypeError(f"the frames {text} end before they begin: write the first one first")
    return first, last


def _distance(text: str) -> float | None:
    """Metres, or None for automatic."""
    try:
        return None if text.lower() == "auto" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is neither a number of metres nor 'auto'") from None


def _reflectors(text: str) -> int | None:
    """A number, or None for automatic."""
    try:
        return None if text.lower() == "auto" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is neither a number nor 'AUTO'") from None


def estimator_changes(options: argparse.Namespace) -> dict:
    """Estimator settings given as options, by name."""
    changes = _given(options, "rays", "ray_budget", "falloff", "use_bleeding", "sampler", "seed", "threads")
    if options.rays is not None or options.ray_budget == 0:
        changes["ray_budget"] = None  # a number of rays for each patch replaces a budget that the file may have
    if "distance" in options:
        changes["distance"] = options.distance
    return changes


def light_changes(options: argparse.Namespace) -> dict:
    """Light settings given as options, by name."""
    changes = _given(options, "quantity", "ambient", "indirect_only")
    if "reflectors" in options:
        changes["reflectors"] = options.reflectors
    return changes


def output_changes(options: argparse.Namespace) -> dict:
    """Output settings given as options, by name."""
    names = ("target", "attribute_name", "scale", "shared_meshes", "corner_copy", "exposure")
    return _given(options, *names, "image_path", "image_format")


def lightmap_changes(options: argparse.Namespace) -> dict:
    """Lightmap settings given as options, by name."""
    names = ("size", "texels_per_metre", "uv_mode", "unwrapper", "uv_map", "margin", "adaptive", "error_bound")
    return _given(options, *names)


def modifier_changes(options: argparse.Namespace) -> dict:
    """Which modifiers are baked, if given as an option."""
    return _given(options, "modifiers")


def _given(options: argparse.Namespace, *names: str) -> dict:
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}
