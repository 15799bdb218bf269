"""The process that does the heavy work: one spawned, niced child that runs one job at a time.

A job is a function of `jobs` called by its name with small arguments; images and maps stay in the session folder. The
web process so imports no numerical kernel, a long solve never holds its interpreter lock, and a job that dies (or is no
longer wanted) takes only this process with it. The child ends when its parent does.
"""

import errno
import importlib
import logging
import multiprocessing
import os
import threading
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from acquisition.devices import process_priority
from acquisition.models.errors import ErrorCode, Halted, RigError

_log = logging.getLogger(__name__)
_POLL_S = 0.02


class GaveWay(Exception):  # noqa: N818 - begun again later, it is no error
    """Raised where a job that yields was killed for one that does not."""


class Compute:
    """Runs jobs in a child process; `run` may be called from any thread, one job runs at a time."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._busy = threading.Lock()
        self._counting = threading.Lock()
        self._wanted = 0  # jobs that do not yield and wait or run
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None

    def run(self, stop: threading.Event, job: str, *arguments: Any, yields: bool = False) -> Any:
        """Runs the function `job` of `acquisition.runner.jobs` and returns what it returns.

        A job that `yields` is killed when another one comes that does not. Raises what the job raises, Halted when the
        token is set meanwhile (the job is killed), GaveWay, and RigError session.step_failed when the process dies.
        """
        if yields:
            return self._run(stop, job, arguments, yields)
        with self._counting:
            self._wanted += 1
        try:
            return self._run(stop, job, arguments, yields)
        finally:
            with self._counting:
                self._wanted -= 1

    def _run(self, stop: threading.Event, job: str, arguments: tuple[Any, ...], yields: bool) -> Any:
        with self._busy:
            if yields and self._wanted:
                raise GaveWay
            connection = self._ready()
            connection.send((job, arguments))
            while not connection.poll(_POLL_S):
                if stop.is_set():
                    self._kill()
                    raise Halted
                if yields and self._wanted:
                    self._kill()
                    raise GaveWay
            try:
                worked, result = connection.recv()
            except (EOFError, ConnectionResetError) as error:
                code = self._kill()
                raise RigError(
                    ErrorCode.SESSION_STEP_FAILED,
                    f"The compute process ended in {job} (exit code {code})",
                    job=job,
                ) from error
        if worked:
            return result
        raise result

    def warm(self) -> None:
        """Starts the process ahead of the first job."""
        with self._busy:
            self._ready()

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self._kill()

    def _ready(self) -> Connection:
        if self._process is not None and self._process.is_alive() and self._connection is not None:
            return self._connection
        self._kill()
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs,), name="lightpose-compute", daemon=True)
        process.start()
        theirs.close()
        self._process, self._connection = process, ours
        return ours

    def _kill(self) -> int | None:
        process, self._process = self._process, None
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()
        if process is None:
            return None
        process.kill()
        process.join()
        return process.exitcode


def _serve(connection: Connection) -> None:
    process_priority.take(process_priority.BACKGROUND)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    jobs = importlib.import_module("acquisition.runner.jobs")  # here only: the kernels belong to this process
    while True:
        try:
            job, arguments = connection.recv()
        except EOFError:
            return
        try:
            outcome: tuple[bool, Any] = (True, getattr(jobs, job)(*arguments))
        except RigError as error:
            outcome = (False, error)
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            code = ErrorCode.STORE_DISK_FULL if full else ErrorCode.SESSION_STEP_FAILED
            outcome = (False, RigError(code, f"{job}: {error}", job=job))
        except Exception as error:  # noqa: BLE001 - a job's fault is the step's failure, told with its trace
            _log.exception("job %s failed", job)
            outcome = (
                False,
                RigError(ErrorCode.SESSION_STEP_FAILED, f"{job}: {error!r}", job=job),
            )
        connection.send(outcome)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
