"""Edits scenes at random while Live Preview follows them, and compares it with full bakes; ends with 1 if they differ.

python tools/random_edits.py --steps 10000 --seed 1
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

import bpy

import obscurance_addon
from tests.blender.animation.random_runs import DifferenceError, run


def main() -> int:
    """The command; 0 where nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1, help="of the first scene; the next one has the next seed")
    parser.add_argument("--scene-steps", type=int, default=200, help="edits of one scene")
    parser.add_argument("--verbose", action="store_true", help="print every edit")
    options = parser.parse_args()
    obscurance_addon.register()
    began, found, compared = time.perf_counter(), 0, 0
    edits: list[str] = []

    def tell(edit: str) -> None:
        edits.append(edit)
        if options.verbose:
            print(f"  {edit}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        for number, first in enumerate(range(0, options.steps, options.scene_steps)):
            seed = options.seed + number
            print(f"seed {seed}", flush=True)
            try:
                compared += run(min(options.scene_steps, options.steps - first), seed, Path(folder), tell)
            except Exception as error:
                found += 1
                print(f"seed {seed}, after '{edits[-1]}': {type(error).__name__}: {error}", flush=True)
                if not isinstance(error, DifferenceError):
                    traceback.print_exception(error)
    print(
        f"Blender {bpy.app.version_string}: {len(edits):,} edits, {compared:,} comparisons with a full bake, "
        f"{found} failures, {time.perf_counter() - began:.0f} s",
        flush=True,
    )
    return int(found > 0)


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # the bpy module may crash while it takes down what is registered
