"""The facade of the runner: requests from any thread, and the one thread that moves the cell.

Requests of people change the session's state in the journal and set the stop token; device work is queued to the
runner's thread, where `loop.SessionLoop` runs the session. A halt does not wait for that queue, a lock or the journal:
it goes to the devices first and is journalled afterwards.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

from acquisition import session, session_state
from acquisition.devices import RecoveryStep, Rig, StopToken
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.cell_config import Tool
from acquisition.models.errors import NOT_WRITTEN, ErrorCode, RigError
from acquisition.models.problem_table import problem
from acquisition.runner import calibration_checks, new_session, preconditions
from acquisition.runner.closing import Closing
from acquisition.runner.compute import Compute, Preempted
from acquisition.runner.loop import SessionLoop
from acquisition.runner.operator_moves import OperatorMoves, RunnerAccess
from acquisition.runner.planning import PlanningService
from acquisition.runner.preview import Preview
from acquisition.runner.progress import ProgressEstimator, SessionProgress
from acquisition.runner.readiness import Readiness
from acquisition.runner.rig_choices import RigChoices
from acquisition.runner.safety_monitor import Latch, SafetyMonitor
from acquisition.runner.status import RigStatus
from acquisition.runner.step_executor import StepExecutor
from acquisition.runner.stop_record import StopRecord
from acquisition.session_state import Actor, State, Trigger
from acquisition.store import SessionRow, Store

_log = logging.getLogger(__name__)

READY_WITHIN_S = 20.0
"""Time limit, s, for device work that a request waits for: connecting takes 1 s, a refusal 3 s; the rest is margin."""

CONNECT_EVERY_S = 5.0
"""Period, s, of attempts to connect missing devices while no session moves the arm."""

CLOSING_POLL_S = 0.1
"""Period, s, at which a request that waits for devices checks whether the service is ending."""

T = TypeVar("T")

ANSWERED_BY_RESUMING = (ErrorCode.PLAN_TO_REVIEW, ErrorCode.CALIBRATION_PLACE_TARGET)
"""Reasons of a pause that a person answers by resuming: the plan is approved, or the target is in place."""


class Runner:
    """Runs one session at a time; every public method may be called from any thread."""

    def __init__(
        self, store: Store, rig: Rig, calibration: Calibration, compute: Compute, monitor: SafetyMonitor
    ) -> None:
        self._store, self._rig = store, rig
        self.choices = RigChoices(store, rig.cell, calibration, self._refuse_used, self._arm_name)
        self._compute, self._monitor = compute, monitor
        self._executor = StepExecutor(store, rig, self.choices, compute)
        self._readiness = Readiness(rig, self.choices)
        self.closing = Closing()
        self._estimator = ProgressEstimator(store, rig.cell)
        self._loop = SessionLoop(store, rig, self._executor, monitor, self.closing, self._estimator)
        self.planning = PlanningService(store, rig, self.choices, compute, self._executor, self.closing)
        self.preview = Preview(rig, self._refuse_held, self._in_thread)
        self._token = StopToken()
        self._running: str | None = None  # the session that the token belongs to
        self._taking_over = threading.Lock()  # a halt never takes it
        self._stops = StopRecord(store, monitor, self._loop)
        self.halts = 0  # number of halts so far: a decision made before a halt is void
        self._requests: queue.Queue[Callable[[], object]] = queue.Queue()
        self._next_connection = 0.0
        self.moves = OperatorMoves(store, rig, self.choices, compute, self._access())
        self._thread = threading.Thread(target=self._serve, name="runner", daemon=True)

    def open(self) -> None:
        """Interrupts a session that was active when the last service ended; starts the thread."""
        holder = self._store.journal.holder()
        if holder is not None and holder.state is not State.INTERRUPTED:
            reason = problem(ErrorCode.SERVICE_RESTARTED, f"The service ended while the session was {holder.state}")
            self._store.journal.trigger(holder.id, Trigger.INTERRUPT, Actor.SERVICE, reason)
        self._monitor.start()
        self._thread.start()

    def begin_shutdown(self) -> None:
        """Halts the cell and begins nothing more. The session will be interrupted, not stopped; `close` follows."""
        self.closing.set()
        self._token.set()
        self._rig.halt()

    def close(self) -> None:
        """Halts, ends the step in progress (its session stays interrupted) and releases the devices."""
        self.begin_shutdown()
        if self._thread.is_alive():
            self._thread.join(10)
        if not self._thread.is_alive():
            with suppress(RigError):  # the journal cannot be written: nothing more can be done
                self._stops.record_outstanding()
        self._monitor.close()
        self._rig.camera.close()
        self._rig.arm.close()
        self._compute.close()

    def create(self, recipe: AnyRecipe, idempotency_key: str | None = None) -> tuple[SessionRow, bool]:
        """Creates a session; nothing moves. The flag is False when the idempotency key names an existing session.

        Raises RigError as `new_session.create`.
        """
        return new_session.create(self._store, self._rig.cell, self.choices, recipe, idempotency_key)

    def state_tool(self, tool: Tool, actor: str) -> None:
        """Records the tool that a person states to be on the flange; the controller then gets its payload. Raises
        RigError config.invalid for a board that the cell file does not have, and rig.busy."""
        self.choices.state_tool(tool, actor)
        self._requests.put(self._readiness.send_payload)

    def set_region(self, session_id: str, mask: bytes, actor: str) -> int:
        """Stores a PNG mask as the session's region of interest; returns its number of pixels.

        Raises RigError request.invalid, session.action_not_allowed, session.not_found.
        """
        return self._executor.set_region(session_id, mask, actor)

    def act(
        self, session_id: str, action: Trigger, actor: str, *, from_here: bool = False,
        unless_halted_since: int | None = None,
    ) -> State:  # fmt: skip
        """Carries out a person's action and returns the state after it.

        With `from_here` a person states that the arm may resume from where it stands, although the session left it
        elsewhere. A start or resume is stopped again if somebody has halted the cell meanwhile: since the count
        `unless_halted_since` of `halts` for one that was decided earlier, else since this call.

        Raises RigError session.not_found, session.action_not_allowed, rig.busy, and for start and resume whatever
        stands in the way: arm.unreachable, arm.preflight, arm.elsewhere, camera.unreachable, safety.not_acknowledged,
        rig.changed, calibration.infeasible, store.disk_full.
        """
        match action:
            case Trigger.STOP:
                return self._stop(session_id, actor)
            case Trigger.START | Trigger.RESUME:
                halts = self.halts if unless_halted_since is None else unless_halted_since
                state = self._start(session_id, action, actor, from_here)
                return state if self.halts == halts else self._stop(session_id, actor)
            case _:
                return self._store.journal.trigger(session_id, action, actor)[1]

    def halt(self, actor: str) -> None:
        """Halts whatever moves, at once, and latches the halt until a person acknowledges it. The runner's thread then
        stops the session."""
        self.halts += 1  # before the token: a start in another thread sees this count, or its token is set below
        self._token.set()
        self._rig.halt()
        self._stops.add(actor, self._monitor.latch_stop(actor))
        self._requests.put(self._stops.record_outstanding)
        self._token.set()  # again: a start may have put another token in place meanwhile

    def require_clear(self) -> None:
        """Raises RigError with the code of a present fault, or safety.not_acknowledged while the latch is closed."""
        self._monitor.require_clear()

    def acknowledge(self, actor: str) -> None:
        """Opens the safety latch: `actor` has looked, and the cell is clear. Raises RigError safety.still_faulted."""
        self._stops.acknowledge(actor)

    def recover(self, step: RecoveryStep, actor: str) -> None:
        """Carries out one recovery step at the request of a person who has just acknowledged; never automatic.

        Raises RigError as `preconditions.require_recovery`, safety.recovery_refused, arm.unreachable.
        """
        preconditions.require_recovery(self._rig.cell, self._monitor, self._store.journal.holder(), actor)
        self._store.journal.record_action(None, f"recover: {step}", actor, "asked")
        self._in_thread(lambda: self._rig.arm.recover(step))

    def handle_fault(self, latch: Latch) -> None:
        """Halts and interrupts the session that holds the rig; called by the safety monitor when it latches a fault."""
        self._token.set()
        self._rig.halt()
        recorded = False
        try:
            recorded = self._stops.fault(latch)
        finally:
            self._requests.put(lambda: self._stops.interrupt(latch, recorded))

    def status(self) -> RigStatus:
        """Returns the status of the rig from cached readings, without asking a device."""
        holder = self._store.journal.holder()
        reasons = self._not_ready_reasons()
        if holder is not None:
            reasons.append(problem(ErrorCode.RIG_BUSY, f"Session {holder.id} is {holder.state}", holder=holder.id))
        cell = self._rig.cell
        return RigStatus(
            cell=cell.name,
            fingerprint=cell.fingerprint,
            arm_address=cell.arm.address,
            arm_model=cell.arm.model,
            identity=self._readiness.identity,
            reading=self._rig.arm.reading,
            camera_ready=self._readiness.camera_ready,
            holder=None if holder is None else holder.id,
            may_start=not reasons,
            reasons=reasons,
            calibration_made_at=self.choices.calibration.made_at,
            calibration_valid_until=self.choices.calibration.valid_until.isoformat(),
            calibration_check=calibration_checks.state(self._store, self.choices.calibration.fingerprint),
            latched=self._monitor.latch,
        )

    def progress(self, session_id: str) -> SessionProgress:
        """Returns stage and progress of a session, with the remaining time and what it is estimated from.

        Raises RigError session.not_found, store.corrupt when its plans cannot be read.
        """
        record = self._store.record(session_id)
        stage = self._loop.stages.get(session_id)
        if stage is None:
            home = self._rig.cell.arm.home
            stage = session.stage(record, session.next_step(record, home, home))
        return self._estimator.estimate(record, stage)

    def announced_progress(self, row: SessionRow) -> SessionProgress:
        """Returns stage and progress of a session as last announced, for a session whose files cannot be read."""
        return self._estimator.announced(row)

    @property
    def processor_s(self) -> dict[str, float]:
        """Processor time, s, of the compute process's jobs so far, by name of the job."""
        return self._compute.processor_s

    def render(self, job: str, *arguments: Any) -> bytes:
        """Renders a picture by a preemptible job. Raises RigError rig.busy when a session's job preempts it."""
        try:
            return self._compute.run(self.closing, job, *arguments, preemptible=True)
        except Preempted as error:
            raise RigError(ErrorCode.RIG_BUSY, "A session is using the compute process: ask again later") from error

    def _start(self, session_id: str, action: Trigger, actor: str, from_here: bool) -> State:
        journal = self._store.journal
        row = journal.session(session_id)
        target = session_state.next_state(row.state, action, Actor.OPERATOR)
        if target is None or target is row.state or row.state is State.PAUSING:
            before, state = journal.trigger(session_id, action, actor, expected=row.state)
            # A session that has come to rest meanwhile is resumed only after all checks below.
            return state if before is row.state else self._start(session_id, action, actor, from_here)
        self._refuse_held(by_other_than=session_id)
        self.moves.refuse_jogged()
        folder = self._store.folder(session_id)
        preconditions.require_same_rig(row, self._rig.cell, self.choices, folder)
        preconditions.require_stated(row.recipe, self._rig.cell, self.choices)
        preconditions.require_in_date(self.choices.calibration)
        preconditions.require_space_for_session(
            self._store, row.recipe if action is Trigger.START else None, self.choices.calibration
        )
        self._monitor.require_clear()
        self.preview.preempt()
        identity = self._in_thread(self._readiness.make_ready)
        self._monitor.require_clear()
        journal.session(session_id)  # one that was deleted while the devices connected must get no folder again
        preconditions.require_same_arm(folder, identity)
        if row.state is State.INTERRUPTED and not from_here:
            preconditions.require_near_path(journal.last_path(session_id), self._rig.arm.reading.joints)
        if row.state is State.PAUSED and row.reason is not None and row.reason["code"] in ANSWERED_BY_RESUMING:
            self.planning.approve(session_id, actor)
        token = StopToken()
        # Under both locks no move can replace the new session's token, and nobody can change its calibration and tool.
        with self.choices.changing, self._taking_over:
            preconditions.require_same_rig(row, self._rig.cell, self.choices, folder)
            before, target = journal.trigger(session_id, action, actor)
            if before is target:  # an equal request came first and runs the session
                return target
            self._running, self._token = session_id, token
        self._requests.put(lambda: self._loop.run(session_id, token))
        return target

    def _stop(self, session_id: str, actor: str) -> State:
        halted = self._running == session_id
        if halted:  # before asking the journal, which another program may hold
            self._token.set()
            self._rig.halt()
        try:
            _, state = self._store.journal.trigger(session_id, Trigger.STOP, actor)
        except RigError as error:
            if halted and error.code in NOT_WRITTEN:  # else the session, whose loop has ended, would count as running
                self._requests.put(lambda: self._stops.stop_session(session_id, actor))
            raise
        if state is State.STOPPING:
            # A resume may have put another token in place between the halt and the entry. And if the loop ended before
            # the entry, or never ran, nothing else would record that the arm is at rest.
            if self._running == session_id:  # else it has ended, and another one may run
                self._token.set()
                self._rig.halt()
            self._requests.put(lambda: self._loop.trigger(session_id, Trigger.AT_REST))
        return state

    def _serve(self) -> None:
        while not self.closing.is_set():
            try:
                if time.monotonic() >= self._next_connection:
                    self._connect_missing()
                with suppress(queue.Empty):
                    self._requests.get(timeout=0.25)()
            except Exception:  # noqa: BLE001 - the thread must live on, also where a full disk refuses an entry
                _log.exception("a task of the runner's thread failed")

    def _connect_missing(self) -> None:
        """Connects what is missing while no session holds the rig.

        For a session that a restart found interrupted the arm is only read, until all devices have been connected once:
        what is lost later is connected again by an explicit resume (decision 2).
        """
        holder = self._store.journal.holder()
        if holder is not None and (holder.state is not State.INTERRUPTED or self._readiness.was_complete):
            return
        try:
            if self._readiness.reconnect_missing(take_control=holder is None):
                self._store.journal.announce(None, "device.changed", {"arm": "connected", "camera": "connected"})
        finally:
            self._next_connection = time.monotonic() + CONNECT_EVERY_S

    def _access(self) -> RunnerAccess:
        def take_over(token: StopToken) -> None:
            with self._taking_over:
                self._refuse_held()
                self._token, self._running = token, None

        def make_ready() -> None:
            self.preview.preempt()
            self._in_thread(self._readiness.make_ready)

        return RunnerAccess(
            refuse_held=self._refuse_held,
            require_clear=self._monitor.require_clear,
            make_ready=make_ready,
            is_ready=lambda: self._readiness.is_ready,
            halts=lambda: self.halts,
            take_over=take_over,
            is_current=lambda token: self._token is token,
            put=self._requests.put,
            closing=self.closing,
        )

    def _in_thread(self, work: Callable[[], T]) -> T:
        """Runs device work in the runner's thread and returns what it returns."""
        future: Future[T] = Future()

        def request() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(work())
            except Exception as error:  # noqa: BLE001 - raised again where the caller waits
                future.set_exception(error)

        self._requests.put(request)
        deadline = time.monotonic() + READY_WITHIN_S
        while not self.closing.is_set() and time.monotonic() < deadline:
            if futures.wait([future], CLOSING_POLL_S).done:
                return future.result()
        future.cancel()
        why = (
            "The service is ending" if self.closing.is_set() else f"The rig did not answer within {READY_WITHIN_S:g} s"
        )
        raise RigError(ErrorCode.RIG_NOT_READY, why)

    def _refuse_held(self, by_other_than: str | None = None) -> None:
        holder = self._store.journal.holder()
        if holder is not None and holder.id != by_other_than:
            raise RigError(ErrorCode.RIG_BUSY, f"Session {holder.id} holds the rig", holder=holder.id)

    def _refuse_used(self) -> None:
        self._refuse_held()
        self.moves.refuse_jogged()

    def _arm_name(self) -> str | None:
        identity = self._readiness.identity
        return None if identity is None else f"{identity.model} {identity.serial}"

    def _not_ready_reasons(self) -> list[dict[str, Any]]:
        reasons = list(self._readiness.problems)
        for require in (
            self._monitor.require_clear,
            lambda: preconditions.require_power(self._rig.arm.reading),
            lambda: preconditions.require_in_date(self.choices.calibration),
        ):
            try:
                require()
            except RigError as error:
                reason = problem(error.code, error.detail, **error.context)
                if reason not in reasons:  # a start that was refused for it has left the same one
                    reasons.append(reason)
        return reasons
