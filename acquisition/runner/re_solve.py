"""Repetition of a session's solve with other settings on request, and exports of results made on demand.

A re-solve uses no device and has lower priority than a session: it starts only while no session runs, in the one
compute process; the next step of a session preempts it, and it is restarted later. A request is an event of the journal
and pending until an event of success or failure follows, so a restarted service resumes it. A request with the
idempotency key of an earlier one, or with equal settings, images and software, leads to the same result: a client that
repeats itself makes no second job. A cancelled solve is killed with its process, which frees its memory at once.
"""

import logging
import queue
import shutil
import threading
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from structlog.contextvars import bound_contextvars

from acquisition import session_state
from acquisition.models.calibration_recipe import require_capture
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import NOT_WRITTEN, ErrorCode, Halted, RigError
from acquisition.models.problem_table import problem
from acquisition.models.result import SolveSettings
from acquisition.runner import solve_calibration, solve_requests
from acquisition.runner.compute import Compute, Preempted
from acquisition.runner.results import observations, solve_and_record
from acquisition.runner.solve_requests import ACCEPTED, FAILED, SolveRequest
from acquisition.session_state import ENDED, State
from acquisition.store import Store

_log = logging.getLogger(__name__)

EXPORTS = (
    "normals_directx.png", "maps.exr", "albedo.exr", "albedo.png", "mesh.ply", "lights.lp", "lights.dome",
    "diligent.zip", "integration.zip",
)  # fmt: skip
"""Files that are made from a result on the first request, and cached."""

POLL_S = 0.5
"""Period, s, of checking whether a session runs and whether the service is ending."""

ENDED_WITHIN_S = 10.0
"""Time, s, for which a session's deletion waits for its solve to end; the thread removes what it writes later."""


class ReSolveService:
    """Repeats solves of ended sessions, one at a time, in a thread of its own; any thread may submit."""

    def __init__(self, store: Store, compute: Compute) -> None:
        self._store = store
        self._compute = compute
        self._queue: queue.Queue[SolveRequest] = queue.Queue()
        self._numbering = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="resolving", daemon=True)
        self._running: SolveRequest | None = None
        self._ended = threading.Event()  # set when the running solve writes nothing more
        self._halting = threading.Event()  # ends the running solve: the service closes, or it was cancelled

    def open(self) -> None:
        """Queues the requests that the last service left unfinished, and starts the thread."""
        for request in solve_requests.submitted(self._store.journal, None):
            self._queue.put(request)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; an unfinished solve is restarted by the next service."""
        self._closing.set()
        self._halting.set()
        if self._thread.is_alive():
            self._thread.join(10)

    def submit(
        self, session_id: str, settings: SolveSettings, last_pass: int | None, actor: str,
        idempotency_key: str | None = None, calibration: str | None = None,
    ) -> tuple[SolveRequest, bool]:  # fmt: skip
        """Accepts a solve of an ended session, with images up to `last_pass` (None: all) and the set `calibration`
        (None: the calibration of the capture).

        The flag is False for a repeated request: one with an earlier key, or with equal settings, images and software,
        unless that solve failed or was cancelled.

        Raises RigError session.not_found, session.action_not_allowed while the session may still take images,
        normals.infeasible with fewer than three of them, calibration.not_found, calibration.does_not_fit.
        """
        with self._numbering:
            row = self._store.journal.session(session_id)
            if row.state not in ENDED:
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"A session that is {row.state} may still take images: solve it again when it has ended",
                    state=row.state,
                    allowed=[str(action) for action in session_state.allowed_actions(row.state)],
                )
            if calibration is not None:
                solve_calibration.require_fits(self._store, session_id, calibration)
            record = self._store.record(session_id)
            require_capture(record.recipe)
            captured_passes = [number for number, work in enumerate(record.passes) if work.shots]
            last = max(captured_passes, default=0) if last_pass is None else last_pass
            shots = observations(record, self._store.folder(session_id), last).shots
            if len(shots) < 3 or last not in captured_passes:
                raise RigError(
                    ErrorCode.NORMALS_INFEASIBLE,
                    f"Session {session_id} has {len(shots)} images up to pass {last}: at least three are needed"
                    if len(shots) < 3
                    else f"Session {session_id} has no images of pass {last}",
                    passes=captured_passes,
                )
            wanted = SolveRequest(session_id, 0, settings, last, idempotency_key, version("lightpose"), calibration)
            asked = solve_requests.submitted(self._store.journal, session_id, with_finished=True)
            known = self._known(wanted, asked)
            if known is not None:
                return known, False
            used = [item.number for item in self._store.journal.artifacts(session_id, "result")]
            used += [request.number for request in asked]
            request = replace(wanted, number=max([*used, len(record.passes) - 1]) + 1)
            body = {
                "number": request.number,
                "last_pass": last,
                "settings": settings.model_dump(mode="json"),
                "by": actor,
                "idempotency_key": idempotency_key,
                "software": request.software,
                "calibration": calibration,
            }
            self._store.journal.record_action(session_id, "solve", actor, f"result {request.number}")
            self._store.journal.announce(session_id, ACCEPTED, body)
        self._queue.put(request)
        return request, True

    def cancel(self, session_id: str, number: int, actor: str) -> None:
        """Cancels a solve that waits or runs; the event `resolve.failed` with the code result.cancelled announces it.

        Cancelling it again is no error. Raises RigError session.not_found, request.not_found for no such request,
        session.action_not_allowed when it has ended otherwise.
        """
        with self._numbering:
            journal = self._store.journal
            journal.session(session_id)
            asked = solve_requests.submitted(journal, session_id, with_finished=True)
            if number not in [request.number for request in asked]:
                raise RigError(
                    ErrorCode.REQUEST_NOT_FOUND, f"There is no request for result {number} of session {session_id}"
                )
            pending = {request.number: request for request in solve_requests.submitted(journal, session_id)}
            if number not in pending:
                failure = solve_requests.failures(journal, session_id).get(number, {})
                if failure.get("code") == ErrorCode.RESULT_CANCELLED:
                    return
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED, f"The solve of result {number} has ended", allowed=[]
                )
            request = pending[number]
            journal.record_action(session_id, "cancel-solve", actor, f"result {number}")
            if self._running is not None and self._running.key == request.key:
                self._halting.set()  # its thread announces it, once the process has ended
            else:
                self._fail(request, _cancelled(number))

    def end_of(self, session_id: str) -> None:
        """Ends the solve of a session that was deleted, and waits until it writes nothing more."""
        with self._numbering:
            if self._running is None or self._running.session_id != session_id:
                return
            self._halting.set()
            ended = self._ended
        ended.wait(ENDED_WITHIN_S)

    def raise_outcome(self, session_id: str, number: int) -> None:
        """Raises result.not_ready for a pending result, or the problem of a failed one; else returns."""
        journal = self._store.journal
        asked = solve_requests.submitted(journal, session_id, with_finished=True)
        if number not in [request.number for request in asked]:
            return
        reason = solve_requests.failures(journal, session_id).get(number)
        if reason is not None:
            raise RigError(ErrorCode(reason["code"]), reason["detail"])
        raise RigError(ErrorCode.RESULT_NOT_READY, f"Result {number} of session {session_id} is being solved")

    def make_export(self, session_id: str, number: int, name: str) -> Path:
        """Returns the file of one of `EXPORTS`, made if missing.

        Raises RigError rig.busy while a session runs, session.not_found if this one is deleted meanwhile.
        """
        folder = self._store.folder(session_id)
        file = folder / "results" / str(number) / "exports" / name
        if file.exists():
            return file
        artifacts = [item for item in self._store.journal.artifacts(session_id, "result") if item.number == number]
        last = artifacts[-1].body.get("passes", [number])[-1]
        images = observations(self._store.record(session_id), folder, last)
        identity = artifacts[-1].body.get("calibration")
        calibration = solve_calibration.values(self._store, session_id, identity)
        if identity is not None:
            cell = CellConfig.model_validate_json(self._store.journal.session(session_id).cell)
            images = solve_calibration.lit_by(images, cell, calibration)
        busy = RigError(ErrorCode.RIG_BUSY, f"{name} cannot be made while a session runs: ask again later")
        if self._session_runs():
            raise busy
        try:
            self._compute.run(
                self._closing, "make_export", images, calibration, file.parents[1], name, preemptible=True
            )
        except (Preempted, Halted) as error:
            raise busy from error
        finally:
            self._remove_if_deleted(session_id)
            self._store.journal.session(session_id)  # of a deleted session the job's own error means nothing
        return file

    def _known(self, wanted: SolveRequest, asked: list[SolveRequest]) -> SolveRequest | None:
        """Returns the earlier request of the session that leads to the same result, or None."""
        failed = solve_requests.failures(self._store.journal, wanted.session_id)
        for request in asked:
            if wanted.idempotency_key is not None and request.idempotency_key == wanted.idempotency_key:
                return request
            alike = replace(request, number=0, idempotency_key=wanted.idempotency_key) == wanted
            if alike and request.number not in failed:
                return request
        return None

    def _serve(self) -> None:
        while not self._closing.is_set():
            try:
                request = self._queue.get(timeout=POLL_S)
            except queue.Empty:
                continue
            try:
                if self._begin(request):
                    self._carry_out(request)
            except RigError:  # the journal cannot be read at present
                _log.exception("solving session %s again cannot begin yet", request.session_id)
                self._closing.wait(POLL_S)
                self._queue.put(request)

    def _carry_out(self, request: SolveRequest) -> None:
        """Carries out a request and announces its outcome, except when the service ends."""
        try:
            with bound_contextvars(session_id=request.session_id):
                self._solve(request)
        except Halted:
            if not self._closing.is_set():
                results = self._store.session_path(request.session_id) / "results"
                shutil.rmtree(results / str(request.number), ignore_errors=True)
                self._end(request, _cancelled(request.number))
        except RigError as error:
            self._end(request, error)
        except Exception as error:  # noqa: BLE001 - the thread must live on; the event says what failed
            _log.exception("solving session %s again failed", request.session_id)
            self._end(request, RigError(ErrorCode.SERVICE_FAULT, repr(error)))
        finally:
            self._finish(request)

    def _end(self, request: SolveRequest, error: RigError) -> None:
        """Announces a failure; waits while the journal cannot be written, else the request would stay pending."""
        while True:
            try:
                self._fail(request, error)
            except RigError as refused:
                if refused.code in NOT_WRITTEN and not self._closing.wait(POLL_S):
                    continue
                _log.exception("the failed solve of session %s could not be recorded", request.session_id)
            return

    def _begin(self, request: SolveRequest) -> bool:
        """Notes that a solve runs from now on; returns False if it was cancelled while it waited."""
        with self._numbering:
            pending = solve_requests.submitted(self._store.journal, request.session_id)
            waits = request.number in [item.number for item in pending]
            if waits:
                self._running, self._ended = request, threading.Event()
            if not self._closing.is_set():
                self._halting.clear()
            return waits

    def _finish(self, request: SolveRequest) -> None:
        with self._numbering:
            self._running = None
        self._remove_if_deleted(request.session_id)
        self._ended.set()

    def _remove_if_deleted(self, session_id: str) -> None:
        """Removes what was written for a session after its deletion by the service or by `prune` beside it."""
        if self._is_deleted(session_id):
            shutil.rmtree(self._store.session_path(session_id), ignore_errors=True)

    def _is_deleted(self, session_id: str) -> bool:
        try:
            self._store.journal.session(session_id)
        except RigError as error:
            return error.code is ErrorCode.SESSION_NOT_FOUND
        return False

    def _solve(self, request: SolveRequest) -> None:
        record = self._store.record(request.session_id)
        cell = CellConfig.model_validate_json(self._store.journal.session(request.session_id).cell)
        calibration = solve_calibration.values(self._store, request.session_id, request.calibration)
        while True:
            while self._session_runs():
                if self._halting.wait(POLL_S):
                    raise Halted
            try:
                solve_and_record(
                    self._store, self._compute, record, request, cell, calibration, self._halting, origin="resolve"
                )
            except Preempted:
                continue
            return

    def _fail(self, request: SolveRequest, error: RigError) -> None:
        _log.error("solving session %s again: %s", request.session_id, error)
        if self._is_deleted(request.session_id):
            return
        reason = problem(error.code, error.detail)
        self._store.journal.announce(request.session_id, FAILED, {"number": request.number, "problem": reason})

    def _session_runs(self) -> bool:
        holder = self._store.journal.holder()
        return holder is not None and holder.state in (State.RUNNING, State.PAUSING, State.STOPPING)


def _cancelled(number: int) -> RigError:
    return RigError(ErrorCode.RESULT_CANCELLED, f"The solve of result {number} was cancelled")
