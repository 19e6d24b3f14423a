"""What the README prints runs as printed."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
END = "\nprint('at the end', flush=True)\nimport os\nos._exit(0)\n"  # the module of 4.2 crashes at a normal end


def test_the_python_example(tmp_path):
    """From a folder of its own, so that the file that it saves is not left in the checkout."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"(?m)^    import bpy\n(?:    .*\n|\n)*", text)
    (tmp_path / "sample_blends").symlink_to(ROOT / "sample_blends")
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code) + END],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PWD": str(tmp_path)},  # from which Blender takes relative paths
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "at the end" in done.stdout
    assert done.stdout.count("Baked 1,744 patches") == 2
    assert (tmp_path / "baked.blend").stat().st_size > 0
