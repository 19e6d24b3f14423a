"""Turns the raw results of light_error.py into docs/light_error.md."""

from __future__ import annotations

import json
import statistics
from pathlib import Path

from table import against, markdown_table

_HEAD = """# Indirect light beside radiosity

    python benchmarks/run.py --only light_error

makes the raw results (`benchmarks/results/light_error.json`) and this page; nothing on it is typed by hand.
[light.md](light.md) says what it means.

The reference is radiosity on the same patches, with 4,096 rays a patch (`RADIOSITY --indirect-only`). *Error* is the
area-weighted relative root mean square difference of the indirect light over all channels, shining faces left out;
*shape* the same after the best common factor; *energy* the ratio of the sums. *Seconds* are medians of one run on two
shared processors and hold the whole computation with the direct light, the error estimate and the ray tracer's tree;
*rays* count all of it. Obscurances and direct light have 64 rays a patch and source, automatic distance, square root.

"""


def text(results: Path) -> str:
    """The page, from the results in a folder."""
    record = json.loads((results / "light_error.json").read_text(encoding="utf-8"))
    parts = [_HEAD, _aims(record["results"])]
    for scene in record["results"]["scenes"]:
        parts.append(
            f"## {scene['scene']}\n\n{scene['patches']:,} patches; the reference's own noise is "
            f"{scene['reference_noise']:.4f}.\n\n"
        )
        parts.append(markdown_table(["", "error", "shape", "energy", "seconds", "rays"], map(_row, scene["rows"])))
    machine = record["machine"]
    parts.append(
        f"{machine['processors']} processors ({machine['machine']}), bpy {machine['bpy']}, embreex "
        f"{machine['embreex']}, numpy {machine['numpy']}.\n"
    )
    return "".join(parts)


def _row(row: dict) -> list[str]:
    label = row["method"]
    if "automatic" in label:
        label += f" ({row['reflectors']} taken)"
    seconds = statistics.median(row["seconds"])
    return [
        label,
        f"{row['rmse']:.3f}",
        f"{row['shape']:.3f}",
        f"{row['energy']:.3f}",
        f"{seconds:.2f}",
        f"{row['rays']:,}",
    ]


def _aims(results: dict) -> str:
    errors = {s["scene"]: {row["method"]: row["rmse"] for row in s["rows"]} for s in results["scenes"]}
    near = errors["Light near a wall"]
    emitted, received = near["obscurances, bleeding (eq. 4)"], near["+ received light"]
    worse = [name for name, found in errors.items() if found["+ 64 reflectors"] > found["+ received light"]]
    cost = results["cost"]
    automatic = statistics.median(b / a for a, b in zip(cost["seconds"]["0"], cost["seconds"]["AUTO"], strict=True))
    rows = [
        [
            "near the wall, error with received light / with eq. 4",
            "0.5",
            against(received / emitted, 0.5, ".2f", False),
        ],
        [
            "near the wall, error with 64 reflectors / without",
            "0.6",
            against(near["+ 64 reflectors"] / received, 0.6, ".2f", False),
        ],
        ["scenes in which 64 reflectors make it worse", "none", ", ".join(worse) or "none (met)"],
        [
            f"whole bake of {cost['patches']:,} patches, time with 64 reflectors / without",
            "1.5",
            against(cost["ratio"], 1.5, ".2f", False),
        ],
        ["the same with automatic reflectors, which takes none there", "", f"{automatic:.2f}"],
    ]
    return "## Aims\n\n" + markdown_table(["", "at most", "measured"], rows)
