"""Turns raw results into the tables of benchmarks/README.md."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from pathlib import Path

import numpy as np

_HEAD = """# Benchmarks

    make bench

runs everything here in about half an hour, most of it for lightmaps, writes raw results to `results/`,
this page, and [docs/light_error.md](../docs/light_error.md), light beside radiosity. Nothing on them is typed by hand:
edit `table.py`. The machine is small and shared, so only ratios of things measured side by side in one run mean
anything; medians are given.

"""


def text(results: Path, more: dict[str, Callable[[dict], str]]) -> str:
    """The page for all results present in a folder; `more` makes sections of results that are not made here."""
    sections = {
        "trace_rate": _trace_rate,
        "whole_bake": _whole_bake,
        "scaling": _scaling,
        "streams": _streams,
        "cycles_ao": _cycles_ao,
        "foliage": _foliage,
        **more,
    }
    parts = [_HEAD]
    for name, section in sections.items():
        path = results / f"{name}.json"
        if path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            machine = record["machine"]
            parts.append(section(record["results"]))
            parts.append(
                f"{machine['processors']} processors ({machine['machine']}), bpy {machine['bpy']}, embreex "
                f"{machine['embreex']}, numpy {machine['numpy']}.\n\n"
            )
    return "".join(parts).rstrip() + "\n"


def markdown_table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n\n"


def against(value: float, aim: float, style: str, at_least: bool = True) -> str:
    """A figure, and whether it meets what we aim for."""
    return f"{value:{style}} ({'met' if (value >= aim) == at_least else 'missed'})"


def _trace_rate(results: list[dict]) -> str:
    rows = []
    for r in results:
        ratio = statistics.median(b / o for o, b in zip(r["seconds"], r["seconds_bare"], strict=True))
        ours, bare = (r["rays"] / statistics.median(r[key]) / 1e6 for key in ("seconds", "seconds_bare"))
        rows.append(
            [
                "colour" if r["bleeding"] else "grey",
                f"{r['rays']:,}",
                f"{ours:.2f}",
                f"{bare:.2f}",
                against(ratio, 0.85, ".3f"),
            ]
        )
    return (
        f"## Tracing and weighing, beside bare embreex\n\nSuzanne with {results[0]['faces'] - 1:,} faces over a plane, "
        "64 rays a face, automatic distance. Bare embreex answers the very same rays in blocks of the same size on as "
        "many threads, and throws the answers away.\n\n"
        + markdown_table(["", "rays", "Mrays/s", "bare Mrays/s", "ratio (aim: 0.85)"], rows)
    )


def _whole_bake(results: list[dict]) -> str:
    (r,) = results
    names = ["extract", "build", "trace", "write"]
    median = {name: statistics.median(b["phases"][name] for b in r["bakes"]) for name in names}
    ratio = statistics.median(b["seconds"] / b["phases"]["trace"] for b in r["bakes"])
    apart = statistics.median((b["seconds"] - r["fill_seconds"]) / b["phases"]["trace"] for b in r["bakes"])
    rows = [
        [
            *(f"{median[name]:.3f}" for name in names),
            f"{r['fill_seconds']:.3f}",
            f"{ratio:.2f}",
            against(apart, 1.5, ".2f", at_least=False),
        ]
    ]
    return (
        f"## Whole bake\n\nThe same scene through `BakeJob`, from reading the scene to the attributes written: "
        f"{r['rays']:,} rays, those for the error estimate included. Seconds per phase; embreex's copying of triangles "
        "into its buffers is part of build and given apart.\n\n"
        + markdown_table([*names, "of build: copying", "whole / trace", "without copying (aim: 1.5)"], rows)
    )


def _foliage(results: list[dict]) -> str:
    rows = []
    for r in results:
        opaque = r["seconds"]["opaque"]
        ratio = {
            kind: statistics.median(s / o for s, o in zip(r["seconds"][kind], opaque, strict=True))
            for kind in ("half", "cut-out")
        }
        rows.append(
            [
                str(r["layers"]),
                f"{statistics.median(opaque):.2f}",
                *(f"{ratio[kind]:.1f}" for kind in ratio),
                *(f"{r['means'][kind]:.3f}" for kind in ("opaque", *ratio)),
            ]
        )
    return (
        "## Transparent foliage\n\nA floor below layers of 256 tilted leaf cards each, opaque, with an alpha of one "
        f"half, or cut out by a texture to the half; {results[0]['rays']:,} rays from the floor. Seconds of tracing "
        "below opaque leaves, how many times that the others take, and the mean green of the floor.\n\n"
        + markdown_table(
            ["layers", "opaque, s", "half: times", "cut-out: times", "opaque", "half", "cut-out"],
            rows,
        )
    )


def _scaling(results: list[dict]) -> str:
    rows = []
    for r in results:
        phases = r["phases"][-1]
        total = sum(phases.values())
        rows.append(
            [
                f"{r['faces']:,}",
                f"{total / r['faces'] * 1e6:.2f}",
                f"{phases['trace'] / r['faces'] * 1e6:.2f}",
                f"{(r['peak_bytes'] - r['peak_bytes_before']) / r['faces']:,.0f}",
                f"{r['peak_bytes'] / 2**30:.2f}",
            ]
        )
    faces = np.log([r["faces"] for r in results])
    seconds = np.log([sum(r["phases"][-1].values()) for r in results])
    slope = against(np.polyfit(faces, seconds, 1)[0], 1.12, ".3f", at_least=False)
    return (
        "## Growth with the scene\n\nA bumpy terrain whose rays meet the same surroundings at every size: 64 rays a "
        f"face, distance four faces. Time against faces on log-log axes has slope {slope} (aim: at most 1.12).\n\n"
        + markdown_table(
            ["faces", "bake, µs/face", "of it trace", "memory, bytes/face", "peak of the process, GiB"], rows
        )
    )


def _streams(results: list[dict]) -> str:
    rows = [[f"{r['rays_per_face']:,}", f"{r['rays']:,}", f"{r['peak_bytes'] / 2**20:,.0f}"] for r in results]
    return (
        f"## Memory beside the number of rays\n\nThe same terrain with {results[0]['faces']:,} faces.\n\n"
        + markdown_table(["rays a face", "rays", "peak of the process, MiB"], rows)
    )


def _cycles_ao(results: list[dict]) -> str:
    rows = []
    for r in results:
        faster = {
            key: statistics.median(c / o for c, o in zip(r["seconds_cycles"], r[f"seconds_{key}"], strict=True))
            for key in ("face", "corner")
        }
        seconds = [f"{statistics.median(r[f'seconds_{key}']):.2f}" for key in ("cycles", "face", "corner")]
        noise = [f"{r['noise'][key]:.4f}" for key in ("cycles", "face")]
        rows.append(
            [
                r["scene"],
                f"{r['faces']:,}",
                *seconds,
                against(faster["face"], 20.0, ".1f"),
                f"{faster['corner']:.1f}",
                *noise,
            ]
        )
    return (
        f"## Beside Cycles' ambient occlusion bake to colour attributes\n\nThe same meshes, distance and "
        f"{results[0]['samples']} samples on the same processors, alternating in one run; falloff STEP, no bleeding. "
        "Cycles computes a value at every corner of every face; ours one for each face (FACE), or one for the surface "
        "around each group of smooth corners (CORNER). Noise is the random error per face, from two seeds; that of "
        "Cycles is of the mean of a face's corners, four times as many samples.\n\n"
        + markdown_table(
            [
                "scene",
                "faces",
                "Cycles s",
                "FACE s",
                "CORNER s",
                "FACE is faster, times (aim: 20)",
                "CORNER is faster, times",
                "Cycles' noise",
                "FACE noise",
            ],
            rows,
        )
    )
