"""Real processes of an archive on several machines: PostgreSQL, a Dask scheduler, workers that are restarted."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquisition.archive import answering, distributed
from acquisition.models.errors import RigError

PG = next(iter(sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)), None)
"""Debian's PostgreSQL, whose programs are not on the path."""
ENVIRONMENT = os.environ | distributed.worker_environment(1)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Postgres:
    """A PostgreSQL server of its own on loopback; its programs refuse to run as root."""

    def __init__(self, folder: Path) -> None:
        if PG is None:
            pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
        self._folder, self._port = folder, free_port()
        self._user = "postgres" if os.getuid() == 0 else None
        if self._user is not None:
            shutil.chown(folder, self._user)
        self._run("initdb", "--pgdata", folder / "data", "--username", "lightpose", "--auth", "trust")
        self.start()

    @property
    def address(self) -> str:
        return f"postgresql://lightpose@127.0.0.1:{self._port}/postgres"

    @property
    def pid(self) -> int:
        return int((self._folder / "data" / "postmaster.pid").read_text().split()[0])

    def start(self) -> None:
        options = f"-p {self._port} -h 127.0.0.1 -k {self._folder}"
        self._run(
            "pg_ctl",
            "--pgdata",
            self._folder / "data",
            "-w",
            "-t",
            "120",
            "-o",
            options,
            "-l",
            self._folder / "log",
            "start",
        )

    def stop(self) -> None:
        """Ends it at once, as a crash does."""
        self._run("pg_ctl", "--pgdata", self._folder / "data", "-w", "-t", "120", "-m", "immediate", "stop")

    def _run(self, program: str, *arguments: object) -> None:
        assert PG is not None
        command = [str(PG / program), *map(str, arguments)]
        # The server inherits what it is started with: a pipe would never end.
        with (self._folder / "commands").open("ab") as log:
            done = subprocess.run(command, user=self._user, cwd="/", stdout=log, stderr=log, check=False)
        assert done.returncode == 0, (self._folder / "commands").read_text()


@contextmanager
def postgres() -> Iterator[Postgres]:
    """A server for the time of the block; its folder is where another user can reach it."""
    with tempfile.TemporaryDirectory(prefix="lightpose-postgres-") as folder:
        server = Postgres(Path(folder))
        try:
            yield server
        finally:
            server.stop()


class Supervised:
    """A process that is started again whenever it ends, as a unit file or a compose file does."""

    def __init__(self, *command: object, log: Path) -> None:
        self._command, self._log, self._closing = [sys.executable, "-m", *map(str, command)], log, False
        self.starts = 0
        self._start()
        self._thread = threading.Thread(target=self._supervise, daemon=True)
        self._thread.start()

    def _start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command, stdout=log, stderr=log, env=ENVIRONMENT, start_new_session=True
            )
        self.starts += 1

    def _supervise(self) -> None:
        while True:
            self._process.wait()
            if self._closing:
                return
            time.sleep(0.5)
            self._start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def kill(self) -> None:
        """SIGKILL to the process and all of its children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        self._closing = True
        self.kill()
        self._thread.join(30)


class Cluster:
    """A scheduler and its workers."""

    def __init__(self, folder: Path, workers: int) -> None:
        folder.mkdir()
        self._port = free_port()
        self.address = f"tcp://127.0.0.1:{self._port}"
        log = folder / "log"
        self.scheduler = Supervised(
            "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", self._port, "--no-dashboard", log=log
        )
        more = ("--nthreads", 1, "--no-dashboard", "--local-directory", folder, "--death-timeout", 60)
        self.workers = [Supervised("distributed.cli.dask_worker", self.address, *more, log=log) for _ in range(workers)]

    def restart_scheduler(self) -> None:
        """Kills the scheduler and waits until the next one answers."""
        starts = self.scheduler.starts
        self.scheduler.kill()
        while self.scheduler.starts == starts or not self._answers():
            time.sleep(0.1)

    def _answers(self) -> bool:
        try:
            answering.require_scheduler(self.address)
        except RigError:
            return False
        return True

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.close()


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A scheduler and workers for the time of the block."""
    started = Cluster(folder, workers)
    try:
        yield started
    finally:
        started.close()


@contextmanager
def killing(workers: list[Supervised], every_s: float, seed: int) -> Iterator[list[float]]:
    """Kills one of the workers again and again for the time of the block; gives the times, of the monotonic clock."""
    ended, choose = threading.Event(), np.random.default_rng(seed)
    killed: list[float] = []

    def kill() -> None:
        while not ended.wait(every_s):
            workers[choose.integers(len(workers))].kill()
            killed.append(time.monotonic())

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    try:
        yield killed
    finally:
        ended.set()
        thread.join()
