"""Moves that a person requests outside of sessions: the path home, and jogging while a button is held.

Both run in the runner's thread, on paths that are certified like those of routes, and any halt ends both. Jogging has a
dead-man: each request renews the hold for `HOLD_S`. When the hold has run out, the stop token, which every waiting loop
of a move checks, counts as set. So stopping the arm depends on no timer or thread of its own; if the service itself
falls silent, the driver's lease stops the arm (decisions 8 and 51).
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from acquisition import session
from acquisition.capture import take
from acquisition.devices import Rig, StopToken
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.route import JointPath
from acquisition.runner.compute import Compute
from acquisition.runner.readiness import require_preflight
from acquisition.runner.rig_choices import RigChoices
from acquisition.store import Store
from acquisition.store.queue_table import QueueState

_log = logging.getLogger(__name__)

HOLD_S = 0.3
"""Time, s, for which a jog goes on after the last request; at the highest jogging speed the tool moves 3 cm then."""

ENDED_WITHIN_S = 2.0
"""Time limit, s, for the arm to come to rest when a jog is ended; a step takes less."""

REMEMBERED_HOLDS = 64
"""Number of presses that are remembered, so that a late renewal of an ended press starts no motion."""

_POLL_S = 0.01


class HoldToken(threading.Event):
    """A stop token that sets itself unless it is renewed every `HOLD_S`."""

    def __init__(self) -> None:
        super().__init__()
        self._until = time.monotonic() + HOLD_S
        self.halted = False  # True if somebody has set the token, not if the hold has run out

    def renew(self) -> None:
        """Renews the hold: the button is still pressed."""
        self._until = time.monotonic() + HOLD_S

    def let_go(self) -> None:
        """Ends the hold: the button is released."""
        super().set()

    def set(self) -> None:
        """Ends the move at once, as a halt of the cell does."""
        self.halted = True
        super().set()

    def is_set(self) -> bool:
        """Whether the move has to end; once True, it stays so, and a renewal has no effect."""
        if not super().is_set() and time.monotonic() > self._until:
            self.let_go()
        return super().is_set()


@dataclass(frozen=True)
class RunnerAccess:
    """Functions of the runner, whose thread and stop token the moves use."""

    refuse_held: Callable[[], None]
    require_clear: Callable[[], None]
    make_ready: Callable[[], None]
    is_ready: Callable[[], bool]
    halts: Callable[[], int]
    take_over: Callable[[StopToken], None]
    is_current: Callable[[StopToken], bool]
    put: Callable[[Callable[[], None]], None]
    closing: threading.Event


class _Jog:
    """One jog: from the press of a button until the arm is at rest."""

    def __init__(self, hold: str, motion: JogMotion, actor: str, once: bool) -> None:
        self.hold, self.motion, self.actor, self.once = hold, motion, actor, once
        self.token = HoldToken()
        self.ended = threading.Event()
        self.error: RigError | None = None
        self.moving = False


class OperatorMoves:
    """Parks and jogs the arm; public methods may be called from any thread."""

    def __init__(self, store: Store, rig: Rig, choices: RigChoices, compute: Compute, access: RunnerAccess) -> None:
        self._store, self._rig, self._choices, self._compute = store, rig, choices, compute
        self._access = access
        self._lock = threading.Lock()
        self._jog: _Jog | None = None
        self._holds: deque[str] = deque(maxlen=REMEMBERED_HOLDS)

    # ------------------------------------------------------------------------------------------------------------ home

    def park(self, actor: str) -> None:
        """Starts moving the arm home on a collision-free path from its present joints; the event `rig.parked` gives the
        outcome.

        Raises RigError rig.busy while a session holds the rig or somebody jogs, waypoints.collision when no such path
        exists (somebody must move the arm by hand), safety.not_acknowledged, and what devices report.
        """
        access = self._access
        access.refuse_held()
        self.refuse_jogged()
        token = StopToken()
        self._take_over(token)  # before any check: a halt from now on ends this move, planned or not
        access.require_clear()
        access.make_ready()
        access.require_clear()
        here, known = self._rig.arm.reading.joints, self._known
        path: JointPath = self._compute.run(access.closing, "plan_retreat", here, *known)
        access.put(lambda: self._follow_home(here, known, path, token, actor))

    def _take_over(self, token: StopToken) -> None:
        """Makes `token` the one that a halt sets; sets it at once if somebody halts meanwhile."""
        halts = self._access.halts()
        self._access.take_over(token)
        if self._access.halts() != halts:
            token.set()

    def _follow_home(
        self, here: tuple[float, ...], known: tuple[CellConfig, Calibration], path: JointPath, token: StopToken,
        actor: str,
    ) -> None:  # fmt: skip
        """Follows the path home in the runner's thread, unless something else has begun since it was planned, or it was
        planned from other joints or with another tool than now."""
        outcome = "another request came first"
        journal = self._store.journal
        if self._access.is_current(token) and journal.holder() is None:
            try:
                self._access.require_clear()
                if token.is_set():
                    raise Halted
                if not session.same_joints(self._rig.arm.reading.joints, here):
                    raise RigError(ErrorCode.ARM_MOVE_FAILED, "The arm has been moved since the path was planned")
                if self._known != known:
                    detail = "Another tool or calibration has been stated since the path was planned: park again"
                    raise RigError(ErrorCode.RIG_CHANGED, detail)
                take.follow_path(self._rig, path.path, path.speeds, token)
                outcome = "at home"
            except Halted:
                outcome = "halted"
            except RigError as error:
                self._rig.halt()
                outcome = f"halted: {error}" if token.is_set() else str(error)
        journal.record_action(None, "park", actor, outcome)
        journal.announce(None, "rig.parked", {"outcome": outcome})

    # ------------------------------------------------------------------------------------------------------------- jog

    def refuse_jogged(self) -> None:
        """Raises RigError rig.busy while somebody jogs the arm."""
        jog = self._jog
        if jog is not None and not jog.ended.is_set():
            raise RigError(ErrorCode.RIG_BUSY, f"{jog.actor} is jogging the arm: release the button first")

    def jog(self, hold: str, motion: JogMotion, actor: str, *, once: bool) -> bool:
        """Begins a motion, or renews the hold of the one in progress; returns whether the arm already moves by it.

        `hold` names one press of a button: when its motion has ended, for whatever reason, it begins no other. The
        motion goes on step by step until the hold runs out; with `once` it ends after one step. Raises RigError
        rig.busy while a session holds the rig, the queue runs or somebody else jogs; arm.jog_ended; waypoints.collision
        and waypoints.unreachable when the next step is not free; safety.not_acknowledged, and what devices report.
        """
        access = self._access
        access.refuse_held()
        if self._store.journal.queue_status().state is QueueState.RUNNING:
            raise RigError(ErrorCode.RIG_BUSY, "The queue is running: pause it first")
        access.require_clear()
        with self._lock:
            jog = self._jog
            if jog is not None and not jog.ended.is_set() and jog.actor != actor:
                raise RigError(ErrorCode.RIG_BUSY, f"{jog.actor} is jogging the arm: wait for its release")
            if jog is not None and jog.hold == hold and not jog.token.is_set() and not jog.ended.is_set():
                jog.token.renew()
                return jog.moving
            if hold in self._holds:
                why = None if jog is None or jog.hold != hold else jog.error
                raise why or RigError(ErrorCode.ARM_JOG_ENDED, "The motion of this press has ended")
            if jog is not None:
                self._end(jog)
            made = _Jog(hold, motion, actor, once)
            self._take_over(made.token)
            self._jog = made
            self._holds.append(hold)
        try:
            if not access.is_ready():
                access.make_ready()
                access.require_clear()
        except BaseException as error:
            made.error = error if isinstance(error, RigError) else None
            made.ended.set()
            raise
        access.put(lambda: self._drive(made))
        while not made.moving and not made.ended.wait(_POLL_S) and not access.closing.is_set():
            pass
        if made.error is not None:
            raise made.error
        return not made.ended.is_set()

    def release(self, hold: str | None = None) -> None:
        """Ends a jog at once, and returns when the arm is at rest. The press `hold` begins no motion any more, even if
        its request is still on the way. Raises RigError rig.busy if the jog does not end within ENDED_WITHIN_S."""
        with self._lock:
            if hold is not None and hold not in self._holds:
                self._holds.append(hold)
            if self._jog is not None:
                self._end(self._jog)

    def _end(self, jog: _Jog) -> None:
        jog.token.let_go()
        if not jog.ended.wait(ENDED_WITHIN_S):
            raise RigError(ErrorCode.RIG_BUSY, "The arm is not at rest yet: wait a moment, then ask again")

    def _drive(self, jog: _Jog) -> None:
        """Follows one certified step in the runner's thread and queues the next one, until the jog has ended.

        Between two steps the thread serves other requests, so that the camera's preview shows where the arm is.
        """
        outcome = self._step(jog)
        if outcome is None:
            self._access.put(lambda: self._drive(jog))
            return
        jog.ended.set()
        if jog.moving:
            self._store.journal.record_action(None, "jog", jog.actor, outcome)
            body = {"outcome": outcome, "by": jog.actor, "joints": list(self._rig.arm.reading.joints)}
            self._store.journal.announce(None, "rig.jogged", body)

    def _step(self, jog: _Jog) -> str | None:
        """Follows one step; returns the jog's outcome if it was the last one, else None."""
        access, token = self._access, jog.token
        try:
            if not access.is_current(token):
                return "another request came first"
            access.refuse_held()
            access.require_clear()
            if not jog.moving:  # the pendant may have been put into local control since the last press
                require_preflight(self._rig.arm)
            known = (jog.motion, *self._known)
            # The jog's token ends the wait for other jobs, but not this job: that would kill the compute process, whose
            # start takes seconds.
            path: JointPath = self._compute.run(
                access.closing, "jog_step", self._present_joints(), *known, while_waiting=token
            )
            access.require_clear()
            if token.is_set():
                raise Halted
            jog.moving = True
            self._rig.arm.move(path.path, take.motion_limits(self._rig.cell, path.speeds), token)
        except Halted:
            return "halted" if token.halted else "released"
        except RigError as error:
            return self._failed(jog, error)
        except Exception as error:  # noqa: BLE001 - the runner's thread must live on
            _log.exception("jog")
            return self._failed(jog, RigError(ErrorCode.SERVICE_FAULT, repr(error)))
        return "one step" if jog.once else None

    def _failed(self, jog: _Jog, error: RigError) -> str:
        if jog.moving:
            self._rig.halt()
        if jog.token.halted:
            return "halted"
        jog.error = error
        return str(error)

    @property
    def _known(self) -> tuple[CellConfig, Calibration]:
        """The cell with the tool on the flange, and the calibration in use."""
        return self._choices.cell, self._choices.calibration

    def _present_joints(self) -> tuple[float, ...]:
        reading = self._rig.arm.reading
        if not reading.connected:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The arm's position is unknown: {reading.lost}")
        return reading.joints
