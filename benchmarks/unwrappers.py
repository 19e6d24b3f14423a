"""Tries the unwrappers on the same awkward meshes, and measures what they make of these.

    python benchmarks/unwrappers.py [--meshes N] [--sizes T ...]
    python benchmarks/run.py --table

Each mesh goes through `unwrap` of the add-on with one engine after the other, in a process of each engine that is kept
for all meshes, so that its start is not in the seconds. Raw results go to
benchmarks/results/unwrappers.json; what is there already is kept, so that a run can be continued.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

ENGINES = ("XATLAS", "UVUNWRAP")
SIZE, PADDING = 512, 4
SIZES = (1_000, 4_000, 16_000, 63_000, 250_000)  # triangles of the terrains of the curve
CURVE_SIZE = 2048
HANGS = 120.0, 0.01  # seconds, and for each triangle: beyond these it is a hang
SEEN = 1e-3  # square texel: what is smaller shows nothing
INSIDE = 0.01  # texel: what is no farther inside of a triangle is rounding


def main() -> None:
    """Run both engines over all meshes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--meshes", type=int, default=500)
    parser.add_argument("--sizes", type=int, nargs="*", default=SIZES)
    parser.add_argument("--output", type=Path, default=HERE / "results" / "unwrappers.json")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        serve(options.worker)
    jobs = [("mesh", number) for number in range(options.meshes)]
    jobs += [("terrain", size) for size in options.sizes]
    results = run(jobs, options.output)
    print(f"{len(results)} results in {options.output}")


def run(jobs: list[tuple[str, int]], output: Path) -> list[dict]:
    """Do all jobs with each engine; what is in the output already stays."""
    results = json.loads(output.read_text(encoding="utf-8"))["results"] if output.is_file() else []
    done = {(r["job"], r["number"], r["engine"]) for r in results}
    workers = {engine: Worker(engine) for engine in ENGINES}
    for kind, number in jobs:
        for engine, worker in workers.items():
            if (kind, number, engine) in done:
                continue
            results.append({"job": kind, "number": number, "engine": engine} | worker.ask(kind, number))
        lines = ",\n".join(map(json.dumps, results))
        text = f'{{"machine": {json.dumps(machine())},\n"results": [\n{lines}\n]}}\n'
        output.write_text(text, encoding="utf-8")
    for worker in workers.values():
        worker.end()
    return results


def machine() -> dict:
    """As of run.py."""
    from importlib.metadata import version

    names = ("bpy", "embreex", "numpy", "xatlas", "uvunwrap")
    packages = {name: version(name) for name in names}
    return {"processors": len(os.sched_getaffinity(0)), "machine": os.uname().machine, **packages}


class Worker:
    """The process of one engine; started anew after a crash or a hang."""

    def __init__(self, engine: str) -> None:
        self.engine, self.process = engine, None

    def ask(self, kind: str, number: int) -> dict:
        """Measures of one mesh, or how it failed."""
        if self.process is None:
            command = [sys.executable, __file__, "--worker", self.engine]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            self.process = subprocess.Popen(command, text=True, **pipes)
        print(kind, number, file=self.process.stdin, flush=True)
        patience = HANGS[0] + HANGS[1] * (number if kind != "mesh" else 10_000)
        with DefaultSelector() as selector:
            selector.register(self.process.stdout, EVENT_READ)
            line = self.process.stdout.readline() if selector.select(patience) else "hang"
        if line.startswith("{"):
            return json.loads(line)
        self.end()
        return {"failed": "hang" if line == "hang" else "crash"}

    def end(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


class Inside:
    """Stands for the add-on's child process, but does the work in this one."""

    answered = True

    def __init__(self, module: str) -> None:
        self.messages: list[tuple] = []

    def send(self, message: object, keep: object = None) -> None:
        from obscurance_addon.core.lightmap.unwrap_worker import charts, serve

        if isinstance(message, tuple):
            self.messages.append(message)
            return
        try:
            self.messages.append(("done", serve._unwrapped(message, self)))
        except charts.Unplaceable as answer:
            self.messages.append(answer.args)

    def poll(self, seconds: float) -> bool:
        return True

    def receive(self) -> object:
        return self.messages.pop(0)

    def printed(self) -> list[str]:
        return []

    def end(self) -> None:
        pass


def serve(engine: str) -> None:
    """Answer lines with a kind and a number by lines of JSON."""
    import awkward_meshes

    from obscurance_addon.core.errors import ObscuranceError
    from obscurance_addon.core.lightmap import unwrapping
    from obscurance_addon.core.lightmap.settings import Unwrapper

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints is no answer
    unwrapping.ChildProcess = Inside
    for line in sys.stdin:
        kind, number = line.split()
        random, size = np.random.default_rng(int(number)), int(number)
        if kind == "mesh":
            kind, mesh = awkward_meshes.mesh_of(int(number))
        else:
            mesh = awkward_meshes.polygons(kind, *awkward_meshes.KINDS[kind](random, size))
        answer, page = {"kind": kind, "triangles": len(mesh.triangle_face)}, SIZE if line[:4] == "mesh" else CURVE_SIZE
        begin = time.perf_counter()
        try:
            atlas = unwrapping.unwrap(
                [mesh], size=page, padding=PADDING, unwrapper=Unwrapper(engine), check=lambda: None
            )
            answer["seconds"] = time.perf_counter() - begin
            answer |= measures(mesh, atlas)
        except ObscuranceError as error:
            answer |= {"seconds": time.perf_counter() - begin, "refused": str(error)}
        except Exception as error:
            answer["failed"] = f"{type(error).__name__}: {error}"
        print(json.dumps(answer), file=answers, flush=True)
    os._exit(0)


def measures(mesh: object, atlas: object) -> dict:
    """What is right and wrong with an atlas of one mesh.

    Returns
    -------
    dict
        `overlap`: centres of texels inside of two triangles or more; `shared`: texels that two charts touch; `near`:
        texels nearer to another chart than the padding; `mirrored`, `collapsed`: triangles turned over, and those
        without area in the map; `left_out`: faces without a place though they have an area; `use`: share of the page
        under triangles; `stretch`: root mean square of the singular values, 1 at best; `uneven`: share of the area
        whose density is more than twice or less than half of what it should be.
    """
    from obscurance_addon.core.lightmap import unwrapping

    usable = unwrapping._usable_faces(mesh)[0]
    uv, page, chart = atlas.uv[0], atlas.page[0], atlas.chart[0]
    on = page[mesh.triangle_face] >= 0
    corners, of = mesh.triangle_corners[on], chart[mesh.triangle_face[on]]
    flat = uv[corners].astype(float) * atlas.size
    solid = mesh.positions[mesh.corner_vertex[corners]] * atlas.texels_per_metre
    area = 0.5 * np.linalg.norm(np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0]), axis=1)
    signed = 0.5 * _cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    overlap, owner, shared = _painted(flat, of, atlas.size)
    tall = np.linalg.norm(solid - np.roll(solid, 1, 1), axis=2).max(1)
    real = area > 1e-6 * tall**2  # others have no shape that single precision could tell
    return {
        "charts": len(np.unique(of)),
        "density": atlas.texels_per_metre,
        "overlap": int(overlap),
        "shared": int(shared),
        "near": int(_near(owner, PADDING)),
        "mirrored": int((signed < -SEEN).sum()),
        "collapsed": int((signed[real] == 0.0).sum()),
        "left_out": int((usable & (page < 0)).sum()),
        "use": float(np.abs(signed).sum() / atlas.size**2),
        **_distortion(solid[real], flat[real], area[real], np.abs(signed)[real]),
    }


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _distortion(solid: np.ndarray, flat: np.ndarray, area: np.ndarray, covered: np.ndarray) -> dict:
    if not len(area) or not area.sum() > 0.0:
        return {"stretch": 1.0, "uneven": 0.0}
    a, b = solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0]
    along = a / np.linalg.norm(a, axis=1)[:, None]
    across = np.cross(np.cross(a, b), along)
    across /= np.linalg.norm(across, axis=1)[:, None]
    plane = [np.stack([(v * along).sum(1), (v * across).sum(1)], 1) for v in (a, b)]
    shape = np.linalg.solve(np.stack(plane, 1), np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], 1))
    stretch = np.sqrt((area * 0.5 * (shape**2).sum((1, 2))).sum() / area.sum())
    ratio = covered / area
    return {"stretch": float(stretch), "uneven": float(area[(ratio > 4.0) | (ratio < 0.25)].sum() / area.sum())}


def _painted(flat: np.ndarray, chart: np.ndarray, size: int) -> tuple[int, np.ndarray, int]:
    """Texels with centres in two triangles, the chart that touches each (size, size), and how many two charts touch."""
    signed = _cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    flat = np.where((signed > 0.0)[:, None, None], flat, flat[:, ::-1])
    low = np.clip(np.floor(flat.min(1)).astype(int), 0, size - 1)
    side = np.clip(np.floor(flat.max(1)).astype(int), 0, size - 1) + 1 - low
    times, pairs, done = np.zeros(size * size, int), [], 0
    for wide in 2 ** np.arange(0, int(np.ceil(np.log2(size))) + 1):
        some = np.flatnonzero((side.max(1) <= wide) & (side.max(1) > done))
        done = wide
        for part in np.array_split(some, max(1, len(some) * wide * wide // 2**20)):
            texel, inside, touched = _texels_of(flat[part], low[part], side[part], wide, size)
            times += np.bincount(texel[inside], minlength=size * size)
            number = np.broadcast_to(chart[part, None, None], texel.shape)
            pairs.append(np.unique(texel[touched] * 2**32 + number[touched]))
    texel, number = np.divmod(np.unique(np.concatenate([[], *pairs]).astype(np.int64)), 2**32)
    owner = np.full(size * size, -1)
    owner[texel] = number
    shared = np.count_nonzero(np.bincount(texel, minlength=size * size) > 1)
    return np.count_nonzero(times > 1), owner.reshape(size, size), shared


def _texels_of(flat: np.ndarray, low: np.ndarray, side: np.ndarray, wide: int, size: int) -> tuple:
    """Texels (t, w, w) around triangles (t, 3, 2), and which have their centres inside or are touched."""
    step = np.arange(wide)
    x, y = np.broadcast_arrays(low[:, 0, None, None] + step, low[:, 1, None, None] + step[:, None])
    inside = (x - low[:, 0, None, None] < side[:, 0, None, None]) & (y - low[:, 1, None, None] < side[:, 1, None, None])
    touched = inside.copy()
    for p, q in ((flat[:, k], flat[:, (k + 1) % 3]) for k in range(3)):
        normal = np.stack([p[:, 1] - q[:, 1], q[:, 0] - p[:, 0]], 1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        a, b = normal[:, 0, None, None], normal[:, 1, None, None]
        depth = (x + 0.5 - p[:, 0, None, None]) * a + (y + 0.5 - p[:, 1, None, None]) * b
        inside &= depth > INSIDE
        touched &= depth + 0.5 * (np.abs(a) + np.abs(b)) > INSIDE
    return np.minimum(y * size + x, size * size - 1), inside, touched


def _near(owner: np.ndarray, distance: int) -> int:
    """Texels with one of another chart no farther than `distance`, where that many should be free between them."""
    near = np.zeros(owner.shape, bool)
    size = len(owner)
    for dy in range(distance + 1):
        for dx in range(-distance if dy else 1, distance + 1):
            a = owner[dy:, max(dx, 0) : size + min(dx, 0)]
            b = owner[: size - dy, max(-dx, 0) : size + min(-dx, 0)]
            near[: size - dy, max(-dx, 0) : size + min(-dx, 0)] |= (a >= 0) & (b >= 0) & (a != b)
    return np.count_nonzero(near)


if __name__ == "__main__":
    main()
