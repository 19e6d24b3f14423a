"""Write the sample scenes as .blend files.

    python sample_blends/make_samples.py [--output-dir DIR] [NAME...]

Needs a Python that has Blender as the module bpy; version 4.2 writes files that 4.2 and everything later opens.
Without names all scenes are written. README.md tells where every number comes from.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:
    sys.path.insert(0, str(HERE))  # the folder is no package: its modules stand beside each other

import scene_cornell_box  # noqa: E402
import scene_infinite  # noqa: E402
import scene_light_near_wall  # noqa: E402
import scene_room  # noqa: E402
from scene_description import Sample  # noqa: E402

SAMPLES: dict[str, Callable[[], Sample]] = {
    "cornell_box": scene_cornell_box.sample,
    "light_near_wall": scene_light_near_wall.sample,
    "room_1423": lambda: scene_room.sample(1423),
    "room_4016": lambda: scene_room.sample(4016),
    "infinite_5508": lambda: scene_infinite.sample(5508),
    "infinite_13824": lambda: scene_infinite.sample(13824),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the scenes named on the command line and return the exit status."""
    parser = argparse.ArgumentParser(description="Write the sample scenes as .blend files.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(SAMPLES)} (default: all)")
    parser.add_argument("--output-dir", type=Path, default=HERE, help="folder to write to (default: this script's)")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in SAMPLES]
    if unknown:
        parser.error(f"no sample named {', '.join(unknown)}")

    from blend_file import write_blend  # here, so that the scenes can be looked at without Blender

    options.output_dir.mkdir(parents=True, exist_ok=True)
    for name in options.names or SAMPLES:
        sample = SAMPLES[name]()
        path = options.output_dir / f"{name}.blend"
        write_blend(sample, path)
        counts = f"{len(sample.quads())} polygons, {sample.patch_count()} patches"
        print(f"{path.name}: {counts}, {path.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
