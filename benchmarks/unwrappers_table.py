"""Turns the raw results of unwrappers.py into a section of benchmarks/README.md."""

from __future__ import annotations

import statistics

from table import markdown_table

NAMES = {"XATLAS": "xatlas", "UVUNWRAP": "uvunwrap"}


def section(results: list[dict]) -> str:
    """All tables."""
    tried = [r for r in results if r["job"] == "mesh"]
    curve = [r for r in results if r["job"] != "mesh"]
    meshes, kinds = (len({r[key] for r in tried if key in r}) for key in ("number", "kind"))
    return (
        "## Unwrappers\n\n    python benchmarks/unwrappers.py\n\n"
        f"The same {meshes} awkward meshes of {kinds} kinds (`awkward_meshes.py`: shapes of 1 to 10,000 "
        "triangles, holes, folds, soups, slivers, doubled and turned "
        "faces, any scale) through the add-on's `unwrap` with each library in turn, page 512, padding 4, the start of "
        "its process left out. uvunwrap is the default, for its time and its use of the page; neither "
        "fails, and xatlas remains for what the other may not manage.\n\n"
        + _tried(tried)
        + _kinds(tried)
        + _curve(curve)
    )


def _by_engine(results: list[dict]) -> dict[str, list[dict]]:
    return {engine: [r for r in results if r["engine"] == engine] for engine in NAMES}


def _tried(results: list[dict]) -> str:
    by = _by_engine(results)
    done = {engine: [r for r in rows if "use" in r] for engine, rows in by.items()}

    def meshes(key: str) -> list[str]:
        return [f"{sum(r[key] > 0 for r in rows)} ({sum(r[key] for r in rows):,})" for rows in done.values()]

    def median(key: str, digits: int) -> list[str]:
        return [f"{statistics.median(r[key] for r in rows):.{digits}f}" for rows in done.values()]

    both = {r["number"] for r in done["XATLAS"]} & {r["number"] for r in done["UVUNWRAP"]}
    pairs = zip(*([r for r in rows if r["number"] in both] for rows in done.values()), strict=True)
    ratios = [(slow["seconds"] / fast["seconds"], fast["density"] / slow["density"]) for slow, fast in pairs]
    total = [sum(r["seconds"] for r in rows) for rows in done.values()]
    rows = [
        ["crashes, hangs, exceptions", *(str(sum("failed" in r for r in rows)) for rows in by.values())],
        ["refused, with a message", *(str(sum("refused" in r for r in rows)) for rows in by.values())],
        ["meshes with overlaps (texels)", *meshes("overlap")],
        ["meshes with texels that two charts touch (texels)", *meshes("shared")],
        ["meshes whose charts are too near (texels)", *meshes("near")],
        ["meshes with mirrored triangles (triangles)", *meshes("mirrored")],
        ["meshes with triangles without area in the map (triangles)", *meshes("collapsed")],
        ["meshes with faces left out (faces)", *meshes("left_out")],
        ["charts, median", *median("charts", 0)],
        ["use of the page, median", *median("use", 3)],
        ["stretch, median (1 is none)", *median("stretch", 4)],
        [
            "meshes with over 1 % of the area at half or twice the density",
            *(str(sum(r["uneven"] > 0.01 for r in rows)) for rows in done.values()),
        ],
        ["median time, of that of xatlas", "1", f"1 / {statistics.median(ratio for ratio, _ in ratios):.0f}"],
        ["total time, of that of xatlas", "1", f"1 / {total[0] / total[1]:.1f}"],
        ["density, median, of that of xatlas", "1", f"{statistics.median(ratio for _, ratio in ratios):.3f}"],
    ]
    return markdown_table(["", *NAMES.values()], rows)


def _kinds(results: list[dict]) -> str:
    """The kinds of mesh that have overlaps, collapsed triangles or faces left out."""
    rows = []
    for kind in dict.fromkeys(r["kind"] for r in results if "kind" in r):
        counts = [
            [
                sum(r.get(key, 0) > 0 for r in results if r.get("kind") == kind and r["engine"] == engine)
                for engine in NAMES
            ]
            for key in ("overlap", "collapsed", "left_out")
        ]
        if any(map(any, counts)):
            rows.append([kind, *(f"{one} / {other}" for one, other in counts)])
    return (
        "Meshes of each kind that have faults, xatlas / uvunwrap. Polygons that cannot be laid flat without lying on "
        "themselves (`twisted`, warped `ngons`) overlap with either; triangles thinner than single precision tells "
        "fall together (`slivers`, `uneven`, `fan`).\n\n"
        + markdown_table(["kind", "overlaps", "without area", "left out"], rows)
    )


def _curve(results: list[dict]) -> str:
    rows = []
    for size in dict.fromkeys(r["number"] for r in results):
        slow, fast = (next(r for r in results if r["number"] == size and r["engine"] == engine) for engine in NAMES)
        seconds = [f"{r['seconds']:.1f}" if "use" in r else r.get("failed", "refused") for r in (slow, fast)]
        both = "use" in slow and "use" in fast
        times = f"{slow['seconds'] / fast['seconds']:.1f}" if both else ""
        use = [f"{r['use']:.0%}" if "use" in r else "" for r in (slow, fast)]
        charts = [f"{r['charts']:,}" if "use" in r else "" for r in (slow, fast)]
        rows.append([f"{fast['triangles']:,}", *seconds, times, *use, *charts])
    head = ["triangles", "xatlas s", "uvunwrap s", "times as fast", "xatlas use", "uvunwrap use"]
    return (
        "A wavy terrain on a page of 2048, once each, while others used the machine: only the ratio means anything.\n\n"
        + markdown_table([*head, "xatlas charts", "uvunwrap charts"], rows)
    )
