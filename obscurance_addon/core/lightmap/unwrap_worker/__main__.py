"""Child process of `core.lightmap.unwrapping`: cuts meshes into flat charts and packs these, with xatlas.

xatlas holds the interpreter lock and cannot be stopped, so it runs in a process of its own, as
`python unwrap_worker <folder> <pid of the parent>`. Python then looks for modules in this folder first, so that its
files import each other by plain name. The other folder holds `job.npz`; `result.npz` is written beside it.
Each line on stdout tells a step: `mesh <index>`, `pack <try>`, or an end without result: `oversize <mesh> <metres>`,
`crowded <charts>`, `pages <count>`.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import signal
import sys
import traceback
from pathlib import Path

import numpy as np
from charts import Cut, Unplaceable, cut_mesh
from packer import ORPHANED, pack_cuts

PR_SET_PDEATHSIG = 1


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def die_with(parent: int) -> None:
    """On Linux the system ends this process with its parent; elsewhere it ends at its next line to the closed pipe."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            sys.exit(1)


def main(folder: Path, parent: int) -> None:
    die_with(parent)
    import xatlas

    with np.load(folder / "job.npz", allow_pickle=False) as file:
        job = dict(file)
    limit = (int(job["size"]) - 1) / float(job["density"]) if job["density"] else np.inf
    cuts = []
    for i, seconds in enumerate(job["seconds"]):
        faulthandler.dump_traceback_later(ORPHANED * float(seconds), exit=True)
        say(f"mesh {i}")
        cut = Cut(*(job[f"{name}{i}"] for name in ("face_start", "corners", "face", "points")))
        try:
            cut_mesh(xatlas, cut, limit)
        except Unplaceable as width:
            raise Unplaceable(f"oversize {i} {width}") from None
        cuts.append(cut)
    np.savez(folder / "result.npz", **pack_cuts(xatlas, cuts, job, say))


def ended() -> int:
    """Runs `main` and returns the exit code."""
    try:
        main(Path(sys.argv[1]), int(sys.argv[2]))
    except Unplaceable as answer:
        say(str(answer))
    except Exception:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    os._exit(ended())  # frees no atlas: that may hang (see `retired`)
