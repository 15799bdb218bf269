"""One large capture on many workers: the blocks of its final solve in tiles, each a task of Dask.

What pixels share with distant ones (lamp intensities and positions, reflectance, noise, the coarse depth, light from
other surfaces) is estimated once, by the task that holds the session, on the coarse grid and the pixel sample of any
solve. The final solve then goes from pixel to pixel, coupled to neighbours over a few rows only (`block_solve`): a tile
is a run of its blocks with that margin, read and solved anywhere. The joined maps are made integrable and integrated as
a whole by the task that holds the session. So the blocks, and with them the result, are those of one machine.

Tiles are full rows, because frames are stored by rows. A tile that is lost with its worker is computed again by Dask;
when the task of the session is lost, its claim runs out and all is done again.
"""

import tempfile
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt
from distributed import Client, Future, get_worker, worker_client

from acquisition.archive.contents import ContentStore
from acquisition.archive.entries import FileEntry
from acquisition.formats.frames import FolderFrames
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import FrameRef
from acquisition.normals.block_solve import Block, BlockMap, BlockResult, BlockSolver

AHEAD = 2
"""Tiles submitted for each thread of the workers: one at work and one waiting, so that results do not pile up."""


def tiles(blocks: Sequence[Block], rows: int) -> list[tuple[Block, ...]]:
    """Runs of consecutive blocks, each closed by the block with which it reaches `rows` rows."""
    found: list[tuple[Block, ...]] = []
    run: list[Block] = []
    for block in blocks:
        run.append(block)
        if block.rows.stop - run[0].rows.start >= rows:
            found.append(tuple(run))
            run = []
    return found + ([tuple(run)] if run else [])


def solve_tile(solver: BlockSolver, blocks: tuple[Block, ...]) -> list[BlockResult]:
    """One task: the blocks of a tile, by a solver of its rows."""
    return [solver(block) for block in blocks]


def by_tiles(pixels: int) -> BlockMap:
    """Solves blocks by the workers of this task's scheduler, in tiles of about so many pixels; outside of a worker, or
    of a thread of its own in one, blocks are solved here."""
    try:
        get_worker()
    except ValueError:
        return map

    def solved(solver: BlockSolver, blocks: Sequence[Block]) -> Iterable[BlockResult]:
        waiting = deque(tiles(blocks, -(-pixels // solver.masked.mask.shape[1])))
        with worker_client() as client:
            pending: deque[Future[list[BlockResult]]] = deque()
            while waiting or pending:
                while waiting and len(pending) < AHEAD * max(1, sum(cast(dict[str, int], client.nthreads()).values())):
                    pending.append(_submit(client, solver, waiting.popleft()))
                done = pending.popleft()
                yield from done.result()
                done.release()

    return solved


def _submit(client: Client, solver: BlockSolver, tile: tuple[Block, ...]) -> Future[list[BlockResult]]:
    part = solver.within(slice(tile[0].rows.start, tile[-1].rows.stop))
    return client.submit(solve_tile, part, tile, pure=False)


@dataclass(frozen=True)
class ArchivedFrames:
    """The frames of an archived session as a FrameSource, on whatever machine: each process fetches a file when it is
    first read, checked by its hash, and keeps the frames of one session."""

    address: str
    session: str
    files: dict[str, FileEntry]

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Rows [start, stop) of a frame. Raises RigError archive.damaged naming the file, archive.unreachable."""
        with _LOCK:
            folder = _folder(self.session)
            if not (folder / frame.path).exists():
                self._fetch(frame.path, folder)
        return FolderFrames(folder).rows(frame, start, stop)

    def _fetch(self, name: str, folder: Path) -> None:
        if name not in self.files:
            raise RigError(ErrorCode.ARCHIVE_DAMAGED, f"{name}: the session's entry does not name it", file=name)
        try:
            ContentStore(self.address).get(self.files[name].sha256, folder / name)
        except RigError as error:
            raise RigError(error.code, f"{name} ({error.detail})", **error.context, file=name) from error


_LOCK = threading.Lock()
_KEPT: dict[str, tempfile.TemporaryDirectory[str]] = {}


def _folder(session: str) -> Path:
    """This process's folder of a session's frames; another session's is removed for it."""
    if session not in _KEPT:
        while _KEPT:
            _KEPT.popitem()[1].cleanup()
        _KEPT[session] = tempfile.TemporaryDirectory(prefix="lightpose-frames-")
    return Path(_KEPT[session].name)
