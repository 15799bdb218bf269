"""Capture on the way: each image is exposed as the arm arrives at its light, and judged on the way to the next.

The arm is moved as for images at rest, one certified segment after another, in the runner's thread; only the waiting is
left out. The lamp stays on from the first light to the last. A second thread begins each exposure when the lamp has
less than half of its calibrated σ to go. The arm leaves as soon as the exposure is over; readout, judgement and storage
happen meanwhile. A frame's light is the lamp's position in the middle of the exposure by the controller's poses. A
frame that was lost, exposed wrongly or during too much motion is taken again at rest after the others.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from acquisition import session
from acquisition.capture import exposure, moving, take
from acquisition.capture.take import Exposed
from acquisition.devices import Frame, Rig, StopToken
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.models.step import TakeScan, TakeShot
from acquisition.runner.compute import Compute
from acquisition.runner.rig_choices import RigChoices
from acquisition.runner.shots import Attempt, ShotCapture
from acquisition.session import SessionRecord
from acquisition.session_state import State
from acquisition.store import Store

POLL_S = 0.002
"""Period, s, of checking the arm's track and the stop token while a light is approached."""

LEADS = 8
"""Number of recent images whose lead times (from the call until the exposure begins) are kept; the longest counts."""

AFTER_S = 0.01
"""Margin, s, of the arm's wait beyond the end of an exposure that begins after the longest lead time."""

ARRIVES_WITHIN_S = 60.0
"""Time limit, s, for the arm to come near its light; moves take some seconds."""

TRACK_WITHIN_S = 0.5
"""Time limit, s, for the poses at the end of an exposure to arrive."""


@dataclass
class _Passing:
    """One image on the way: what is to be taken, and the outcome."""

    shot: TakeShot
    exposure_s: float
    ends_at: float | None = None  # time.monotonic() when the exposure will be over; None: not known before the frame
    over: threading.Event = field(default_factory=threading.Event)  # the frame is here, or none will come
    done: threading.Event = field(default_factory=threading.Event)
    stored: bool = False
    level_per_s: float | None = None  # brightest level in full scales per second, of a frame that was well exposed
    error: Exception | None = None


class MovingShotCapture(ShotCapture):
    """Captures images at rest and on the way; used in the runner's thread, which starts a second one per exposure."""

    def __init__(self, store: Store, rig: Rig, choices: RigChoices, compute: Compute) -> None:
        super().__init__(store, rig, choices, compute)
        self._leads_s: deque[float] = deque(maxlen=LEADS)  # from the call until an exposure had begun

    @property
    def _lead_s(self) -> float | None:
        return max(self._leads_s, default=None)

    def take_scan(self, record: SessionRecord, step: TakeScan, stop: StopToken) -> None:
        """Follows waypoints and captures the image of each on the way, then at rest those that failed.

        Ends early when the session is to pause. Raises what `take_shot` raises.
        """
        shots = list(step.shots)
        if self._level(record, shots[0]) is None:  # an exposure time that is only assumed costs a retake
            self.take_shot(record, shots.pop(0), stop)
        passed = self._pass_lights(self._store.record(record.session_id), shots, stop)
        for passing in passed:
            if isinstance(passing.error, Halted):
                raise passing.error
        if self._rig.camera.is_gone:
            self._rig.camera.take_up(stop)
        for passing in passed:
            if not passing.stored and self._goes_on(record):
                self._take_at_rest(record, passing.shot, stop)

    def _pass_lights(self, record: SessionRecord, shots: list[TakeShot], stop: StopToken) -> list[_Passing]:
        """Moves through the lights with the lamp on; returns the outcome of each light that was tried."""
        passed: list[_Passing] = []
        ended = StopToken()
        try:
            self._rig.lamp.set(True)
            self._rig.clock.wait(self._rig.cell.lamp.rise_s, stop)
            for shot in shots:
                if not self._goes_on(record) or any(isinstance(one.error, RigError) for one in passed):
                    break
                passing = _Passing(shot, self._exposure(record, shot, passed))
                passed.append(passing)
                before = passed[-2] if len(passed) > 1 else None
                worker = threading.Thread(
                    target=self._take_on_the_way, args=(record, passing, before, stop, ended), name="on the way"
                )
                worker.start()
                self._arrive(record, shot, stop)
                self._await_exposed(passing, stop)
        except BaseException:
            ended.set()
            raise
        finally:
            try:
                self._rig.lamp.set(False)
            finally:
                for passing in passed:
                    passing.done.wait()
        return passed

    def _arrive(self, record: SessionRecord, shot: TakeShot, stop: StopToken) -> None:
        """Moves to a light without the settling time."""
        here, waypoint = self._rig.arm.reading.joints, shot.waypoint
        if not session.same_joints(here, waypoint.joints):
            self._store.journal.record_move(record.session_id, [here, *waypoint.path])
            self._rig.arm.move(waypoint.path, take.motion_limits(self._rig.cell, waypoint.speeds), stop)

    @staticmethod
    def _await_exposed(passing: _Passing, stop: StopToken) -> None:
        """Waits until the exposure is over. Raises Halted."""
        while not passing.over.wait(POLL_S):
            if stop.is_set():
                raise Halted
            if passing.ends_at is not None and time.monotonic() >= passing.ends_at:
                return

    def _take_on_the_way(
        self, record: SessionRecord, passing: _Passing, before: _Passing | None, stop: StopToken, ended: StopToken
    ) -> None:
        """Exposes, judges and stores one image, in the second thread."""
        try:
            if before is not None:
                before.done.wait()  # one frame at a time
            frame = self._expose_near(passing, stop, ended)
            if frame is not None:
                self._keep(record, passing, frame, stop)
        except Exception as error:  # noqa: BLE001 - the runner's thread raises what is not mended at rest
            passing.error = error
        finally:
            passing.over.set()
            passing.done.set()

    def _expose_near(self, passing: _Passing, stop: StopToken, ended: StopToken) -> Frame | None:
        """Exposes a frame as the arm arrives at its light; returns None if it does not arrive."""
        goal, lead_s = passing.shot.waypoint.joints, self._lead_s or 0.0
        allowed_m = moving.AIMED_SHARE * self._calibration.lamp_position_sigma_m
        deadline = time.monotonic() + ARRIVES_WITHIN_S
        while not moving.is_near(self._track(0.1), goal, allowed_m, lead_s):
            if stop.wait(POLL_S):
                raise Halted
            if ended.is_set() or time.monotonic() > deadline:
                return None
        called_at = time.monotonic()
        if self._lead_s is not None:
            passing.ends_at = called_at + self._lead_s + passing.exposure_s + AFTER_S
        try:
            frame = self._rig.camera.expose(passing.exposure_s, 0, stop)
        finally:
            passing.over.set()
        begun_at = _monotonic(frame.taken_at) - passing.exposure_s / 2
        hardware = frame.settings is not None and frame.settings.trigger == "hardware"
        # A hardware trigger waits in the arm's driver for the end of the move: only the frame gives the time.
        if not hardware:
            self._leads_s.append(begun_at - called_at)
        return frame

    def _keep(self, record: SessionRecord, passing: _Passing, frame: Frame, stop: StopToken) -> None:
        """Judges a frame and stores it with the arm's pose in the middle of its exposure, or announces a retake."""
        shot, middle = passing.shot, self._middle(frame, passing.exposure_s, stop)
        most_m = moving.MAX_SHARE * self._calibration.lamp_position_sigma_m
        if middle is None:
            self._announce_retake(record, shot.key, "the arm's poses during the exposure are not known")
            return
        if not session.same_joints(middle.joints, shot.waypoint.joints) or middle.motion.moved_m > most_m:
            moved = f"the lamp moved by {1e3 * middle.motion.moved_m:.1f} mm during the exposure"
            self._announce_retake(record, shot.key, moved)
            return
        verdict = self.judge_lit(record, shot, frame.pixels, passing.exposure_s)
        if verdict.retake_s is not None or not verdict.usable:
            self._announce_retake(record, shot.key, verdict.quality.reason)
            return
        passing.level_per_s = verdict.quality.bright_level / passing.exposure_s
        reading = replace(
            self._rig.arm.reading, joints=middle.joints, base_from_tool=middle.base_from_tool,
            timestamp=middle.controller_time,
        )  # fmt: skip
        taken = Attempt(Exposed(frame, reading, middle.motion), passing.exposure_s, 0)
        self._store_shot(record, shot.key, taken, verdict.quality)
        passing.stored = True

    def _middle(self, frame: Frame, exposure_s: float, stop: StopToken) -> moving.Middle | None:
        """Waits for the poses until the end of an exposure; returns the arm in its middle, None if they do not come."""
        taken_at, deadline = _monotonic(frame.taken_at), time.monotonic() + TRACK_WITHIN_S
        begin, end = taken_at - exposure_s / 2, taken_at + exposure_s / 2
        while (middle := moving.during(self._track(exposure_s + 2.0), begin, end)) is None:
            if time.monotonic() > deadline:
                return None
            if stop.wait(POLL_S):
                raise Halted
        return middle

    def _track(self, seconds: float) -> moving.LampTrack:
        points = self._rig.arm.track(seconds)
        if not points:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "No poses arrive from the arm's driver")
        return moving.lamp_track(points, np.array(self._calibration.tool_from_lamp))

    def _take_at_rest(self, record: SessionRecord, shot: TakeShot, stop: StopToken) -> None:
        """Takes an image at rest, from wherever the arm is."""
        here = self._rig.arm.reading.joints
        if not session.same_joints(here, shot.waypoint.joints):
            known = (self.cell_of(record), self._calibration)
            self._follow(record, self._compute.run(stop, "plan_return", here, shot.waypoint.joints, *known), stop)
        else:
            self._rig.clock.wait(self._rig.cell.arm.settle_s, stop)
        self.take_shot(self._store.record(record.session_id), shot, stop)

    def _goes_on(self, record: SessionRecord) -> bool:
        """Whether the session is running: nobody has asked it to pause or stop."""
        return self._store.journal.session(record.session_id).state is State.RUNNING

    def _level(self, record: SessionRecord, shot: TakeShot) -> float | None:
        """Returns a light's brightest level, full scales per second: predicted, or that of the last image."""
        work = record.passes[shot.key.pass_number]
        if record.recipe.exposure.seconds is not None:
            return 1.0
        if work.plan is not None and work.plan.levels_per_s is not None:
            return work.plan.levels_per_s[shot.key.number]
        seen = [known.quality.bright_level / known.exposure_s for known in work.shots.values()]
        return seen[-1] if seen else None

    def _exposure(self, record: SessionRecord, shot: TakeShot, passed: list[_Passing]) -> float:
        """Returns the exposure time, s, of an image on the way."""
        work = record.passes[shot.key.pass_number]
        seen = [one.level_per_s for one in passed if one.level_per_s is not None]
        if not seen or (work.plan is not None and work.plan.levels_per_s is not None):
            return self._first_exposure(record, shot)
        return exposure.for_level(seen[-1], record.recipe.exposure, self._rig.cell.camera)


def _monotonic(wall_s: float) -> float:
    """Returns the value of time.monotonic() at a time in seconds since 1970."""
    return wall_s - time.time() + time.monotonic()
