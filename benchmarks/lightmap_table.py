"""Turns the raw results of lightmap.py into a section of benchmarks/README.md and a plot."""

from __future__ import annotations

import itertools
import json
import math
import statistics
from pathlib import Path

from table import against, markdown_table

TRACE_AIM, PLAIN_AIM, ADAPTIVE_AIM, MEMORY_AIM = 0.75, 6.0, 15.0, 4.0
SAMPLES = 64  # of Cycles, whose error the others have to reach
_PANEL, _LEFT, _TOP, _GAP = (380.0, 320.0), 70.0, 40.0, 60.0  # of the plot, in pixels
_STYLES = {"Cycles": "#d55e00", "ours, plain": "#0072b2", "ours, adaptive": "#009e73"}


def section(results: dict) -> str:
    """All tables."""
    return "## Lightmaps\n\n" + "".join(
        [
            _trace(results["trace"]),
            _beside_cycles(results["compared"]),
            *(_rows(entry) for entry in results["compared"]),
            _unwrapped(results["unwrapped"]),
            _memory(results["memory"]),
        ]
    )


def _trace(entries: list[dict]) -> str:
    rows = []
    for r in entries:
        ratio = statistics.median(b / o for o, b in zip(r["seconds"], r["seconds_bare"], strict=True))
        rates = (r["rays"] / statistics.median(r[key]) / 1e6 for key in ("seconds", "seconds_bare"))
        kind = "colour" if r["bleeding"] else "grey"
        rows.append(
            [
                str(r["size"]),
                f"{r['texels']:,}",
                f"{kind}, {r['rays_per_texel']}",
                f"{r['rays']:,}",
                *(f"{rate:.2f}" for rate in rates),
                against(ratio, TRACE_AIM, ".3f"),
                *(f"{statistics.median(r[key]):.2f}" for key in ("seconds", "seconds_bare", "seconds_finding")),
            ]
        )
    return (
        "### Tracing and weighing texels, beside bare embreex\n\nSolids on a floor, plain (not adaptive), automatic "
        "distance, square root. Ours is the whole trace phase of a bake: finding and cutting the texels that triangles "
        "cover, making rays, tracing, telling what starts inside of solids, weighing, the rays of the error estimate, "
        "and storing on the page; neither margins nor the image. Bare embreex answers the very same rays in the same "
        "blocks on as many threads, and throws the answers away.\n\n"
        + markdown_table(
            [
                "page",
                "covered texels",
                "rays a texel",
                "rays",
                "Mrays/s",
                "bare Mrays/s",
                f"ratio (aim: {TRACE_AIM})",
                "s",
                "bare s",
                "of ours: finding texels, s",
            ],
            rows,
        )
    )


def _beside_cycles(entries: list[dict]) -> str:
    rows = []
    for entry in entries:
        target = next(r for r in entry["rows"] if r["method"] == "Cycles" and r["count"] == SAMPLES)
        rows.append([str(entry["size"]), f"{target['rmse']:.4f}", f"{_seconds(target):.2f}"])
        for curve, aim in ((_curve(entry, "plain"), PLAIN_AIM), (_curve(entry, "adaptive"), ADAPTIVE_AIM)):
            rows[-1] += _speedup(curve, target, aim)
    bound = _default_bound(entries[0])
    return (
        "### Beside Cycles' ambient occlusion bake to an image\n\nFlat-shaded closed solids on a floor, the same UV "
        "map, unwrapped once by ours, the same distance, falloff STEP, no bleeding, no margin, on the same processors "
        f"in one run. How long ours takes to reach the error of Cycles with {SAMPLES} samples, read off the curves "
        "below by straight lines between the logarithms of time and error.\n\nTimes are of whole calls: "
        "`bpy.ops.object.bake` for all objects at once, and our `BakeJob` from reading the scene to the packed "
        "32-bit EXR, with its error estimate, the tree of the ray tracer built anew and the UV map kept. Cycles "
        "bakes the texels whose centre a face covers, ours every texel that a face touches; compared are those that "
        "one chart covers wholly and that do not reach into a solid. "
        "The error of Cycles is its random one, which two seeds tell (the root mean square of their difference over "
        "the square root of 2): its distance from what Cycles itself converges to. That of ours is measured against "
        "two plain bakes with other seeds, in such a way that their noise cancels (see `lightmap.py`); it contains "
        "what interpolation adds.\n\n"
        + markdown_table(
            [
                "page",
                f"error of Cycles, {SAMPLES} samples",
                "Cycles s",
                "plain s",
                f"plain is faster, times (aim: {PLAIN_AIM:g})",
                f"adaptive s (error bound {bound:g})",
                f"adaptive is faster, times (aim: {ADAPTIVE_AIM:g})",
            ],
            rows,
        )
        + "![Error against time](../docs/images/lightmap_error.svg)\n\n"
    )


def _speedup(curve: list[dict], target: dict, aim: float) -> list[str]:
    """Seconds to reach the error of the target, and how many times faster that is."""
    seconds = seconds_to_reach(curve, target["rmse"])
    if seconds is None:
        return ["never", "0 (missed)"]
    bounded = curve[0]["rmse"] <= target["rmse"]
    faster = against(_seconds(target) / seconds, aim, ".1f")
    if bounded:  # the fewest rays measured are already better
        return [f"at most {seconds:.2f}", f"at least {faster}".replace("missed", "not shown")]
    return [f"{seconds:.2f}", faster]


def seconds_to_reach(curve: list[dict], rmse: float) -> float | None:
    """Time at which a curve, from few rays to many, first has this error; None if it never has."""
    if curve[0]["rmse"] <= rmse:
        return _seconds(curve[0])
    for before, after in itertools.pairwise(curve):
        if after["rmse"] <= rmse:
            share = math.log(before["rmse"] / rmse) / math.log(before["rmse"] / max(after["rmse"], 1e-9))
            return _seconds(before) * (_seconds(after) / _seconds(before)) ** share
    return None


def _rows(entry: dict) -> str:
    rows = []
    for r in entry["rows"]:
        ours = r["method"] != "Cycles"
        bound = f", error bound {r['error_bound']:g}" if r.get("error_bound") else ""
        rows.append(
            [
                f"ours, {r['method']}{bound}" if ours else "Cycles",
                f"{r['count']:,}",
                f"{_seconds(r):.2f}",
                f"{r['rmse']:.5f}",
                "" if ours else f"{r['beside_ours']:.5f}",
                f"{r['traced']:.0%}" if ours else "",
            ]
        )
    return (
        f"#### A page of {entry['size']}\n\n{entry['objects']} objects; {entry['covered']['ours']:,} texels baked by "
        f"ours, {entry['covered']['cycles']:,} by Cycles, {entry['compared']:,} compared. Our reference is two bakes "
        f"with {entry['reference_rays']:,} rays a texel, together {2 * entry['reference_rays']:,}, whose own random "
        f"error would be {entry['reference_noise']:.5f} if it did not cancel. What Cycles converges to (its two bakes "
        f"with most samples) differs from that by {entry['difference']:.5f}, both noises taken out, and by "
        f"{entry['difference_in_one_face']:.5f} over the {entry['in_one_face']:,} texels that lie in one triangle: of "
        "several that share a texel Cycles bakes one, ours all. *Beside ours* is the error of Cycles with our "
        "reference taken for the truth.\n\n"
        + markdown_table(["", "samples or rays a texel", "s", "error", "beside ours", "texels traced"], rows)
    )


def _unwrapped(entries: list[dict]) -> str:
    rows = []
    for r in entries:
        unwrap, whole = r["phases"]["unwrap"], sum(r["phases"].values())
        rows.append(
            [
                f"{r['objects']:,}",
                f"{r['faces']:,}",
                str(r["size"]),
                f"{r['use']:.0%}",
                f"{unwrap:.2f}",
                f"{whole - unwrap:.2f}",
            ]
        )
    return (
        "### Unwrapping\n\nSeconds that xatlas takes in its process to cut and pack, beside all the rest of a bake "
        "with the usual settings (64 rays, adaptive, colour).\n\n"
        + markdown_table(["objects", "faces", "page", "of it used", "xatlas s", "the rest s"], rows)
    )


def _memory(entries: list[dict]) -> str:
    rows = [
        [
            "adaptive" if r["adaptive"] else "plain",
            f"{r['texels']:,}",
            f"{r['rays']:,}",
            f"{r['seconds']:.1f}",
            f"{r['peak_bytes_before'] / 2**30:.2f}",
            against(r["peak_bytes"] / 2**30, MEMORY_AIM, ".2f", at_least=False),
        ]
        for r in entries
    ]
    r = entries[0]
    return (
        f"### Memory of a large page\n\nOne page of {r['size']:,}, {r['rays_per_texel']} rays a texel, UV map kept, "
        "written as a half-float EXR file; each in a process of its own, Blender and the scene included.\n\n"
        + markdown_table(
            ["", "texels", "rays", "s", "peak before, GiB", f"peak, GiB (aim: at most {MEMORY_AIM:g})"],
            rows,
        )
    )


def _seconds(row: dict) -> float:
    return statistics.median(row["seconds"])


def _default_bound(entry: dict) -> float:
    return next(r["error_bound"] for r in entry["rows"] if r["method"] == "adaptive")  # the first is the default


def _curve(entry: dict, method: str) -> list[dict]:
    bound = _default_bound(entry) if method == "adaptive" else None
    return [r for r in entry["rows"] if r["method"] == method and r.get("error_bound") == bound]


def plot(results: Path) -> str:
    """Error against time on logarithmic axes as an SVG, one panel for each page size."""
    entries = json.loads((results / "lightmap.json").read_text(encoding="utf-8"))["results"]["compared"]
    curves = [
        dict(zip(_STYLES, (_curve(entry, name) for name in ("Cycles", "plain", "adaptive")), strict=True))
        for entry in entries
    ]
    points = [row for of in curves for curve in of.values() for row in curve]
    ranges = [_decades([_seconds(r) for r in points]), _decades([r["rmse"] for r in points])]
    width = _LEFT + len(entries) * (_PANEL[0] + _GAP)
    height = _TOP + _PANEL[1] + 55.0
    panels = [
        f'<g transform="translate({_LEFT + i * (_PANEL[0] + _GAP):g} {_TOP:g})">{_panel(entry, of, *ranges)}</g>'
        for i, (entry, of) in enumerate(zip(entries, curves, strict=True))
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" '
        f'font-size="12" fill="#222"><rect width="100%" height="100%" fill="#fff"/>' + "\n".join(panels) + "</svg>\n"
    )


def _decades(values: list[float]) -> tuple[float, float]:
    """Logarithms of a range that holds these values, to a fifth of a decade."""
    logs = [math.log10(max(value, 1e-6)) for value in values]
    return math.floor(5.0 * min(logs) - 0.25) / 5.0, math.ceil(5.0 * max(logs) + 0.25) / 5.0


def _panel(entry: dict, curves: dict[str, list[dict]], x_range: tuple, y_range: tuple) -> str:
    w, h = _PANEL

    def x(seconds: float) -> float:
        return w * (math.log10(seconds) - x_range[0]) / (x_range[1] - x_range[0])

    def y(rmse: float) -> float:
        return h * (1.0 - (math.log10(max(rmse, 1e-6)) - y_range[0]) / (y_range[1] - y_range[0]))

    parts = [f'<rect width="{w:g}" height="{h:g}" fill="none" stroke="#888"/>']
    for value in _ticks(*x_range):
        parts.append(f'<path d="M{x(value):.1f} 0V{h:g}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="{x(value):.1f}" y="{h + 17:g}" text-anchor="middle">{value:g}</text>')
    for value in _ticks(*y_range):
        parts.append(f'<path d="M0 {y(value):.1f}H{w:g}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="-6" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
    for i, (label, curve) in enumerate(curves.items()):
        colour = _STYLES[label]
        places = [(x(_seconds(r)), y(r["rmse"]), r["count"]) for r in curve]
        line = " ".join(f"{px:.1f},{py:.1f}" for px, py, _ in places)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        for px, py, count in places:
            parts.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3.5" fill="{colour}"/>')
            parts.append(f'<text x="{px + 6:.1f}" y="{py - 6:.1f}" font-size="10" fill="{colour}">{count}</text>')
        parts.append(f'<text x="{w - 8:g}" y="{18 + 16 * i}" text-anchor="end" fill="{colour}">{label}</text>')
    parts.append(f'<text x="{w / 2:g}" y="-12" text-anchor="middle" font-size="14">page of {entry["size"]}</text>')
    parts.append(f'<text x="{w / 2:g}" y="{h + 40:g}" text-anchor="middle">seconds of a whole bake</text>')
    parts.append(f'<text transform="translate(-50 {h / 2:g}) rotate(-90)" text-anchor="middle">error (RMS)</text>')
    return "\n".join(parts)


def _ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 of each decade within a range of logarithms."""
    decades = range(math.floor(low), math.ceil(high) + 1)
    values = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
    return [value for value in values if low <= math.log10(value) <= high]
