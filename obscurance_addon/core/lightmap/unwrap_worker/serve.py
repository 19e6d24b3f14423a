"""The child process of `core.lightmap.unwrapping`; the only place that imports xatlas and uvunwrap.

xatlas holds the interpreter lock and cannot be stopped, so it runs in a process of its own. Each message tells a step:
('mesh', index), ('cut', share), ('pack', try); or the end: ('done', arrays), ('oversize', mesh, metres),
('crowded', charts), ('pages', count).
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

from ...process import Channel
from .charts import Cut, Unplaceable, cut_mesh
from .packer import ORPHANED, pack_cuts
from .whole_atlas import make_atlas

PR_SET_PDEATHSIG = 1


def serve(channel: Channel, _folder: Path) -> None:
    """Answer one message, with the arrays of all meshes."""
    if sys.platform == "linux":  # else this ends with its parent only once xatlas lets go of the interpreter lock
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    job = channel.receive()
    try:
        found = _unwrapped(job, channel)
        if sys.platform != "win32":
            ctypes.CDLL(None).fflush(None)  # what the library printed, for the parent to read
        channel.send(("done", found))
    except Unplaceable as answer:
        channel.send(answer.args)
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # frees no atlas: that may hang (see `retired`)


def _unwrapped(job: dict[str, np.ndarray], channel: Channel) -> dict[str, np.ndarray]:
    cuts = [
        Cut(*(job[f"{name}{i}"] for name in ("face_start", "corners", "face", "points")))
        for i in range(len(job["seconds"]))
    ]
    if job["unwrapper"] == "UVUNWRAP":
        import uvunwrap

        return make_atlas(uvunwrap, cuts, job, channel.send)
    import xatlas

    charts = 0
    limit = (int(job["size"]) - 1) / float(job["density"]) if job["density"] else np.inf
    for i, (cut, seconds) in enumerate(zip(cuts, job["seconds"], strict=True)):
        faulthandler.dump_traceback_later(ORPHANED * float(seconds), exit=True)
        channel.send(("mesh", i))
        try:
            cut_mesh(xatlas, cut, limit)
        except Unplaceable as width:
            raise Unplaceable("oversize", i, *width.args) from None
        charts += len(np.unique(cut.chart[cut.chart >= 0]))
        if charts > job["most_charts"] > 0:
            raise Unplaceable("crowded", charts)
    return pack_cuts(xatlas, cuts, job, channel.send)
