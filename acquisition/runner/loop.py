"""A session's turns: look, gate, do, write, again and again until it ends, pauses or is cut off.

Each turn reads the next step from the journal and from where the arm stands, does it, and enters what came of it. What
a failure means is decided here: a problem of the work pauses the session, one of the devices interrupts it, any other
one ends it. People may be quicker than a turn; then their word holds, and the turn's own trigger is refused.
"""

import logging
import threading
import time
from typing import Any

from structlog.contextvars import bound_contextvars

from acquisition import session
from acquisition.devices import Rig, StopToken
from acquisition.models.errors import ErrorCode, Halted, RigError, problem
from acquisition.runner.safety_monitor import SafetyMonitor
from acquisition.runner.step_executor import Steps
from acquisition.session import Actor, Stage, State, Trigger
from acquisition.store import Store

_log = logging.getLogger(__name__)

INTERRUPTS = frozenset(
    {
        ErrorCode.ARM_PROTECTIVE_STOP,
        ErrorCode.ARM_EMERGENCY_STOP,
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
"""Problems of arm, lamp and camera: nothing moves before a person has looked and resumes."""

PAUSES = frozenset(
    {
        ErrorCode.CAPTURE_FRAME_REJECTED,
        ErrorCode.SCENE_MOVED,
        ErrorCode.STORE_DISK_FULL,
        ErrorCode.PLAN_TO_REVIEW,
    }
)
"""Problems of the work, the rig being well: a person mends them and resumes. What is in neither ends the session."""

AT_REST_RAD_S = 0.01
AT_REST_WITHIN_S = 2.0
LOOK_EVERY_S = 0.02
TRY_AGAIN_S = 1.0


class Turns:
    """Runs sessions in the runner's thread; `trigger` may be called from any."""

    def __init__(self, store: Store, rig: Rig, steps: Steps, monitor: SafetyMonitor, closing: threading.Event) -> None:
        self._store, self._rig, self._steps, self._monitor = store, rig, steps, monitor
        self._closing = closing
        self.stages: dict[str, Stage] = {}

    def run(self, session_id: str, token: StopToken) -> None:
        """One session's turns, until it ends, pauses or is cut off."""
        with bound_contextvars(session_id=session_id):  # every entry of the log made meanwhile names it
            while self._goes_on(session_id, token):
                pass

    def trigger(
        self, session_id: str, trigger: Trigger, actor: str = Actor.RUNNER, reason: dict[str, Any] | None = None
    ) -> bool:
        """The service's own triggers; False for one that comes too late because a person was quicker: no failure.

        A full disk is waited for: the state must not be lost, and nothing moves meanwhile.
        """
        while True:
            try:
                self._store.journal.trigger(session_id, trigger, actor, reason)
            except RigError as error:
                if error.code is ErrorCode.STORE_DISK_FULL and not self._closing.wait(TRY_AGAIN_S):
                    continue
                if error.code is not ErrorCode.SESSION_ACTION_NOT_ALLOWED:
                    raise
                _log.info("session %s: %s came too late", session_id, trigger)
                return False
            return True

    def _goes_on(self, session_id: str, token: StopToken) -> bool:
        """One turn, whatever becomes of it; False when there is no more to do."""
        try:
            return self._turn(session_id, token)
        except Halted:
            self._settle(session_id)
        except RigError as error:
            if token.is_set():  # what a halt breaks off is no fault; a safety stop has its own latch
                self._settle(session_id)
            elif error.code in PAUSES and self._monitor.latch is None:
                return not self._pause(session_id, error)
            else:
                self._give_up(session_id, error)
        except Exception as error:  # noqa: BLE001 - the thread must live on; the session tells what failed
            _log.exception("session %s", session_id)
            self._give_up(session_id, RigError(ErrorCode.SERVICE_FAULT, repr(error)))
        return False

    def _turn(self, session_id: str, token: StopToken) -> bool:
        """Does one step; False when there is no more to do."""
        if token.is_set() or self._closing.is_set():
            raise Halted
        latch = self._monitor.latch
        if latch is not None:
            raise RigError(latch.code, latch.detail)
        record = self._store.record(session_id)
        if record.state is State.PAUSING:
            return not self._come_to_rest(session_id, None)
        if record.state is not State.RUNNING:
            raise Halted
        step = session.next_step(record, self._rig.arm.reading.joints, self._rig.cell.arm.home)
        self._announce_stage(session_id, session.stage(record, step))
        if step is None:
            self._steps.end(session_id)
            self.trigger(session_id, Trigger.FINISH)
            return False
        self._steps.do(record, step, token)
        return True

    def _settle(self, session_id: str) -> None:
        """After a halt: the arm has come to rest; what the state becomes depends on who asked."""
        state = self._store.journal.session(session_id).state
        if state is State.STOPPING:
            self.trigger(session_id, Trigger.SETTLE)
        elif self._closing.is_set() and state in session.HOLDS_THE_RIG:
            reason = problem(ErrorCode.SERVICE_RESTARTED, "The service was ended")
            self.trigger(session_id, Trigger.INTERRUPT, reason=reason)
        # Else a halt that is not journalled yet: its entry follows as a request.

    def _pause(self, session_id: str, error: RigError) -> bool:
        """The work needs a person: pauses with the reason. False when somebody was quicker with a resume."""
        _log.warning("session %s: %s", session_id, error)
        reason = problem(error.code, error.detail, **error.context)
        return self.trigger(session_id, Trigger.PAUSE, reason=reason) and self._come_to_rest(session_id, reason)

    def _come_to_rest(self, session_id: str, reason: dict[str, Any] | None) -> bool:
        """From pausing to paused once a reading proves that the arm rests, else to interrupted.

        False when a person was quicker and the session runs again.
        """
        deadline = time.monotonic() + AT_REST_WITHIN_S
        while not self._rests():
            if self._closing.wait(LOOK_EVERY_S) or time.monotonic() > deadline:
                why = problem(ErrorCode.ARM_MOVE_FAILED, "The arm was not seen to come to rest")
                return self.trigger(session_id, Trigger.INTERRUPT, reason=why)
        return self.trigger(session_id, Trigger.SETTLE, reason=reason)

    def _rests(self) -> bool:
        reading = self._rig.arm.reading
        return reading.connected and max(map(abs, reading.joint_speeds)) < AT_REST_RAD_S

    def _give_up(self, session_id: str, error: RigError) -> None:
        self._rig.halt()
        latch = self._monitor.latch
        if latch is not None:  # the monitor was quicker and its halt ended the step: the latch is the cause
            error = RigError(latch.code, latch.detail)
        _log.error("session %s: %s", session_id, error)
        reason = problem(error.code, error.detail, **error.context)
        self.trigger(session_id, Trigger.INTERRUPT if error.code in INTERRUPTS else Trigger.FAIL, reason=reason)

    def _announce_stage(self, session_id: str, stage: Stage) -> None:
        if self.stages.get(session_id) is not stage:
            self.stages[session_id] = stage
            self._store.journal.announce(session_id, "session.stage", {"stage": stage})
