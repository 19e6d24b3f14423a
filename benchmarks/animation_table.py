"""Turns the raw results of animation.py into a section of benchmarks/README.md."""

from __future__ import annotations

import statistics

from table import against, markdown_table

RATE_AIM, CHEAPER_AIM = 60.0, 5.0  # of Room with 4,016 patches and 100 rays
GROWTH_AIM, TILES_CHEAPER_AIM = 1.15, 50.0
_AIMED = ("room_4016", 100)
# Of the 2003 paper, on a 900 MHz Athlon: seconds of a full computation, and frames a second with recomputing.
_PAPER = {
    ("room_1423", 60): (1.7, 17.0),
    ("room_1423", 80): (2.2, 14.0),
    ("room_1423", 100): (2.8, 11.5),
    ("room_4016", 60): (4.6, 10.5),
    ("room_4016", 80): (5.9, 8.0),
    ("room_4016", 100): (7.3, 6.5),
    ("infinite_5508", 60): (6.4, None),
    ("infinite_5508", 80): (8.3, None),
    ("infinite_5508", 100): (10.3, None),
    ("infinite_13824", 60): (19.8, None),
    ("infinite_13824", 80): (20.7, None),
    ("infinite_13824", 100): (26.1, None),
}


def section(results: dict) -> str:
    """All tables."""
    return "## Updates while an object moves\n\n" + "".join(
        [_table(results["table"]), _tiles(results["tiles"]), _list(results["list"])]
    )


def _table(rows: list[dict]) -> str:
    lines = []
    for r in rows:
        key = r["scene"], r["rays_per_patch"]
        paper_full, paper_rate = _PAPER[key]
        first, last = r["passes"][0], r["passes"][-1]
        full, frame = statistics.median(r["full"]), statistics.median(last["frames"])
        rate, cheaper = _rate(last["frames"]), full / frame
        is_aimed = key == _AIMED
        lines.append(
            [
                f"{r['scene']}, {r['rays_per_patch']}",
                f"{r['patches']:,}",
                f"{paper_full} s",
                f"{1e3 * statistics.median(r['full_core']):.0f} ms",
                f"{1e3 * full:.0f} ms",
                "" if paper_rate is None else f"{paper_rate:g}",
                f"{_rate(first['core']):.0f}, {_rate(last['core']):.0f}",
                f"{_rate(first['frames']):.0f}, " + (against(rate, RATE_AIM, ".0f") if is_aimed else f"{rate:.0f}"),
                against(cheaper, CHEAPER_AIM, ".1f") if is_aimed else f"{cheaper:.1f}",
                *_counts(last),
            ]
        )
    moving = rows[0]["moving"]
    return (
        f"### Table 1 of the paper\n\nA cube of {moving} patches moves through 60 frames; bleeding, square root, "
        "automatic distance. The paper has no moving object in Infinite; here it is a cube a tenth of the scene wide. "
        "Full: all patches, by the core alone with its error estimate, and by the operator with reading and writing. "
        "Updates a second: in the first pass through the frames, in which what stands still is traced wherever the "
        "cube comes near, and in the second; by the core alone, and by `scene.frame_set` with Live Preview, everything "
        "included. Cheaper: full bake by the operator over an update by `frame_set` in the second pass. Patches, rays "
        "and rays whose hit among what stands still was known are those of the median update. The paper's figures are "
        "of a 900 MHz Athlon.\n\n"
        + markdown_table(
            [
                "scene, rays",
                "patches",
                "paper: full",
                "full, core",
                "full, operator",
                "paper: frames/s",
                "updates/s, core",
                f"updates/s, frame_set (aim {RATE_AIM:g} for 4,016 x 100)",
                f"times cheaper (aim {CHEAPER_AIM:g})",
                "patches",
                "rays",
                "known",
            ],
            lines,
        )
    )


def _tiles(rows: list[dict]) -> str:
    frames = [_tile_seconds(r, "frames") for r in rows]
    cores = [_tile_seconds(r, "core") for r in rows]
    lines = [
        [
            f"{r['patches']:,}",
            f"{r['objects']}",
            f"{statistics.median(r['full']):.2f} s",
            f"{1e3 * core:.1f} ms",
            f"{1e3 * frame:.1f} ms",
            against(cheaper, TILES_CHEAPER_AIM, ".0f") if i == 0 else f"{cheaper:.0f}",
            *_counts(r["passes"][-1]),
        ]
        for i, (r, core, frame) in enumerate(zip(rows, cores, frames, strict=True))
        for cheaper in [statistics.median(r["full"]) / frame]
    ]
    growth = [against(after / before, GROWTH_AIM, ".3f", at_least=False) for before, after in (cores, frames)]
    return (
        "### The same mover in a small and in a large scene\n\nBumpy tiles of 4,096 faces, 64 rays each, "
        "distance 1 m; the cube moves above the same tile, after a first pass through its frames.\n\n"
        + markdown_table(
            [
                "patches",
                "objects",
                "full bake, operator",
                "update, core",
                "update, frame_set",
                f"times cheaper (aim {TILES_CHEAPER_AIM:g} at 100k)",
                "patches",
                "rays",
                "known",
            ],
            lines,
        )
        + f"Four times the scene costs {growth[0]} times as much by the core alone, {growth[1]} times by `frame_set`; "
        f"at most {GROWTH_AIM:g} is the aim.\n\n"
    )


def _list(rows: list[dict]) -> str:
    lines = []
    for r in rows:
        for mode, name in (("EXACT", "exact"), ("LIST", "2003 list")):
            wrong = r["wrong"] if mode == "LIST" else 0
            stale = r["stale"] if mode == "LIST" else 0.0
            lines.append(
                [
                    r["scene"],
                    name,
                    f"{wrong:,} of {r['changed']:,} ({wrong / r['changed']:.1%})",
                    f"{stale:.3f}",
                    *_counts(r[mode])[:2],
                    f"{1e3 * statistics.median(r[mode]['core']):.1f} ms",
                ]
            )
    return (
        f"### The list of 2003 beside the exact update\n\n{rows[0]['rays_per_patch']} rays each, the cube through 60 "
        "frames. Wrong: patches whose value differs from that of a full bake, over all frames, beside how many changed "
        "from one frame to the next. Stale: how far the worst is off, where an open patch is 1.\n\n"
        + markdown_table(["scene", "mode", "wrong", "stale", "patches", "rays", "update, core"], lines)
    )


def _tile_seconds(row: dict, part: str) -> float:
    return statistics.median(s for one in row["passes"][1:] for s in one[part])


def _rate(seconds: list[float]) -> float:
    return 1.0 / statistics.median(seconds)


def _counts(one: dict) -> list[str]:
    """Patches, rays and rays with a known hit of the median update."""
    return [f"{statistics.median_low(column):,}" for column in zip(*one["counts"], strict=True)]
