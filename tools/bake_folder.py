"""Bakes every .blend below a folder with every target, and tells what became of each.

    python tools/bake_folder.py DIR [--results DIR] [--rays N] [--size N] [--seconds N] [--workers N]

Each bake is a process of its own with a time limit. It writes into a temporary folder; the files below DIR are only
read. The results are `results.jsonl`, one line for each bake, and `README.md`, tables of what was baked, refused,
noted, crashed, or did not come to an end.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGETS = ("FACE", "POINT", "CORNER", "LIGHTMAP")
OUTCOMES = ("baked", "baked with notes", "refused", "crashed", "timed out")
DONE, FAILED = 0, 1  # exit status of the command line
_TAIL = 2000  # characters kept of what a crashed bake printed
_LONGEST = 300  # characters of a sentence in the tables


def bake(scene: Path, target: str, options: argparse.Namespace) -> dict:
    """Bake one file with one target in a process of its own.

    Returns
    -------
    dict
        `file` below the folder, `target`, `outcome`, `seconds`, `status`, `message` of a refusal, `notes`, and `said`:
        what was printed on standard error where nothing should be.
    """
    entry = {"file": str(scene.relative_to(options.folder)), "target": target}
    with tempfile.TemporaryDirectory(prefix="bake_folder_") as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "obscurance_addon", "bake", str(scene), "--output", f"{folder}/out.blend"]
        command += ["--target", target, "--rays", str(options.rays), "--report", str(report), "--quiet"]
        if target == "LIGHTMAP":
            command += ["--size", str(options.size), "--image", f"{folder}/lightmap.exr"]
        began = time.perf_counter()
        status, said = _run(command, options.seconds)
        told = json.loads(report.read_text(encoding="utf-8"))["files"][0] if report.is_file() else {}
    entry |= {"seconds": round(time.perf_counter() - began, 2), "status": status}
    entry |= {"message": told.get("error"), "notes": told.get("warnings", []), "said": said[-_TAIL:]}
    return entry | {"outcome": _outcome(entry)}


def _run(command: list[str], seconds: float) -> tuple[int | None, str]:
    """Exit status (None after the time limit) and standard error."""
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        _out, said = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)  # its children too
        _out, said = process.communicate()
        return None, said
    return process.returncode, said


def _outcome(entry: dict) -> str:
    if entry["status"] is None:
        return "timed out"
    if entry["status"] == DONE:
        return "baked with notes" if entry["notes"] else "baked"
    refused = entry["status"] == FAILED and entry["message"] and "Traceback" not in entry["said"]
    return "refused" if refused else "crashed"


def tables(entries: list[dict], command: str) -> str:
    """What became of all bakes, as Markdown."""
    files = len({entry["file"] for entry in entries})
    lines = ["# What became of each bake", "", f"    {command}", "", f"{files} files, each with every target.", ""]
    lines += counts(entries)
    for title, outcome in (("Crashed", "crashed"), ("Timed out", "timed out")):
        chosen = [entry for entry in entries if entry["outcome"] == outcome]
        lines += _listed(title, ((entry["said"].strip().split("\n")[-1], entry) for entry in chosen))
    lines += _listed("Refused", ((entry["message"], entry) for entry in entries if entry["outcome"] == "refused"))
    lines += _listed("Noted", ((note, entry) for entry in entries for note in entry["notes"]))
    unasked = [entry for entry in entries if entry["status"] == DONE and entry["said"].strip()]
    lines += _listed("Printed on standard error", ((entry["said"].strip(), entry) for entry in unasked))
    return "\n".join(lines)


def counts(entries: list[dict]) -> list[str]:
    """Lines of a table: how many bakes with each target had each outcome."""
    lines = ["| target | " + " | ".join(OUTCOMES) + " |", "| --- |" + " --- |" * len(OUTCOMES)]
    for target in TARGETS:
        of = [entry["outcome"] for entry in entries if entry["target"] == target]
        lines.append(f"| {target} | " + " | ".join(str(of.count(outcome)) for outcome in OUTCOMES) + " |")
    return [*lines, ""]


def _listed(title: str, said: Iterable[tuple[str, dict]]) -> list[str]:
    """Lines of a table of sentences that differ in names and numbers only: how often, one of them, one of the files."""
    kinds: dict[str, list[tuple[str, dict]]] = defaultdict(list)
    for text, entry in said:
        kinds[re.sub(r"'[^']*'|\d[\d,.]*", "_", text)].append((text, entry))
    if not kinds:
        return []
    lines = [f"## {title}", "", "| bakes | sentence | for example |", "| --- | --- | --- |"]
    for found in sorted(kinds.values(), key=len, reverse=True):
        text, entry = found[0]
        text = " ".join(text.split()).replace("|", "\\|")
        lines.append(f"| {len(found)} | {text[:_LONGEST]} | {entry['file']} ({entry['target']}) |")
    return [*lines, ""]


def main(arguments: list[str]) -> int:
    """Bake a folder; 1 when a bake crashed or did not come to an end."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--results", type=Path, default=ROOT / "build" / "bake_folder", metavar="DIR")
    parser.add_argument(
        "--rays", type=int, default=4, metavar="N", help="per patch: few, as nobody looks at the result"
    )
    parser.add_argument("--size", type=int, default=256, metavar="N", help="of lightmaps")
    parser.add_argument("--seconds", type=float, default=120.0, metavar="N", help="time limit of one bake")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="bakes at a time")
    options = parser.parse_args(arguments)
    options.folder = options.folder.resolve()
    scenes = sorted(options.folder.rglob("*.blend"))
    if not scenes:
        parser.error(f"there is no .blend below '{options.folder}'")
    options.results.mkdir(parents=True, exist_ok=True)
    entries = []
    raw = options.results / "results.jsonl"
    with ThreadPoolExecutor(options.workers) as pool, raw.open("w", encoding="utf-8") as lines:
        pairs = [(scene, target) for scene in scenes for target in TARGETS]
        for entry in pool.map(lambda pair: bake(*pair, options), pairs):
            entries.append(entry)
            lines.write(json.dumps(entry, ensure_ascii=False) + "\n")
            lines.flush()
            print(f"{entry['file']} {entry['target']}: {entry['outcome']} {entry['message'] or ''}", flush=True)
    command = (
        f"python tools/bake_folder.py DIR --rays {options.rays} --size {options.size} --seconds {options.seconds:g}"
    )
    text = tables(entries, command)
    (options.results / "README.md").write_text(text, encoding="utf-8")
    print("\n".join(counts(entries)), f"{raw} and README.md beside it have the rest.", sep="\n")
    return int(any(entry["outcome"] in {"crashed", "timed out"} for entry in entries))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
