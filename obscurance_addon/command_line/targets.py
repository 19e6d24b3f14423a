"""The files that a run writes: all can be written, no two are one, and the .blend does not choose where they are."""

from __future__ import annotations

import argparse
import os
import re
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import ObscuranceError
from ..core.files import check_folder_target, check_target, identities, is_stream

_TILE = re.compile(r"(?<!\d)[12]\d{3}(?!\d)")  # 1001 and so on, in the name of a file


def outputs(options: argparse.Namespace) -> list[Path]:
    """The file to write for each scene."""
    if options.output:
        return [options.output]
    return [options.output_dir / scene.name if options.output_dir else scene for scene in options.scenes]


def images(options: argparse.Namespace) -> list[Path]:
    """The lightmap file of each scene, where one is asked for."""
    path = options.image_path
    if not path.startswith("//"):
        return [Path(os.path.realpath(path))] * len(options.scenes)
    return [Path(os.path.realpath(scene)).parent / path[2:] for scene in options.scenes]


def frame_cache(options: argparse.Namespace, output: Path) -> Path:
    """The folder of the frame cache of a scene whose file is `output`."""
    return options.frame_cache or output.with_name(f"{output.stem}_frames")


@dataclass(frozen=True)
class _Claim:
    """A path that a run reads or writes, and how it came to be named."""

    whose: str
    path: Path

    def __str__(self) -> str:
        return f"{self.whose} '{self.path}'"

    @property
    def place(self) -> str:
        return os.path.realpath(self.path)


class Targets:
    """All paths that a run reads and writes; those that the options name are taken at once.

    Parameters
    ----------
    options : argparse.Namespace

    Raises
    ------
    ObscuranceError
        When two of them are one file.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._claims: dict[object, _Claim] = {}  # by what makes paths lead to one file
        self._folders: list[_Claim] = []
        for scene in options.scenes:
            self._claims |= dict.fromkeys(identities(scene), _Claim("the scene", scene))
        for scene, output in zip(options.scenes, outputs(options), strict=True):
            if not identities(scene) & identities(output):  # else it is baked in place
                self._claim("--output", output)
        if options.report and not is_stream(options.report):
            self._claim("--report", options.report)
        if options.export:
            self._claim("--export", options.export)
        if options.image_path:
            for scene, image in zip(options.scenes, images(options), strict=True):
                self._claim(f"--image of {scene}", image)
        if options.frames is not None:
            for output in outputs(options):
                self._claim_folder(f"the frame cache of {output}", frame_cache(options, output))

    def check_report(self) -> None:
        """Make sure, as far as one can tell before, that the report can be written; raises TargetError."""
        report = self._options.report
        if report and not is_stream(report):
            check_target(report)

    def check(self, output: Path) -> None:
        """The same for all files of a scene but its image."""
        check_target(output)
        if self._options.export:
            check_target(self._options.export)
        if self._options.frames is not None:
            check_folder_target(frame_cache(self._options, output))

    def claim_image(self, path: str, tiles: str, scene: Path, output: Path) -> None:
        """Take the file of a lightmap.

        Parameters
        ----------
        path, tiles : str
            Absolute, of the one page and, with <UDIM> in the name, of several.
        scene, output : Path

        Raises
        ------
        ObscuranceError
            When it is another file of this run, or the .blend chose a place outside of the output's folder.
        """
        given = self._options.image_path is not None
        home = os.path.dirname(os.path.realpath(output))
        if not (given or self._options.trust_paths or Path(os.path.realpath(path)).is_relative_to(home)):
            raise ObscuranceError(
                f"the .blend asks for a lightmap at '{path}', which is not below the output's folder '{home}': give "
                "--image PATH, or --trust-paths to write where files ask for"
            )
        self._claim(f"{'--image' if given else 'the image'} of {scene}", Path(path), os.path.realpath(tiles))

    def _claim(self, whose: str, path: Path, tiles: str | None = None) -> None:
        """Take a file, and for a lightmap its tiles; refuse it if it is, or lies in, what was taken before."""
        new, places = _Claim(whose, path), identities(path)
        for folder in self._folders:
            if Path(new.place).is_relative_to(folder.place):
                raise ObscuranceError(f"{new} lies in {folder}: choose another folder")
        may_be_tile = {_tiled(new.place, at) for at in _TILE.finditer(os.path.basename(new.place))}
        conflicts = places | {("tiles", name) for name in may_be_tile} | ({("tile", tiles)} if tiles else set())
        for old in (self._claims[key] for key in conflicts if key in self._claims):
            if (old.whose, old.place) != (new.whose, new.place):
                raise ObscuranceError(f"{new} names the same file as {old}: give each a name of its own")
        taken = places | {("tile", name) for name in may_be_tile} | ({("tiles", tiles)} if tiles else set())
        self._claims |= dict.fromkeys(taken, new)

    def _claim_folder(self, whose: str, path: Path) -> None:
        """Take a folder that is replaced as a whole; what was taken before must not lie in it."""
        new = _Claim(whose, path)
        for old in self._claims.values():
            if Path(old.place).is_relative_to(new.place):
                raise ObscuranceError(f"{old} lies in {new}: choose another folder")
        for old in self._folders:
            if old.whose != new.whose and old.place == new.place:
                raise ObscuranceError(f"{new} is the folder of {old}: give the files other names")
        self._folders.append(new)


def _tiled(place: str, at: re.Match) -> str:
    """A path with <UDIM> where the name of the file has a number."""
    folder, name = os.path.split(place)
    return os.path.join(folder, f"{name[: at.start()]}<UDIM>{name[at.end() :]}")
