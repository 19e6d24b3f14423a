"""Runs all benchmarks and writes raw results and the table.

    python benchmarks/run.py [--only NAME ...] [--table] [--repeats N]

Raw JSON goes to benchmarks/results/, the tables to benchmarks/README.md and docs/light_error.md, a plot to
docs/images/lightmap_error.svg; --only renews those parts and keeps the others.
Times are of one shared machine: read the ratios, which compare things measured side by side in one run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import animation_table
import light_table
import lightmap_table
import table
import unwrappers_table

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
LIGHT_PAGE = HERE.parent / "docs" / "light_error.md"
LIGHTMAP_PLOT = HERE.parent / "docs" / "images" / "lightmap_error.svg"
SCALING_SIZES = (10_000, 31_684, 100_489, 315_844, 1_000_000)  # faces of square grids, half a decade apart
STREAMS_FACES, STREAMS_RAYS = 31_684, (16, 64, 1024, 4096)
MEMORY_SIZE = 8192  # of a lightmap
NAMES = (
    "trace_rate",
    "whole_bake",
    "scaling",
    "streams",
    "cycles_ao",
    "foliage",
    "light_error",
    "lightmap",
    "animation",
)


def main() -> None:
    """Run each benchmark in a process of its own, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--table", action="store_true", help="only make the table anew from the results")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--worker", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        _work(*options.worker, repeats=options.repeats)
        return
    RESULTS.mkdir(exist_ok=True)
    for name in () if options.table else options.only:
        print(f"{name} ...", flush=True)
        if name == "scaling":
            results = [_in_process(name, options.repeats, str(size), "64") for size in SCALING_SIZES]
        elif name == "streams":
            faces = str(STREAMS_FACES)
            results = [_in_process("scaling", options.repeats, faces, str(rays)) for rays in STREAMS_RAYS]
        else:
            results = _in_process(name, options.repeats)
        if name == "lightmap":
            size = str(MEMORY_SIZE)
            results["memory"] = [_in_process("lightmap.memory", 1, size, adaptive) for adaptive in ("0", "1")]
        record = {"machine": _machine(), "results": results}
        (RESULTS / f"{name}.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    _write_pages()


def _write_pages() -> None:
    pages = {
        HERE / "README.md": table.text(
            RESULTS,
            {
                "lightmap": lightmap_table.section,
                "unwrappers": unwrappers_table.section,
                "animation": animation_table.section,
            },
        ),
        LIGHT_PAGE: light_table.text(RESULTS),
    }
    if (RESULTS / "lightmap.json").is_file():
        pages[LIGHTMAP_PLOT] = lightmap_table.plot(RESULTS)
    for path, text in pages.items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")


def _in_process(*arguments: str | int) -> object:
    name, repeats, *rest = arguments
    command = [sys.executable, __file__, "--repeats", str(repeats), "--worker", str(name), *rest]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def _work(name: str, *arguments: str, repeats: int) -> None:
    sys.path.insert(0, str(HERE.parent))
    import obscurance_addon

    obscurance_addon.register()
    name, _, part = name.partition(".")
    measure = getattr(__import__(name), part or "run")
    result = measure(*map(int, arguments)) if arguments else measure(repeats)
    print("\n" + json.dumps(result), flush=True)
    os._exit(0)  # see obscurance_addon/__main__.py


def _machine() -> dict:
    from importlib.metadata import version

    packages = {name: version(name) for name in ("bpy", "embreex", "numpy")}
    return {"processors": len(os.sched_getaffinity(0)), "machine": platform.machine(), **packages}


if __name__ == "__main__":
    main()
