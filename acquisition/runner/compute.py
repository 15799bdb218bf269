"""The compute process: one spawned child of low priority that runs one job at a time, with two priority levels.

A job is a function of `jobs` called by its name with small arguments; images and maps stay in the session folder. So
the web process imports no numerical kernel, a long solve never holds its interpreter lock, and a job that crashes or is
killed ends only this process.

No job has an effect before it ends, so it can be killed and repeated. Steps of a session are urgent: they kill jobs
that are marked preemptible, which are restarted later. A job whose process was killed, by the kernel when memory runs
out or by a person, is repeated once in a new process. If that is killed too, the job is given up, because what it needs
is not available. The child ends when its parent does.
"""

import errno
import importlib
import logging
import multiprocessing
import os
import signal
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from acquisition import process_priority
from acquisition.models.errors import ErrorCode, Halted, RigError

_log = logging.getLogger(__name__)
_POLL_S = 0.02
"""Period, s, of checking for the stop token and for urgent jobs while a job runs."""
_TRIES = 2
"""Number of processes that may end during a job before it is given up."""
_DISK_CODES = {
    errno.ENOSPC: ErrorCode.STORE_DISK_FULL,
    errno.EDQUOT: ErrorCode.STORE_DISK_FULL,
    errno.EROFS: ErrorCode.STORE_UNWRITABLE,
    errno.EIO: ErrorCode.STORE_UNWRITABLE,
}
"""Codes of a job that the disk has ended: it can be done again. Any other OSError fails its step."""


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
        self._closed = False
        self._processor_s: dict[str, float] = {}

    @property
    def processor_s(self) -> dict[str, float]:
        """Processor time, s, of all jobs that ended, by name; unlike elapsed time it does not grow with other load."""
        return dict(self._processor_s)

    def run(
        self, stop: threading.Event, job: str, *arguments: Any, preemptible: bool = False,
        while_waiting: threading.Event | None = None,
    ) -> Any:  # fmt: skip
        """Runs the function `job` of `acquisition.runner.jobs` and returns what it returns.

        A `preemptible` job is killed when a job comes that is not. Raises what the job raises; Halted when the token is
        set meanwhile (the job is killed, or its turn is no longer awaited), when `while_waiting` is set before its
        turn, or when the process is closed; Preempted; and RigError compute.lost when the process ended during the job,
        and its successor too.
        """
        ending = stop if while_waiting is None else while_waiting
        if preemptible:
            return self._run(stop, job, arguments, preemptible, ending)
        with self._counting:
            self._urgent += 1
        try:
            return self._run(stop, job, arguments, preemptible, ending)
        finally:
            with self._counting:
                self._urgent -= 1

    def _run(
        self, stop: threading.Event, job: str, arguments: tuple[Any, ...], preemptible: bool, ending: threading.Event
    ) -> Any:
        while not self._busy.acquire(timeout=_POLL_S):  # another one's job may take a minute
            if stop.is_set() or ending.is_set():
                raise Halted
        try:
            if preemptible and self._urgent:
                raise Preempted
            succeeded, result = self._exchange(stop, job, arguments, preemptible)
        finally:
            self._busy.release()
        if succeeded:
            return result
        raise result

    def _exchange(
        self, stop: threading.Event, job: str, arguments: tuple[Any, ...], preemptible: bool
    ) -> tuple[bool, Any]:
        """Returns whether the job succeeded, and its result or error; repeats it if the process ends."""
        tries = 0
        while True:
            try:
                return self._try(stop, job, arguments, preemptible)
            except (EOFError, OSError) as error:  # the other end of the pipe has gone
                ended, tries = _how_it_ended(self._kill(), error), tries + 1
                if tries == _TRIES:
                    detail = f"The compute process ended {_TRIES} times during {job}, the last time {ended}"
                    raise RigError(ErrorCode.COMPUTE_LOST, detail, job=job) from error
                _log.warning("the compute process ended during %s, %s; the job is repeated once", job, ended)

    def _try(self, stop: threading.Event, job: str, arguments: tuple[Any, ...], preemptible: bool) -> tuple[bool, Any]:
        """Returns whether the job succeeded, and its result or error. Raises EOFError, OSError if the process ends."""
        if self._closed or stop.is_set():  # while the service ends, waiting jobs must not each start a process
            raise Halted
        connection = self._ready()
        connection.send((job, arguments))
        try:
            while not connection.poll(_POLL_S):
                if stop.is_set():
                    raise Halted
                if preemptible and self._urgent:
                    raise Preempted
        except BaseException:
            self._kill()  # else the next job would receive this one's result
            raise
        succeeded, result, processor_s = connection.recv()
        self._processor_s[job] = self._processor_s.get(job, 0.0) + processor_s
        return succeeded, result

    def warm(self) -> None:
        """Starts the process ahead of the first job."""
        with self._busy:
            self._ready()

    def close(self) -> None:
        """Ends the process, whatever it is doing; no job runs afterwards."""
        self._closed = True
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


def _how_it_ended(exit_code: int | None, error: Exception) -> str:
    """Describes for people how a process ended; `exit_code` is None if it could not even be started."""
    if exit_code is None:
        return f"before it had started ({error})"
    if exit_code >= 0:
        return f"with exit code {exit_code}"
    name = f"signal {-exit_code}"
    with suppress(ValueError):
        name = signal.Signals(-exit_code).name
    hint = ", which the kernel sends when memory runs out" if exit_code == -signal.SIGKILL else ""
    return f"by {name}{hint}"


def _serve(connection: Connection) -> None:
    process_priority.set_niceness(process_priority.BACKGROUND)
    process_priority.end_first_without_memory()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    jobs = importlib.import_module("acquisition.runner.jobs")  # here only: the kernels belong to this process
    while True:
        try:
            job, arguments = connection.recv()
        except EOFError:
            return
        since = time.process_time()
        try:
            outcome: tuple[bool, Any] = (True, getattr(jobs, job)(*arguments))
        except RigError as error:
            outcome = (False, error)
        except OSError as error:
            code = _DISK_CODES.get(error.errno or 0, ErrorCode.SESSION_STEP_FAILED)
            outcome = (False, RigError(code, f"{job}: {error}", job=job))
        except Exception as error:  # noqa: BLE001 - a job's fault is the step's failure, logged with its trace
            _log.exception("job %s failed", job)
            outcome = (
                False,
                RigError(ErrorCode.SESSION_STEP_FAILED, f"{job}: {error!r}", job=job),
            )
        connection.send((*outcome, time.process_time() - since))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
