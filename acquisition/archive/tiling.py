"""One large capture on many workers: the blocks of its final solve are grouped in tiles, each a task of Dask.

What distant pixels share (lamp intensities and positions, reflectance, noise, the coarse depth, light from other
surfaces) is estimated once by the session's task, on the same coarse grid and pixel sample as in any solve. In the
final solve a pixel is coupled only to neighbours within a few rows (`block_solve`). So a tile is a run of blocks with
that margin, which can be read and solved anywhere. The session's task makes the joined maps integrable and integrates
them as a whole. So the blocks, and with them the result, are the same as on one machine.

Tiles are full rows, because frames are stored by rows. Dask computes a tile again that is lost with its worker. If the
session's task is lost, its claim runs out and the whole solve is repeated.
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
"""Number of tiles submitted per worker thread: one at work and one waiting, so that results do not pile up."""


def tiles(blocks: Sequence[Block], rows: int) -> list[tuple[Block, ...]]:
    """Groups consecutive blocks into runs; the block with which a run reaches `rows` rows is its last."""
    found: list[tuple[Block, ...]] = []
    run: list[Block] = []
    for block in blocks:
        run.append(block)
        if block.rows.stop - run[0].rows.start >= rows:
            found.append(tuple(run))
            run = []
    return found + ([tuple(run)] if run else [])


def solve_tile(solver: BlockSolver, blocks: tuple[Block, ...]) -> list[BlockResult]:
    """Solves the blocks of a tile with a solver of its rows; this is one Dask task."""
    return [solver(block) for block in blocks]


def by_tiles(pixels: int) -> BlockMap:
    """Returns a map that solves blocks on the workers of this task's scheduler, in tiles of about `pixels` pixels;
    outside of a worker, or in another thread than its task's, this is `map`, which solves the blocks here."""
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
    """The frames of an archived session as a FrameSource, on any machine. Each process fetches a file when it is first
    read, checks its hash, and keeps the frames of one session."""

    address: str
    session: str
    files: dict[str, FileEntry]

    def rows(self, frame: FrameRef, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Reads rows [start, stop) of a frame. Raises RigError archive.damaged naming the file, archive.unreachable."""
        with _LOCK:
            folder = _folder(self.session)
            if not (folder / frame.path).exists():
                self._fetch(frame.path, folder)
        return FolderFrames(folder).rows(frame, start, stop)

    def _fetch(self, name: str, folder: Path) -> None:
        if name not in self.files:
            raise RigError(
                ErrorCode.ARCHIVE_DAMAGED,
                f"{name}: the session's entry in the archive does not list this file",
                file=name,
            )
        try:
            ContentStore(self.address).get(self.files[name].sha256, folder / name)
        except RigError as error:
            raise RigError(error.code, f"{name} ({error.detail})", **error.context, file=name) from error


_LOCK = threading.Lock()
_KEPT: dict[str, tempfile.TemporaryDirectory[str]] = {}


def _folder(session: str) -> Path:
    """Returns this process's folder of a session's frames; removes that of another session."""
    if session not in _KEPT:
        while _KEPT:
            _KEPT.popitem()[1].cleanup()
        _KEPT[session] = tempfile.TemporaryDirectory(prefix="lightpose-frames-")
    return Path(_KEPT[session].name)
