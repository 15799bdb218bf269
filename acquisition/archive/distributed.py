"""Solves of a whole archive on Dask workers: submit what is missing until the catalogue has all results.

Dask's scheduler forgets its queue when it restarts, and workers may die. Neither matters here, because no result is
known from a future alone: the catalogue records what is solved. A job whose future was lost is submitted again, and
finds its solve done, claimed by another, or free. Two callers divide the work between them in the same way.
"""

import asyncio
import os
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version

import sqlalchemy as sa
from distributed import Client, Future, LocalCluster
from distributed.client import FutureCancelledError
from distributed.comm.core import connect
from distributed.scheduler import KilledWorker

from acquisition.archive import claims, solving
from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import result, session
from acquisition.archive.entries import SolveIdentity
from acquisition.archive.solving import DEFAULT_TILING, SolveJob, SolveOutcome, Tiling
from acquisition.models.errors import ErrorCode, RigError

CONNECT_S = 20.0
"""Time-out, s, of one attempt to connect: a scheduler that restarts on a busy machine answers late."""
RETRY_CONNECT_S = 1.0
PATIENCE_S = 900.0
"""Time, s, for which the caller waits for a scheduler that restarts during the work."""
WINDOW = 500
"""Number of jobs submitted ahead: enough for hundreds of workers, and few to submit again."""
POLL_S = 0.05
"""Period, s, of checking which jobs have ended; short compared with a solve, because it delays the last one's end."""
RETRY_S = claims.LEASE_S / 3
"""Time, s, after which a solve that another has claimed is submitted again."""
MOST_KILLS = 4
"""Failures of a job by killed workers until it counts as failed; for each, Dask itself tries the job three times."""


@dataclass(frozen=True)
class Moved:
    """A session whose normals differ from the result before: mean angle, degrees, and rms of the angle over its σ."""

    session: str
    object: str
    mean_deg: float
    over_sigma: float


@dataclass(frozen=True)
class SolveReport:
    """What one call did: numbers of sessions, failures with reasons, and changed normals, largest over σ first."""

    solved: int
    kept: int
    failed: int
    failures: dict[str, str]
    moved: tuple[Moved, ...]


def solve(
    archive: Archive,
    sessions: Sequence[str],
    identity: SolveIdentity,
    *,
    scheduler: str | None,
    workers: int,
    tiling: Tiling = DEFAULT_TILING,
    progress: Callable[[int], None] = lambda done: None,
    returned: Callable[[str], None] = lambda why: None,
) -> SolveReport:
    """Solves sessions (keys) with the settings of `identity`, on a scheduler's workers or on `workers` local ones.

    Captures as large as `tiling` states are divided between the workers. `progress` gets the number of sessions that
    have ended; `returned` gets why a worker gave a session back, which is tried again without end. Raises RigError
    archive.no_scheduler when none answers within `CONNECT_S`, or one that restarts does not come back within
    `PATIENCE_S`.
    """
    call = uuid.uuid4().hex
    solver = version("lightpose")
    done = _done(archive, solver, identity.hash)
    jobs = [
        SolveJob(archive.address, archive.catalogue_address, key, identity, solver, call, tiling)
        for key in sessions
        if key not in done
    ]
    if jobs:
        with _address(scheduler, workers) as address:
            _Dispatch(address, jobs, progress, returned).run()
    return report(archive, sessions, solver, identity.hash, call)


def worker_environment(threads: int) -> dict[str, str]:
    """Returns the environment of a worker's process: threads of the kernels, and Dask's own samplers at 5 Hz.

    By default Dask samples the running call 100 times and its event loop 50 times a second, which takes 4 % of a core
    from each worker. A solve takes a second or more, so 5 Hz suffice for its profile.
    """
    return dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(threads)) | {
        "DASK_DISTRIBUTED__WORKER__PROFILE__INTERVAL": "200ms",
        "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "200ms",
    }


@contextmanager
def _address(scheduler: str | None, workers: int) -> Generator[str]:
    """Yields the scheduler's address: the given one, or that of workers started here with one thread each."""
    if scheduler is not None:
        yield scheduler
        return
    environment = worker_environment(max(1, (os.cpu_count() or 1) // workers))
    with LocalCluster(
        n_workers=workers, threads_per_worker=1, env=environment, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield str(cluster.scheduler_address)  # pyright: ignore[reportAttributeAccessIssue] - in an event loop a coroutine


class _Dispatch:
    """Submits jobs through one scheduler until each has ended; used in one thread."""

    def __init__(
        self, address: str, jobs: Sequence[SolveJob], progress: Callable[[int], None], returned: Callable[[str], None]
    ) -> None:
        self._address = address
        self._waiting = deque(jobs)
        self._later: deque[tuple[float, SolveJob]] = deque()  # claimed by another; when to ask again
        self._pending: dict[Future[SolveOutcome], SolveJob] = {}
        self._killed: Counter[str] = Counter()
        self._progress, self._returned = progress, returned
        self._stated = False  # why sessions come back, since one was solved
        self._total = len(jobs)

    def run(self) -> None:
        """Returns when every job is done or has failed. Raises RigError as `solve` does."""
        client = _connect(self._address, CONNECT_S)
        try:
            while self._waiting or self._later or self._pending:
                if client.status != "running":
                    client.close(timeout=1)
                    self._waiting.extend(self._pending.values())
                    self._pending.clear()
                    client = _connect(self._address, PATIENCE_S)
                self._submit(client)
                time.sleep(POLL_S)
                self._collect()
                self._progress(self._total - len(self._waiting) - len(self._later) - len(self._pending))
        finally:
            client.close(timeout=2)

    def _submit(self, client: Client) -> None:
        now = time.monotonic()
        while self._later and self._later[0][0] <= now:
            self._waiting.append(self._later.popleft()[1])
        jobs = [self._waiting.popleft() for _ in range(min(len(self._waiting), WINDOW - len(self._pending)))]
        if not jobs:
            return
        # A new name each time: a job that is submitted again must not be joined to a lost future.
        names = [f"solve-{job.session[:12]}-{uuid.uuid4().hex[:8]}" for job in jobs]
        self._pending |= zip(client.map(solving.solve, jobs, key=names, pure=False), jobs, strict=True)

    def _collect(self) -> None:
        for future in [future for future in self._pending if future.status != "pending"]:
            job = self._pending.pop(future)
            outcome = self._outcome(future, job)
            if outcome is None:
                self._waiting.append(job)
            elif outcome.state in ("elsewhere", "returned"):
                self._later.append((time.monotonic() + RETRY_S, job))
            self._state_return(outcome)
            future.release()

    def _state_return(self, outcome: SolveOutcome | None) -> None:
        """States why a session came back, such as a full disk, once until one is solved: all may come back for it."""
        if outcome is None:
            return
        if outcome.state == "done":
            self._stated = False
        elif outcome.state == "returned" and not self._stated:
            self._stated = True
            self._returned(outcome.detail)

    def _outcome(self, future: Future[SolveOutcome], job: SolveJob) -> SolveOutcome | None:
        """Returns the outcome of a job whose future ended; None if it has to be submitted again."""
        if future.status not in ("finished", "error"):
            return None  # cancelled or lost with the scheduler
        try:
            outcome = future.result(timeout=10)
        except KilledWorker:
            self._killed[job.session] += 1
            if self._killed[job.session] < MOST_KILLS:
                return None
            return _give_up(job)
        except (TimeoutError, FutureCancelledError, OSError):
            return None  # the worker that held the answer is gone; the catalogue has the outcome
        return outcome


def _give_up(job: SolveJob) -> SolveOutcome:
    """Records as failed a job that kills its workers."""
    why = "its worker was killed each time (most often memory ran out): give workers more memory"
    archive = Archive(job.address, job.catalogue)
    held = claims.Claim(job.key, uuid.uuid4().hex, job.call)
    state = claims.claim(archive.catalogue, held)
    if state == "claimed":
        claims.fail(archive.catalogue, held, why)
    archive.close()
    return SolveOutcome(job.session, "elsewhere" if state == "elsewhere" else "failed", why)


def _connect(address: str, patience_s: float) -> Client:
    deadline, left_s = time.monotonic() + patience_s, patience_s
    while True:
        try:
            asyncio.run(_shake_hands(address, min(left_s, CONNECT_S)))
            return Client(address, timeout=min(left_s, CONNECT_S), set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            left_s = deadline - time.monotonic() - RETRY_CONNECT_S
            if left_s <= 0 or isinstance(error, ValueError):
                raise RigError(
                    ErrorCode.ARCHIVE_NO_SCHEDULER, f"no Dask scheduler answers at {address}", address=address
                ) from error
            time.sleep(RETRY_CONNECT_S)


async def _shake_hands(address: str, timeout_s: float) -> None:
    """Tries to connect. Dask's own time-outs do not cover the handshake, in which another kind of server is silent."""
    async with asyncio.timeout(timeout_s):
        comm = await connect(address, timeout_s)
        await comm.close()


def _done(archive: Archive, solver: str, settings: str) -> set[str]:
    """Returns the sessions that are solved already."""
    query = sa.select(result.c.session).where(
        result.c.solver == solver, result.c.settings == settings, result.c.state == "done"
    )
    return set(archive.catalogue.repeatedly(lambda connection: connection.scalars(query).all()))


def report(archive: Archive, sessions: Sequence[str], solver: str, settings: str, call: str) -> SolveReport:
    """Makes the report of one call from the catalogue."""
    columns = ("session", "state", "call", "moved_mean_deg", "moved_over_sigma", "error")
    query = (
        sa.select(session.c.object, *(result.c[name] for name in columns))
        .join(session, session.c.key == result.c.session)
        .where(result.c.solver == solver, result.c.settings == settings)
    )
    wanted = set(sessions)
    rows = archive.catalogue.repeatedly(lambda connection: connection.execute(query).all())
    rows = [row for row in rows if row.session in wanted]
    mine = [row for row in rows if row.call == call and row.state == "done"]
    failures = {row.session: str(row.error) for row in rows if row.state == "failed"}
    moved = [
        Moved(row.session, row.object, row.moved_mean_deg, row.moved_over_sigma)
        for row in mine
        if row.moved_mean_deg is not None
    ]
    return SolveReport(
        solved=len(mine),
        kept=sum(row.state == "done" for row in rows) - len(mine),
        failed=len(failures),
        failures=failures,
        moved=tuple(sorted(moved, key=lambda item: -item.over_sigma)),
    )
