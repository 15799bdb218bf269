"""An archive solved by workers that are killed, over a scheduler and a database that restart: each session once."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from acquisition.archive import distributed
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity, result_name
from acquisition.formats import export
from acquisition.formats.folders import session_folder
from acquisition.models.result import SolveSettings
from acquisition.runner.session_solve import solve_in_cell
from tests.acquisition.archive import machines, session_copies

SESSIONS = int(os.environ.get("LIGHTPOSE_ARCHIVE_SESSIONS", "1000"))
KILL_EVERY_S = 10.0
SETTINGS = SolveSettings(depth_rounds=1)


def at_half(archive: Archive, count: int, work: threading.Thread) -> None:
    """Waits until so many sessions are solved, or the work has ended."""
    while work.is_alive() and sum(row.solver is not None for row in archive.catalogue.sessions()) < count:
        time.sleep(0.5)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_killed_workers_and_restarts_solve_each_session_once(tmp_path: Path):
    """Also a second caller, who begins in the middle."""
    identity = SolveIdentity(settings=SETTINGS)
    settings = tmp_path / "settings.json"
    settings.write_text(SETTINGS.model_dump_json())
    with machines.postgres() as database, machines.cluster(tmp_path / "dask", 3) as cluster:
        archive = Archive.create(str(tmp_path / "archive"), database.address, patience_s=120)
        keys = {
            archive.push(
                session_copies.make(tmp_path / "sessions" / f"20261121-190041-{seed:06x}", seed, results=False)
            ).key: seed
            for seed in range(SESSIONS)
        }
        reports: list[distributed.SolveReport] = []
        begun = time.monotonic()
        work = threading.Thread(
            target=lambda: reports.append(
                distributed.solve(archive, list(keys), identity, scheduler=cluster.address, workers=0)
            )
        )
        with machines.killing(cluster.workers, KILL_EVERY_S, seed=1) as killed:
            work.start()
            at_half(archive, SESSIONS // 4, work)
            cluster.restart_scheduler()
            options = [
                "--catalogue",
                database.address,
                "--scheduler",
                cluster.address,
                "--settings",
                settings,
                "--json",
            ]
            command = [sys.executable, "-m", "api.cli", "archive", "solve", archive.address, *options]
            second = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            at_half(archive, SESSIONS // 2, work)
            database.stop()
            database.start()
            work.join()
            seconds, kills = time.monotonic() - begun, len(killed)
        output, _ = second.communicate(timeout=600)
        rows = [archive.catalogue.results(key) for key in keys]
        found = {key: archive.results(key) for key in keys}
        faults = archive.verify()
        archive.close()
    other = json.loads(output.splitlines()[-1])
    restarts = sum(worker.starts - 1 for worker in cluster.workers)
    interrupted = sum(row.attempts - 1 for (row,) in rows)
    print(f"\n{SESSIONS} sessions in {seconds:.0f} s, {kills} kills meanwhile, {restarts} workers restarted, "
          f"{interrupted} solves begun again")  # fmt: skip
    assert [(row.state, row.finishes) for (row,) in rows] == [("done", 1)] * SESSIONS
    assert all(len(results) == 1 for results in found.values())
    assert faults == []
    (report,) = reports
    assert report.solved + other["solved"] == SESSIONS
    assert report.solved + report.kept == SESSIONS
    assert report.failed == other["failed"] == 0
    assert kills >= min(3, seconds / KILL_EVERY_S / 2)
    assert restarts >= kills / 2  # one that is killed twice at once is started once
    assert cluster.scheduler.starts == 2
    for key in list(keys)[:: max(1, SESSIONS // 20)]:
        compare(tmp_path, archive, key, keys[key])


def compare(tmp_path: Path, archive: Archive, key: str, seed: int) -> None:
    """The archived normal map is that of a solve in this process, to the last digit."""
    capture = session_folder.read(tmp_path / "sessions" / f"20261121-190041-{seed:06x}")
    last = max(shot.key.pass_number for shot in capture.shots)
    here = solve_in_cell(capture.observations(last), capture.cell, capture.calibration, SETTINGS)
    (name,) = archive.contents.names(f"sessions/{key}/results")
    entry = archive.result(name)
    assert name == result_name(key, entry.solver, SolveIdentity(settings=SETTINGS).hash)
    archive.fetch(entry.files, tmp_path / "back" / str(seed))
    (stored,) = (tmp_path / "back" / str(seed) / "results").iterdir()
    there = export.read(stored)
    for field in ("normals", "sigma_deg", "depth", "albedo", "mask"):
        np.testing.assert_array_equal(getattr(there, field), getattr(here, field), err_msg=f"{field} of seed {seed}")


@pytest.mark.long
def test_catalogue_in_postgres_behaves_as_sqlite_does():
    """The suite's tests of archive, claims and solves once more, over PostgreSQL; without those of SQLite's file."""
    chosen = "(claims or archive or solving) and not (lost_catalogue or moved or newer or commands)"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, str(Path(__file__).parent)]
    with machines.postgres() as database:
        environment = os.environ | {"LIGHTPOSE_TEST_CATALOGUE": database.address}
        run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    print(run.stdout.splitlines()[-1])
    assert run.returncode == 0, run.stdout[-4000:]
