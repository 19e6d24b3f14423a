"""The version, which the extension manifest alone states."""

from __future__ import annotations

import importlib.metadata
import tomllib
from pathlib import Path


def version() -> str:
    """Version that blender_manifest.toml states: it lies in an extension, and above a checkout; else pip knows it."""
    package = Path(__file__).parent
    for folder in (package, package.parent):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file():
            return tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]
    return importlib.metadata.version("obscurance-addon")
