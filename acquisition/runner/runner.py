"""The loop that runs sessions: look, gate, do, write; it owns the one thread that moves the cell.

Each turn reads the next step from the journal and from where the arm stands, does it, and enters what came of it. There
is no other memory of a session, so a pause, a crash and a resume are only turns that did not come. People's requests
come from other threads: they change the state in the journal and set the stop token; the halt itself goes straight to
the devices, before any lock or journal.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, TypeVar

from acquisition import session
from acquisition.capture import take
from acquisition.devices import RecoveryStep, Rig, StopToken
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, Halted, RigError, problem
from acquisition.models.recipe import Recipe
from acquisition.models.route import JointPath
from acquisition.runner import preconditions
from acquisition.runner.compute import Compute, GaveWay
from acquisition.runner.loop import Turns
from acquisition.runner.planning import Proposals
from acquisition.runner.preview import Looking
from acquisition.runner.readiness import Readiness
from acquisition.runner.safety_monitor import Latch, SafetyMonitor
from acquisition.runner.status import RigStatus, SessionProgress
from acquisition.runner.step_executor import Steps
from acquisition.session import Actor, Stage, State, Trigger
from acquisition.store import SessionRow, Store

_log = logging.getLogger(__name__)

READY_WITHIN_S = 20.0
"""Connecting takes a second; an address where nobody listens answers within 3 s; the rest is a busy machine."""
CONNECT_EVERY_S = 5.0
CLOSING_SEEN_S = 0.1
"""Whoever waits for devices notices within this that the service ends."""

RECOVERY_WITHIN_S = 60.0
"""So long after an operator has said that the cell is clear the same operator may recover the arm from here."""

T = TypeVar("T")


class Runner:
    """Runs one session at a time; every public method may be called from any thread."""

    def __init__(
        self, store: Store, rig: Rig, calibration: Calibration, compute: Compute, monitor: SafetyMonitor
    ) -> None:
        self._store = store
        self._rig = rig
        self._calibration = calibration
        self._compute = compute
        self._monitor = monitor
        self._steps = Steps(store, rig, calibration, compute)
        self._readiness = Readiness(rig)
        self._closing = threading.Event()
        self._turns = Turns(store, rig, self._steps, monitor, self._closing)
        self.proposals = Proposals(store, rig, calibration, compute, self._steps, self._closing)
        self.looking = Looking(rig, self._refuse_held, self._in_thread)
        self._token = StopToken()
        self._requests: queue.Queue[Callable[[], None]] = queue.Queue()
        self._thread = threading.Thread(target=self._serve, name="runner", daemon=True)

    # --------------------------------------------------------------------------------------------------------- lifetime

    def open(self) -> None:
        """Declares sessions found active interrupted, and starts the thread, which connects the devices."""
        holder = self._store.journal.holder()
        if holder is not None and holder.state is not State.INTERRUPTED:
            reason = problem(ErrorCode.SERVICE_RESTARTED, f"The service ended while the session was {holder.state}")
            self._store.journal.trigger(holder.id, Trigger.INTERRUPT, Actor.SERVICE, reason)
        self._monitor.start()
        self._thread.start()

    def shut(self) -> None:
        """Halts and begins nothing more: the session will be interrupted, not stopped; `close` follows."""
        self._closing.set()
        self._token.set()
        self._rig.halt()

    def close(self) -> None:
        """Halts, ends the session's turn (it stays interrupted) and releases the devices."""
        self.shut()
        if self._thread.is_alive():
            self._thread.join(10)
        self._monitor.close()
        self._rig.camera.close()
        self._rig.arm.close()
        self._compute.close()

    # --------------------------------------------------------------------------------------------------------- requests

    def create(self, recipe: Recipe, idempotency_key: str | None = None) -> tuple[SessionRow, bool]:
        """Enters a session; nothing moves. The flag is False when the key named one that exists."""
        cell = self._rig.cell
        row, new = self._store.journal.create_session(recipe, cell.model_dump_json(), cell.fingerprint, idempotency_key)
        if new:
            self._steps.begin(row.id, recipe)
        return row, new

    def draw_region(self, session_id: str, mask: bytes, actor: str) -> int:
        """Keeps a PNG as the session's region of interest; returns its pixels.

        Raises RigError request.invalid, session.action_not_allowed, session.not_found.
        """
        return self._steps.draw(session_id, mask, actor)

    def act(self, session_id: str, action: Trigger, actor: str, *, from_here: bool = False) -> State:
        """A person's action; returns the state after it. With `from_here` a person says that the arm may resume from
        where it stands, although it is not where the session left it.

        Raises RigError session.not_found, session.action_not_allowed, rig.busy, and for start and resume whatever
        stands in the way: arm.unreachable, arm.preflight, arm.elsewhere, camera.unreachable, safety.not_acknowledged,
        rig.changed, store.disk_full.
        """
        match action:
            case Trigger.STOP:
                return self._stop(session_id, actor)
            case Trigger.START | Trigger.RESUME:
                return self._start(session_id, action, actor, from_here)
            case _:
                return self._store.journal.trigger(session_id, action, actor)[1]

    def halt(self, actor: str) -> None:
        """Halts whatever moves, at once; the session is stopped afterwards, in the runner's thread."""
        self._token.set()
        self._rig.halt()
        self._requests.put(lambda: self._journal_halt(actor))
        self._token.set()  # a start may have been entered since: its token is another one

    def acknowledge(self, actor: str) -> None:
        """A person has looked and finds the cell clear. Raises RigError safety.still_faulted."""
        self._monitor.acknowledge(actor)
        self._store.journal.acknowledge(actor)

    def recover(self, step: RecoveryStep, actor: str) -> None:
        """One step out of a stop, because a person who has just looked asks for it; never done by itself.

        Raises RigError safety.recovery_forbidden unless the cell file allows it, safety.not_acknowledged unless the
        same actor has said within RECOVERY_WITHIN_S that the cell is clear, safety.recovery_refused, arm.unreachable.
        """
        if not self._rig.cell.arm.remote_recovery:
            raise RigError(ErrorCode.SAFETY_RECOVERY_FORBIDDEN, "The cell file does not allow recovery over HTTP")
        if not self._monitor.was_told_clear(actor, RECOVERY_WITHIN_S):
            raise RigError(
                ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
                f"{actor} has not said within the last {RECOVERY_WITHIN_S:.0f} s that the cell is clear",
            )
        holder = self._store.journal.holder()
        if holder is not None and holder.state not in (State.PAUSED, State.INTERRUPTED):
            raise RigError(ErrorCode.SAFETY_RECOVERY_REFUSED, f"Session {holder.id} is {holder.state}: stop it first")
        self._store.journal.record_action(None, f"recover: {step}", actor, "asked")
        self._in_thread(lambda: self._rig.arm.recover(step))

    def park(self, actor: str) -> None:
        """Begins to bring the arm home, on a certified way from wherever it stands; the event `rig.parked` tells how it
        ended.

        Raises RigError rig.busy while a session holds the rig, waypoints.collision when no such way is known (somebody
        must move the arm by hand), safety.not_acknowledged, and what devices report.
        """
        self._refuse_held()
        self._monitor.clear()
        self.looking.give_way()
        self._in_thread(self._readiness.make_ready)
        self._monitor.clear()
        here = self._rig.arm.reading.joints
        way: JointPath = self._compute.run(self._closing, "plan_retreat", here, self._rig.cell, self._calibration)
        token = StopToken()
        self._token = token
        self._requests.put(lambda: self._parked(here, way, token, actor))

    def latched(self, latch: Latch) -> None:
        """A fault has appeared: halts, and interrupts the session that holds the rig; the monitor calls it."""
        self._token.set()
        self._rig.halt()
        self._store.journal.latch(latch.code, latch.detail)
        holder = self._store.journal.holder()
        if holder is not None and holder.state is not State.INTERRUPTED:
            reason = problem(latch.code, latch.detail)
            self._turns.trigger(holder.id, Trigger.INTERRUPT, Actor.SERVICE, reason)

    def status(self) -> RigStatus:
        """The rig at a glance; asks no device."""
        holder = self._store.journal.holder()
        reasons = self._obstacles()
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
            calibration_made_at=self._calibration.made_at,
            calibration_valid_until=self._valid_until().isoformat(),
            latched=self._monitor.latch,
        )

    def progress(self, session_id: str) -> SessionProgress:
        """How far a session is, and how long it will still take at the pace so far."""
        row = self._store.journal.session(session_id)
        record = self._store.record(session_id)
        stage = self._turns.stages.get(session_id)
        if stage is None:
            home = self._rig.cell.arm.home
            stage = session.stage(record, session.next_step(record, home, home))
        if row.state is State.COMPLETED:
            stage = Stage.FINISHED
        done = session.progress(record)
        left = None
        if row.state is State.RUNNING and row.started_at is not None and done > 0.05:
            left = (time.time() - row.started_at) * (1 - done) / done
        return SessionProgress(stage, done, left)

    @property
    def reach_file(self) -> Path:
        """Where the cell's reach is kept."""
        return self._steps.reach_cache

    def reach(self) -> str:
        """The cell's reach as JSON. Raises RigError rig.busy while a session uses the compute process."""
        if self._store.journal.holder() is not None and not self._steps.reach_cache.exists():
            raise RigError(ErrorCode.RIG_BUSY, "The reach is made once, when no session runs: ask again later")
        if not self._steps.reach_cache.exists():
            self._compute.run(self._closing, "make_reach", self._rig.cell, self._calibration, self._steps.reach_cache)
        return self._steps.reach_cache.read_text(encoding="utf-8")

    def draw(self, job: str, *arguments: Any) -> bytes:
        """A picture by a job of the compute process. Raises RigError rig.busy when a session needs that process now."""
        try:
            return self._compute.run(self._closing, job, *arguments, yields=True)
        except GaveWay as error:
            raise RigError(ErrorCode.RIG_BUSY, "A session computes at the moment: ask again later") from error

    # ------------------------------------------------------------------------------------------------ start, stop, halt

    def _start(self, session_id: str, action: Trigger, actor: str, from_here: bool) -> State:
        journal = self._store.journal
        row = journal.session(session_id)
        then = session.after(row.state, action, Actor.OPERATOR)
        if then is None or then is row.state or row.state is State.PAUSING:
            return journal.trigger(session_id, action, actor)[1]
        holder = journal.holder()
        if holder is not None and holder.id != session_id:
            raise RigError(ErrorCode.RIG_BUSY, f"Session {holder.id} holds the rig", holder=holder.id)
        folder = self._store.folder(session_id)
        preconditions.same_rig(row, self._rig.cell, self._calibration, folder)
        if datetime.now().astimezone() > self._valid_until():
            raise RigError(ErrorCode.RIG_NOT_READY, f"The calibration is out of date since {self._valid_until()}")
        preconditions.enough_space(self._store, row.recipe if action is Trigger.START else None, self._calibration)
        self._monitor.clear()
        self.looking.give_way()
        identity = self._in_thread(self._readiness.make_ready)
        self._monitor.clear()
        preconditions.same_arm(folder, identity)
        if row.state is State.INTERRUPTED and not from_here:
            preconditions.near_last_way(journal.last_way(session_id), self._rig.arm.reading.joints)
        if row.state is State.PAUSED and row.reason is not None and row.reason["code"] == ErrorCode.PLAN_TO_REVIEW:
            self.proposals.approve(session_id, actor)
        before, then = journal.trigger(session_id, action, actor)
        if before is then:  # the same start came twice: the other one runs it
            return then
        token = StopToken()
        self._token = token
        self._requests.put(lambda: self._turns.run(session_id, token))
        return then

    def _stop(self, session_id: str, actor: str) -> State:
        journal = self._store.journal
        holder = journal.holder()
        if holder is not None and holder.id == session_id:
            self._token.set()
            self._rig.halt()
        _, then = journal.trigger(session_id, Trigger.STOP, actor)
        if then is State.STOPPING:
            # A resume may have begun between the halt and the entry: its token is another one. And the turn may have
            # ended before the entry, or none was running, so that nobody else would settle.
            self._token.set()
            self._rig.halt()
            self._requests.put(lambda: self._settled(session_id))
        return then

    def _parked(self, here: tuple[float, ...], way: JointPath, token: StopToken, actor: str) -> None:
        """Follows the way home in the runner's thread, unless something else has begun since it was planned."""
        outcome = "another request came first"
        journal = self._store.journal
        if self._token is token and journal.holder() is None:
            try:
                if not session.same_place(self._rig.arm.reading.joints, here):
                    raise RigError(ErrorCode.ARM_MOVE_FAILED, "The arm has been moved since the way was planned")
                take.arrive(self._rig, way.path, way.speeds, token)
                outcome = "at home"
            except Halted:
                outcome = "halted"
            except RigError as error:
                self._rig.halt()
                outcome = f"halted: {error}" if token.is_set() else str(error)
        journal.record_action(None, "park", actor, outcome)
        journal.announce(None, "rig.parked", {"outcome": outcome})

    def _settled(self, session_id: str) -> None:
        self._turns.trigger(session_id, Trigger.SETTLE)

    def _journal_halt(self, actor: str) -> None:
        holder = self._store.journal.holder()
        if holder is None:
            self._store.journal.record_action(None, "halt", actor, "halted")
            return
        self._store.journal.record_action(holder.id, "halt", actor, "halted")
        self._turns.trigger(holder.id, Trigger.STOP, actor)
        self._turns.trigger(holder.id, Trigger.SETTLE)

    # ---------------------------------------------------------------------------------------------- the runner's thread

    def _serve(self) -> None:
        next_connection = 0.0
        while not self._closing.is_set():
            if time.monotonic() >= next_connection and self._store.journal.holder() is None:
                if self._readiness.look():
                    self._store.journal.announce(None, "device.changed", {"arm": "connected", "camera": "connected"})
                next_connection = time.monotonic() + CONNECT_EVERY_S
            try:
                request = self._requests.get(timeout=0.25)
            except queue.Empty:
                continue
            request()

    # ---------------------------------------------------------------------------------------------------------- devices

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
        while not self._closing.is_set() and time.monotonic() < deadline:
            if futures.wait([future], CLOSING_SEEN_S).done:
                return future.result()
        future.cancel()
        why = "The service is ending" if self._closing.is_set() else f"Not ready within {READY_WITHIN_S:g} s"
        raise RigError(ErrorCode.RIG_NOT_READY, why)

    def _refuse_held(self) -> None:
        holder = self._store.journal.holder()
        if holder is not None:
            raise RigError(ErrorCode.RIG_BUSY, f"Session {holder.id} holds the rig", holder=holder.id)

    def _obstacles(self) -> list[dict[str, Any]]:
        found = list(self._readiness.troubles)
        try:
            self._monitor.clear()
        except RigError as error:
            found.append(problem(error.code, error.detail, **error.context))
        if datetime.now().astimezone() > self._valid_until():
            found.append(problem(ErrorCode.RIG_NOT_READY, "The calibration is out of date: calibrate again"))
        return found

    def _valid_until(self) -> datetime:
        return datetime.fromisoformat(self._calibration.made_at) + timedelta(days=self._calibration.valid_days)
