"""The compute process: one spawned child of low priority that runs one job at a time, with two priority levels.

A job is a function of `jobs` called by its name with small arguments; images and maps stay in the session folder. So
the web process imports no numerical kernel, a long solve never holds its interpreter lock, and a job that crashes or is
killed takes only this process with it. Steps of a session are urgent and preempt jobs that are marked preemptible (kill
and restart later), because these have no side effect before they end. The child ends when its parent does.
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
"""Period, s, of looking for the stop token and for urgent jobs while a job runs."""


class Preempted(Exception):  # noqa: N818 - the job is restarted later, it is no error
    """Raised where a preemptible job was killed for an urgent one."""


class Compute:
    """Runs jobs in a child process; `run` may be called from any thread, one job runs at a time."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._busy = threading.Lock()
        self._counting = threading.Lock()
        self._urgent = 0  # number of jobs, waiting or running, that are not preemptible
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None

    def run(self, stop: threading.Event, job: str, *arguments: Any, preemptible: bool = False) -> Any:
        """Runs the function `job` of `acquisition.runner.jobs` and returns what it returns.

        A `preemptible` job is killed when one comes that is not. Raises what the job raises, Halted when the
        token is set meanwhile (the job is killed), Preempted, and RigError session.step_failed when the process dies.
        """
        if preemptible:
            return self._run(stop, job, arguments, preemptible)
        with self._counting:
            self._urgent += 1
        try:
            return self._run(stop, job, arguments, preemptible)
        finally:
            with self._counting:
                self._urgent -= 1

    def _run(self, stop: threading.Event, job: str, arguments: tuple[Any, ...], preemptible: bool) -> Any:
        with self._busy:
            if preemptible and self._urgent:
                raise Preempted
            connection = self._ready()
            connection.send((job, arguments))
            while not connection.poll(_POLL_S):
                if stop.is_set():
                    self._kill()
                    raise Halted
                if preemptible and self._urgent:
                    self._kill()
                    raise Preempted
            try:
                succeeded, result = connection.recv()
            except (EOFError, ConnectionResetError) as error:
                code = self._kill()
                raise RigError(
                    ErrorCode.SESSION_STEP_FAILED,
                    f"The compute process ended in {job} (exit code {code})",
                    job=job,
                ) from error
        if succeeded:
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
    process_priority.set_niceness(process_priority.BACKGROUND)
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
        except Exception as error:  # noqa: BLE001 - a job's fault is the step's failure, logged with its trace
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
