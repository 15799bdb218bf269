"""A large capture in tiles on Dask workers: each row once, and the maps of one machine to the last digit."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from distributed import Client, LocalCluster
from distributed.protocol import pickle
from hypothesis import given
from hypothesis import strategies as st

from acquisition.archive import solving, tiling
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity, result_name
from acquisition.archive.solving import SolveJob, Tiling
from acquisition.archive.tiling import ArchivedFrames
from acquisition.formats import export
from acquisition.formats.folders import session_folder as folders
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals import pyramid
from acquisition.normals.block_solve import Block, BlockMap, BlockResult, BlockSolver
from acquisition.normals.images import normalised_images
from acquisition.runner.session_solve import solve_in_cell
from tests.acquisition.archive import session_copies

SETTINGS = SolveSettings(depth_rounds=1)
FACTOR = 4


@given(lengths=st.lists(st.integers(1, 40), min_size=1, max_size=40), gap=st.integers(0, 9), rows=st.integers(1, 90))
def test_tiles_hold_each_block_once_in_order(lengths: list[int], gap: int, rows: int):
    blocks: list[Block] = []
    for length in lengths:
        start = blocks[-1].rows.stop + gap if blocks else gap
        blocks.append(Block(slice(start, start + length), np.zeros(0, int)))
    found = tiling.tiles(blocks, rows)
    assert [block for tile in found for block in tile] == blocks
    for tile in found[:-1]:
        assert tile[-1].rows.stop - tile[0].rows.start >= rows
        assert len(tile) == 1 or tile[-2].rows.stop - tile[0].rows.start < rows


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of 16 rows, read from files each time, as those of a large capture."""
    monkeypatch.setattr(pyramid, "BLOCK_VALUES", 1)
    monkeypatch.setattr(normalised_images, "MAX_HELD_BYTES", 0)


def solved_here(folder: Path, block_map: BlockMap = map) -> NormalMap:
    capture = folders.read(folder)
    images = capture.observations(max(shot.key.pass_number for shot in capture.shots))
    return solve_in_cell(images, capture.cell, capture.calibration, SETTINGS, block_map)


def same(one: NormalMap, two: NormalMap) -> None:
    for name in ("normals", "sigma_deg", "depth", "albedo", "mask", "flags", "indirect", "residual"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)


@pytest.mark.usefixtures("small_blocks")
def test_tiles_by_pickle_equal_one_solve(session_folder: Callable[..., Path]):
    """What a worker is given is pickled, and is no more than its rows."""
    folder = session_copies.enlarge(session_folder(seed=1), FACTOR)
    sent: list[int] = []

    def by_pickle(solver: BlockSolver, blocks: Sequence[Block]) -> list[BlockResult]:
        results: list[BlockResult] = []
        for tile in tiling.tiles(blocks, 40):
            part = solver.within(slice(tile[0].rows.start, tile[-1].rows.stop))
            sent.append(part.masked.mask.shape[0])
            task = pickle.loads(pickle.dumps((part, tile)))
            results += pickle.loads(pickle.dumps(tiling.solve_tile(*task)))
        return results

    tiled = solved_here(folder, by_pickle)
    assert len(sent) >= 3
    assert max(sent) <= 48 + 2 * 12
    same(tiled, solved_here(folder))


@pytest.mark.usefixtures("small_blocks")
def test_large_session_is_solved_in_tiles_by_workers(
    archive: Archive, session_folder: Callable[..., Path], tmp_path: Path
):
    folder = session_copies.enlarge(session_folder(seed=2), FACTOR)
    key = archive.push(folder).key
    identity = SolveIdentity(settings=SETTINGS)
    job = SolveJob(
        archive.address, archive.catalogue_address, key, identity, version("lightpose"), "first", Tiling(1, 6000)
    )
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        assert client.submit(solving.solve, job).result().state == "done"
        tasks = {str(transition[0]) for transition in cluster.scheduler.transition_log}
    assert sum(task.startswith("solve_tile-") for task in tasks) >= 3
    archive.fetch(archive.result(result_name(key, version("lightpose"), identity.hash)).files, tmp_path / "back")
    (stored,) = (tmp_path / "back" / "results").iterdir()
    same(export.read(stored), solved_here(folder))


def test_archived_frame_that_is_damaged_is_named(archive: Archive, session_folder: Callable[..., Path]):
    folder = session_folder(seed=3)
    key = archive.push(folder).key
    files = archive.session(key).files
    name = "passes/0/shots/1.tiff"
    digest = files[name].sha256
    archive.contents.write(f"objects/{digest[:2]}/{digest}", b"rot")
    shot = next(shot for shot in folders.read(folder).shots if shot.frame.path == name)
    frames = ArchivedFrames(archive.address, key, files)
    with pytest.raises(RigError, match=name) as damaged:
        frames.rows(shot.frame, 0, 5)
    assert damaged.value.code is ErrorCode.ARCHIVE_DAMAGED
    with pytest.raises(RigError, match="does not list this file"):
        replace(frames, files={}).rows(shot.frame, 0, 5)
