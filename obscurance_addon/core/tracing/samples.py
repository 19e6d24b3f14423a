"""Sample points of patches, handed out to threads block by block: places on the patch jointly with directions."""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Sequence

import numpy as np

from ..sampling import DIRECTION, SCRAMBLES, hash32, ray_table, split_rays
from ..scene import Cells
from ..settings import BakeSettings, Sampler
from ..workers import workers

BLOCK_RAYS = 65536  # per task: smaller ones pay more of Python's overhead, larger ones use more memory
TABLE_ROWS = 1024  # samples of a sequence held at a time, so that memory does not grow with their number


class PatchSamples:
    """The samples of every cell; each patch reads the point set that its identity picks.

    Parameters
    ----------
    cells : Cells
    ids : ndarray, (p,) uint32
        Stable identity of each patch.
    per_patch : ndarray, (p,) int
        Number of samples of each patch.
    settings : BakeSettings
        Sampler, seed and threads.
    replicate : int
        0 for the bake; other numbers give independent scramblings.
    block_rays : int
        Samples per task; results do not depend on it.
    keeps_tables : bool
        Make tables of all point sets, however few the cells need, and keep them for the next cells.
    favours_directions : bool
        As of `sampling.ray_table`: for patches so small that places on them make little difference.

    Attributes
    ----------
    start, count : ndarray, (c,) int64
        Range of the sequence that each cell reads.
    threads : int
        Number of threads that `run` uses for more than one block, 0 for none but its own.
    """

    def __init__(
        self,
        cells: Cells,
        ids: np.ndarray,
        per_patch: np.ndarray,
        settings: BakeSettings,
        replicate: int = 0,
        block_rays: int = BLOCK_RAYS,
        keeps_tables: bool = False,
        favours_directions: bool = False,
    ) -> None:
        self.cells = cells
        self.start, self.count = split_rays(cells.patch, cells.weight, per_patch)
        self.block_rays = block_rays
        self.scratch = Scratch()
        self._sampler: Sampler = settings.sampler
        self._seed = int(hash32(np.uint32(settings.seed) ^ hash32(np.uint32(replicate))))
        self.threads = settings.thread_count()
        self._keeps_tables, self._favours_directions = keeps_tables, favours_directions
        self._scramble = scramble_of(ids, self._seed)

    def run(
        self, cells: np.ndarray, work: Callable[[np.ndarray, np.ndarray], None], columns: tuple[str, ...] = DIRECTION
    ) -> int:
        """Call `work(cells, samples)` from several threads for all samples of the cells (m,) int.

        `samples` is (k, m, n) float32 with n samples of each cell, as of `sampling.ray_table`; it is overwritten after
        the call. A cell may come in several calls, which never run at once.

        Returns
        -------
        int
            Number of samples.
        """
        if not len(cells):
            return 0
        total = 0
        start, end = self.start[cells], self.start[cells] + self.count[cells]
        sets, row_of_set = self._point_sets(cells)
        with workers(self.threads if self.count[cells].sum() > self.block_rays else 0) as pool:
            for first in range(0, int(end.max()), TABLE_ROWS):
                low, high = np.maximum(start, first), np.minimum(end, first + TABLE_ROWS)
                rows = min(TABLE_ROWS, int(end.max()) - first)
                table = self._table(sets, first, rows, columns)
                tasks = []
                n_rays = np.maximum(high - low, 0)
                for n in np.flatnonzero(np.bincount(n_rays)[1:]) + 1:  # cells with the same number of rays go together
                    group = np.flatnonzero(n_rays == n)
                    base = row_of_set[group] * rows + low[group] - first
                    per_block = max(1, self.block_rays // int(n))
                    for at in range(0, len(group), per_block):
                        block = slice(at, at + per_block)
                        tasks.append((cells[group[block]], base[block], int(n)))
                total += sum(len(block) * n for block, _, n in tasks)

                def task(part: tuple[np.ndarray, np.ndarray, int], table: np.ndarray = table) -> None:
                    block, base, n = part
                    work(block, self._take(table, base, n))

                for _ in pool.map(task, tasks):
                    pass
        return total

    def first(self, cells: np.ndarray) -> np.ndarray:
        """The first sample of each cell (m,) int, (5, m, 1) float32."""
        sets, row = self._point_sets(cells)
        return self._take(self._table(sets, 0, 1, DIRECTION), row, 1)

    def origins(self, cells: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Where the rays of samples (k, m, n) of cells (m,) start, (m n, 3) float32, one coordinate after the other."""
        *edges, corner = self._frames(cells)[:, :3]
        out = self._combined("origins", samples[:2], edges)
        out += corner
        return out.reshape(3, -1).T

    def directions(self, cells: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Where the rays of samples (5, m, n) of cells (m,) go, (m n, 3) float32 unit vectors, as `origins`."""
        return self._combined("directions", samples[2:], self._frames(cells)[:, 3:]).reshape(3, -1).T

    def _frames(self, cells: np.ndarray) -> np.ndarray:
        """The frames of cells (m,) as (3, 6, m, 1): row, column, cell."""
        frames = np.take(self.cells.frames.reshape(-1, 18), cells, axis=0)
        return frames.reshape(-1, 3, 6).transpose(1, 2, 0)[..., None]

    def _combined(self, name: str, weights: np.ndarray, vectors: Sequence[np.ndarray]) -> np.ndarray:
        """Sums of vectors (3, m, 1) each, times weights (k, m, n), (3, m, n).

        By products of whole arrays: those of small matrices cost numpy more.
        """
        out = self.scratch.array(name, (3, *weights.shape[1:]))
        product = self.scratch.array("product", weights.shape[1:])
        for axis, coordinate in enumerate(out):
            np.multiply(weights[0], vectors[0][axis], out=coordinate)
            for weight, vector in zip(weights[1:], vectors[1:], strict=True):
                coordinate += np.multiply(weight, vector[axis], out=product)
        return out

    def _table(self, sets: np.ndarray, first: int, count: int, columns: tuple[str, ...]) -> np.ndarray:
        rest = (first, count, columns, not self.cells.are_parallelograms, self._favours_directions)
        if len(sets) == SCRAMBLES:
            return _whole_table(self._sampler, self._seed, *rest)
        return ray_table(self._sampler, self._seed, sets, *rest)

    def _point_sets(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The point sets that the cells (m,) need, ascending, and for each cell the position of its set among them."""
        scramble = self._scramble[self.cells.patch[cells]]
        used = np.bincount(scramble, minlength=SCRAMBLES) > 0
        # Tables of all of them are kept for the next cells.
        if self._keeps_tables or np.count_nonzero(used) > SCRAMBLES // 2:
            used[:] = True
        return np.flatnonzero(used), (np.cumsum(used) - 1)[scramble]

    def _take(self, table: np.ndarray, base: np.ndarray, n: int) -> np.ndarray:
        """n samples of the table (k, s, count) from each of `base` (m,) on, as if sets were one; (k, m, n) float32."""
        out = self.scratch.array("samples", (len(table), len(base), n))
        table = table.reshape(len(table), -1)
        if table.shape[1] % n == 0 and not (base % n).any():  # whole groups of samples are copied at once
            table, index = table.reshape(len(table), -1, n), base // n
        else:
            index = base[:, None] + np.arange(n)
        for column, found in zip(table, out, strict=True):
            np.take(column, index, axis=0, mode="clip", out=found)
        return out


@functools.lru_cache(maxsize=24)  # of at most 6 MB each: all that the bands of a lightmap ask for again and again
def _whole_table(sampler: Sampler, seed: int, *arguments: object) -> np.ndarray:
    """`ray_table` of all point sets; nobody may write to it."""
    return ray_table(sampler, seed, np.arange(SCRAMBLES), *arguments)


def scramble_of(ids: np.ndarray, seed: int) -> np.ndarray:
    """The point set that each identity (p,) uint32 picks under a seed, (p,) int64 in 0 .. SCRAMBLES - 1."""
    return (hash32(ids.astype(np.uint32) ^ np.uint32(seed)) % np.uint32(SCRAMBLES)).astype(np.int64)


class Scratch(threading.local):
    """Arrays that each thread uses again for every block: fresh memory costs more than the work done in it."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An uninitialised float32 array, C-contiguous; the one of the same name from before is overwritten."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size, np.float32)
        return self._arrays[name][:size].reshape(shape)
