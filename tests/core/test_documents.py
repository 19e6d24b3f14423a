"""Files that the documents name are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = ("CONTRIBUTING.md", "README.md", "benchmarks/README.md", "docs/theory.md", "sample_blends/README.md")
FOLDERS = ("obscurance_addon", "benchmarks", "docs", "sample_blends", "tests", "tools")
MADE = ("build/", "results/")  # by what they are named with


def named_paths(text: str) -> set[str]:
    """Python files and folders in backticks."""
    return set(re.findall(r"`(\w[\w./]*(?:\.py|/))`", text))


def paths() -> set[str]:
    files = [path.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    return {f"/{path}" for path in files} | {f"/{parent}/" for path in files for parent in path.parents}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_named_files_exist(document):
    there = paths()
    named = {name for name in named_paths((ROOT / document).read_text("utf-8")) if not name.startswith(MADE)}
    missing = {name for name in named if not any(path.endswith(f"/{name}") for path in there)}
    assert [name for name in sorted(missing) if not (ROOT / name).exists()] == []
