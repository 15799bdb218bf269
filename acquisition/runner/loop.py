"""The session loop: check that the session may go on, derive the next step, execute it; until the session rests.

Each iteration derives the step from the journal and the measured joints. There is no other memory of a session, so a
pause, a crash and a resume need no code of their own. The loop decides what a failure means: a problem of the work
pauses the session, one of the devices interrupts it, any other one fails it. When a person's action comes first, the
transition table refuses the loop's own trigger, which is then dropped.
"""

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from structlog.contextvars import bound_contextvars

from acquisition import session, session_state
from acquisition.devices import Rig, StopToken
from acquisition.models.errors import NOT_WRITTEN, ErrorCode, Halted, RigError
from acquisition.models.problem_table import problem
from acquisition.runner.progress import ProgressEstimator
from acquisition.runner.safety_monitor import SafetyMonitor
from acquisition.runner.step_executor import StepExecutor
from acquisition.session import SessionRecord, Stage
from acquisition.session_state import Actor, State, Trigger
from acquisition.store import Store
from acquisition.store.folder import refusals

_log = logging.getLogger(__name__)

INTERRUPTING_CODES = frozenset(
    {
        ErrorCode.ARM_PROTECTIVE_STOP,
        ErrorCode.ARM_EMERGENCY_STOP,
        ErrorCode.SAFETY_SOFTWARE_STOP,
        ErrorCode.ARM_NOT_READY,
        ErrorCode.ARM_MOVE_FAILED,
        ErrorCode.ARM_UNREACHABLE,
        ErrorCode.ARM_IN_USE,
        ErrorCode.DEVICE_DISCONNECTED,
        ErrorCode.DRIVER_LOST,
        ErrorCode.LAMP_NOT_CONFIRMED,
        ErrorCode.CAMERA_UNREACHABLE,
        ErrorCode.CAMERA_TIMEOUT,
    }
)
"""Problems of arm, lamp and camera: the session is interrupted, and nothing moves before a person resumes it."""

PAUSING_CODES = frozenset(
    {
        ErrorCode.CAPTURE_FRAME_REJECTED,
        ErrorCode.SCENE_MOVED,
        ErrorCode.STORE_DISK_FULL,
        ErrorCode.STORE_UNWRITABLE,
        ErrorCode.COMPUTE_LOST,
        ErrorCode.PLAN_TO_REVIEW,
        ErrorCode.CALIBRATION_PLACE_TARGET,
        ErrorCode.CALIBRATION_TARGET_NOT_SEEN,
        ErrorCode.CALIBRATION_BOARD_WRONG,
        ErrorCode.CALIBRATION_INFEASIBLE,
    }
)
"""Problems of the work while the rig is well: the session pauses for a person. A code in neither set fails it."""

AT_REST_RAD_S = 0.01
"""Joint speed, rad/s, below which every joint counts as at rest."""
AT_REST_WITHIN_S = 2.0
"""Time limit, s, for a reading to show the arm at rest after a step; if none does, the session is interrupted."""
REST_POLL_S = 0.02
"""Period, s, of reading the joint speeds meanwhile."""
JOURNAL_RETRY_S = 1.0
"""Period, s, of attempts to write a state while the journal cannot be written."""


class SessionLoop:
    """Runs sessions in the runner's thread; `trigger` may be called from any thread."""

    def __init__(
        self,
        store: Store,
        rig: Rig,
        executor: StepExecutor,
        monitor: SafetyMonitor,
        closing: threading.Event,
        estimator: ProgressEstimator,
    ) -> None:
        self._store, self._rig, self._executor, self._monitor = store, rig, executor, monitor
        self._closing, self._estimator = closing, estimator
        self._progress: tuple[str, float] | None = None
        self.stages: dict[str, Stage] = {}

    def run(self, session_id: str, token: StopToken) -> None:
        """Runs steps of one session until it ends, pauses or is interrupted."""
        self.stages = {known: stage for known, stage in self.stages.items() if known == session_id}
        with bound_contextvars(session_id=session_id):  # log records made meanwhile name the session
            while self._run_step(session_id, token):
                pass

    def trigger(
        self, session_id: str, trigger: Trigger, actor: str = Actor.RUNNER, reason: dict[str, Any] | None = None
    ) -> bool:
        """Fires one of the service's own triggers; False when a person's action came first and forbids it.

        Waits while the journal cannot be written: the state must not be lost, and nothing moves meanwhile.
        """
        try:
            self.until_written(lambda: self._store.journal.trigger(session_id, trigger, actor, reason))
        except RigError as error:
            if error.code is not ErrorCode.SESSION_ACTION_NOT_ALLOWED:
                raise
            _log.info("session %s: %s is ignored, because a person's action came first", session_id, trigger)
            return False
        return True

    def until_written(self, entry: Callable[[], object]) -> None:
        """Makes an entry into the journal, and repeats it while the journal cannot be written. Raises the entry's
        RigError if it has another cause, or if the service ends meanwhile."""
        while True:
            try:
                entry()
            except RigError as error:
                if error.code in NOT_WRITTEN and not self._closing.wait(JOURNAL_RETRY_S):
                    continue
                raise
            return

    def _run_step(self, session_id: str, token: StopToken) -> bool:
        """Runs one step and maps its failure to a state; False when there is no more to do."""
        try:
            with refusals(self._store.data):
                return self._next_step(session_id, token)
        except Halted:
            self._enter_halt(session_id)
        except RigError as error:
            # A step that a halt ended is no fault; a safety stop has its own latch.
            if token.is_set() or self._closing.is_set():
                self._enter_halt(session_id)
            elif error.code in PAUSING_CODES and self._monitor.latch is None:
                return not self._pause(session_id, error)
            else:
                self._end_with_error(session_id, error)
        except Exception as error:  # noqa: BLE001 - the thread must live on; the session's reason says what failed
            _log.exception("session %s", session_id)
            self._end_with_error(session_id, RigError(ErrorCode.SERVICE_FAULT, repr(error)))
        return False

    def _next_step(self, session_id: str, token: StopToken) -> bool:
        """Checks stop token, latch and state, then executes the next step; False when there is no more to do."""
        if token.is_set() or self._closing.is_set():
            raise Halted
        latch = self._monitor.latch
        if latch is not None:
            raise RigError(latch.code, latch.detail)
        record = self._store.record(session_id)
        if record.state is State.PAUSING:
            return not self._pause_at_rest(session_id, None)
        if record.state is not State.RUNNING:
            raise Halted
        step = session.next_step(record, self._rig.arm.reading.joints, self._rig.cell.arm.home)
        stage = session.stage(record, step)
        self._announce_stage(session_id, stage)
        self._announce_progress(record, stage)
        if step is None:
            self._executor.keep_calibration(record)
            self._executor.write_session_manifest(session_id)
            self.trigger(session_id, Trigger.FINISH)
            return False
        self._executor.execute(record, step, token)
        return True

    def _enter_halt(self, session_id: str) -> None:
        """Enters the state after a halt that ended a step: stopped, or interrupted when the service ends."""
        state = self._store.journal.session(session_id).state
        if state is State.STOPPING:
            self.trigger(session_id, Trigger.AT_REST)
        elif self._closing.is_set() and state in session_state.RIG_HOLDING:
            reason = problem(ErrorCode.SERVICE_RESTARTED, "The service was shut down")
            self.trigger(session_id, Trigger.INTERRUPT, reason=reason)
        # Else the halt is not journalled yet: a queued request will make its entry.

    def _pause(self, session_id: str, error: RigError) -> bool:
        """Pauses with the reason, because the work needs a person. False when a resume came in between."""
        _log.warning("session %s: %s", session_id, error)
        reason = problem(error.code, error.detail, **error.context)
        return self.trigger(session_id, Trigger.PAUSE, reason=reason) and self._pause_at_rest(session_id, reason)

    def _pause_at_rest(self, session_id: str, reason: dict[str, Any] | None) -> bool:
        """Goes from pausing to paused once a reading shows the arm at rest, else to interrupted.

        False when a person has resumed meanwhile and the session runs again.
        """
        deadline = time.monotonic() + AT_REST_WITHIN_S
        while not self._arm_at_rest():
            if self._closing.wait(REST_POLL_S) or time.monotonic() > deadline:
                why = problem(ErrorCode.ARM_MOVE_FAILED, "No reading showed that the arm came to rest")
                return self.trigger(session_id, Trigger.INTERRUPT, reason=why)
        return self.trigger(session_id, Trigger.AT_REST, reason=reason)

    def _arm_at_rest(self) -> bool:
        reading = self._rig.arm.reading
        return reading.connected and max(map(abs, reading.joint_speeds)) < AT_REST_RAD_S

    def _end_with_error(self, session_id: str, error: RigError) -> None:
        self._rig.halt()
        latch = self._monitor.latch
        if latch is not None:  # its halt ended the step: the latch is the cause
            error = RigError(latch.code, latch.detail)
        _log.error("session %s: %s", session_id, error)
        reason = problem(error.code, error.detail, **error.context)
        self.trigger(session_id, Trigger.INTERRUPT if error.code in INTERRUPTING_CODES else Trigger.FAIL, reason=reason)

    def _announce_stage(self, session_id: str, stage: Stage) -> None:
        if self.stages.get(session_id) is not stage:
            self.stages[session_id] = stage
            self._store.journal.announce(session_id, "session.stage", {"stage": stage})

    def _announce_progress(self, record: SessionRecord, stage: Stage) -> None:
        """Announces progress and remaining time whenever there is progress."""
        now = (record.session_id, session.progress(record))
        if self._progress != now:
            self._progress = now
            left = self._estimator.estimate(record, stage).time_left
            body = {"progress": now[1], "time_left": None if left is None else left.model_dump(mode="json")}
            self._store.journal.announce(record.session_id, "session.progress", body)
