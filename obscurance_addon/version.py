"""The version, which the extension manifest alone states."""

from __future__ import annotations

import tomllib
from pathlib import Path


def version() -> str:
    """Version of the add-on as in blender_manifest.toml: inside the package once installed, above it in a checkout."""
    package = Path(__file__).parent
    for folder in (package, package.parent):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file():
            return tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]
    raise FileNotFoundError("blender_manifest.toml is missing beside the add-on: install the extension again")
