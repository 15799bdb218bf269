"""Capture of a session's images: move, expose, check against earlier frames, and only then record.

All images of a session must show one static scene. From the second pass on each frame is registered to the image that
the previous result predicts; there is no prediction for the first pass, and in some frames no shift can be measured. So
a pass with an image that was not checked in this way ends with a repetition of the session's first image under the same
light. Equal images show that nothing has moved in between. Otherwise the time of the movement is unknown: all images of
the pass are discarded, and captured anew after a person has looked.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from acquisition import session
from acquisition.capture import check, compare, expected, exposure, region, take
from acquisition.capture.take import Exposed
from acquisition.devices import Frame, Rig, StopToken
from acquisition.formats.frames import FolderFrames
from acquisition.models.base import BoolArray, as_joints, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import tool_of
from acquisition.models.camera import CameraRecord
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import JointPath, Waypoint
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.models.step import GoHome, RepeatReference, TakeDark, TakeFurther, TakeShot
from acquisition.runner.compute import Compute
from acquisition.runner.rig_choices import RigChoices
from acquisition.session import SessionRecord
from acquisition.store import Store
from acquisition.store.folder import write_frame
from acquisition.waypoints import measured_pose, mounted_tool


@dataclass(frozen=True)
class Attempt:
    """The last frame that was exposed for an image, its exposure time, s, and the number of the attempt from 0."""

    exposed: Exposed
    exposure_s: float
    number: int

    @property
    def pixels(self) -> np.ndarray:
        """The frame (H, W)."""
        return self.exposed.frame.pixels


@dataclass(frozen=True)
class JudgedAttempt(Attempt):
    """An attempt with the verdict on its frame."""

    verdict: check.Verdict


class ShotCapture:
    """Moves the arm and captures images; used in the runner's thread only."""

    def __init__(self, store: Store, rig: Rig, choices: RigChoices, compute: Compute) -> None:
        self._store = store
        self._rig = rig
        self._choices = choices
        self._compute = compute
        self._region: tuple[Calibration, BoolArray] | None = None

    @property
    def _calibration(self) -> Calibration:
        return self._choices.calibration

    @property
    def region(self) -> BoolArray:
        """Mask (H, W) of the pixels where the object can be."""
        known = self._region
        if known is None or known[0] is not self._calibration:
            known = (self._calibration, region.keep_out(self._rig.cell, self._calibration))
            self._region = known
        return known[1]

    def cell_of(self, record: SessionRecord) -> CellConfig:
        """The cell with the session's tool on the flange, in which its paths are certified."""
        return mounted_tool.with_tool(self._rig.cell, tool_of(record.recipe))

    def lit(self, record: SessionRecord, key: ShotKey) -> bool:
        """Whether the lamp is on during an image."""
        return True

    def take_shot(self, record: SessionRecord, step: TakeShot, stop: StopToken) -> None:
        """Moves to the step's waypoint and captures its image, with retakes at a better exposure time.

        Raises Halted, RigError capture.frame_rejected, scene.moved, arm.move_failed, and what devices report.
        """
        self._go_to(record, step.waypoint, stop)

        def judge(pixels: np.ndarray, exposure_s: float) -> check.Verdict:
            return self.judge_lit(record, step, pixels, exposure_s)

        taken = self._expose_until_good(record, step, self._first_exposure(record, step), judge, stop)
        verdict = taken.verdict
        if not verdict.usable:
            raise RigError(
                ErrorCode.SCENE_MOVED if verdict.moved else ErrorCode.CAPTURE_FRAME_REJECTED,
                f"Light {step.key.number} of pass {step.key.pass_number}: {verdict.quality.reason}",
                light=step.key.number,
            )
        further = _planned_times(record, step.key)[1:] or exposure.further_times(
            taken.exposure_s, record.recipe.exposure, self._rig.cell.camera
        )  # fmt: skip
        self._store_shot(record, step.key, taken, verdict.quality, further=further)

    def take_further(self, record: SessionRecord, step: TakeFurther, stop: StopToken) -> None:
        """Takes a further frame of a light at its waypoint; the arm moves there only if it was moved away.

        Raises Halted, RigError capture.frame_rejected, arm.move_failed, and what devices report.
        """
        self._go_to(record, step.waypoint, stop)

        def judge(pixels: np.ndarray, exposure_s: float) -> check.Verdict:
            quality = check.further_frame(pixels, self.region, self._calibration.sensor)
            return check.Verdict(quality, None if quality.accepted else exposure_s)

        before = take.FRAMES_APART * (step.number + 1)
        taken = self._expose_until_good(record, step, step.exposure_s, judge, stop, before)
        quality = taken.verdict.quality
        if not quality.accepted:
            where = f"Light {step.light.number} of pass {step.light.pass_number}, further frame {step.number}"
            raise RigError(ErrorCode.CAPTURE_FRAME_REJECTED, f"{where}: {quality.reason}", light=step.light.number)
        self._store_shot(record, step.key, taken, quality, kind="bracket", of=step.light)

    def judge_lit(self, record: SessionRecord, step: TakeShot, pixels: np.ndarray, exposure_s: float) -> check.Verdict:
        """Judges a lit frame (H, W) by itself, then against earlier frames and the predicted image."""
        wanted, camera, sensor = record.recipe.exposure, self._rig.cell.camera, self._calibration.sensor
        if _planned_times(record, step.key):
            verdict = check.planned_frame(pixels, self.region, sensor, exposure_s, camera)
        else:
            verdict = check.lit_frame(pixels, self.region, sensor, exposure_s, wanted, camera)
        if verdict.retake_s is not None or not verdict.usable:
            return verdict
        return self._compare_with_earlier(record, step, pixels, exposure_s, verdict.quality)

    def take_dark(self, record: SessionRecord, step: TakeDark, stop: StopToken) -> None:
        """Takes a lamp-off frame. Raises Halted, RigError capture.frame_rejected, and what devices report."""
        # In a simulated cell, too, each pass's frame has its own noise.
        exposed = take.expose(self._rig, step.exposure_s, step.key.pass_number, lit=False, stop=stop)
        quality = check.dark_frame(exposed.frame.pixels, self.region, self._calibration.sensor)
        if not quality.accepted:
            raise RigError(ErrorCode.CAPTURE_FRAME_REJECTED, quality.reason)
        self._store_shot(record, step.key, Attempt(exposed, step.exposure_s, 0), quality, kind="dark")

    def repeat_reference(self, record: SessionRecord, step: RepeatReference, stop: StopToken) -> None:
        """Captures an image again and records it only if object, camera, lamp and arm are as they were.

        Raises Halted, RigError scene.moved, and what devices report.
        """
        first, here, retakes = step.shot, self._rig.arm.reading.joints, record.recipe.retakes
        self._return_to(record, first, here, stop)
        before = self._pixels_of(record, first)
        attempt = differed = 0
        while True:
            # In a simulated cell, too, each attempt has its own noise, and no two images have the same.
            before_this = first.attempt + 1 + record.references
            taken = self._expose(record, step.key, first.exposure_s, attempt, stop, before_this)
            same = compare.same_scene(before, taken.pixels, self.region, self._calibration.sensor)
            if same.accepted or differed == retakes:
                break
            self._announce_retake(record, step.key, same.detail)
            attempt, differed = taken.number + 1, differed + 1
        if not same.accepted:
            raise self._scene_moved(record, step, same)
        self._store_shot(record, step.key, taken, first.quality, repeats=first.key)

    def go_home(self, record: SessionRecord, step: GoHome, stop: StopToken) -> None:
        """Follows the route's own path home from its last waypoint, and a newly planned one from elsewhere."""
        here, route = self._rig.arm.reading.joints, step.route
        if route is not None and route.waypoints and session.same_joints(here, route.waypoints[-1].joints):
            self._follow(record, JointPath(path=route.home_path, speeds=route.home_speeds, seconds=0.0), stop)
            return
        path: JointPath = self._compute.run(stop, "plan_retreat", here, self.cell_of(record), self._calibration)
        self._follow(record, path, stop)

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _go_to(self, record: SessionRecord, waypoint: Waypoint, stop: StopToken) -> None:
        """Follows the path to a waypoint unless the arm stands there."""
        if not session.same_joints(self._rig.arm.reading.joints, waypoint.joints):
            self._follow(record, waypoint, stop)

    def _return_to(self, record: SessionRecord, first: Shot, here: tuple[float, ...], stop: StopToken) -> None:
        """Moves from `here` (rad) to where the arm stood for an image."""
        if first.joints is None:
            name = f"Image {first.key.number} of pass {first.key.pass_number}"
            raise RigError(ErrorCode.SERVICE_FAULT, f"{name} was stored without the arm's joints")
        if not session.same_joints(here, first.joints):
            known = (self.cell_of(record), self._calibration)
            self._follow(record, self._compute.run(stop, "plan_return", here, first.joints, *known), stop)

    def _follow(self, record: SessionRecord, path: JointPath | Waypoint, stop: StopToken) -> None:
        """Records the move in the journal, then follows the collision-free path (write-ahead: see `preconditions`)."""
        here = self._rig.arm.reading.joints
        self._store.journal.record_move(record.session_id, [here, *path.path])
        take.follow_path(self._rig, path.path, path.speeds, stop)

    def _expose(
        self,
        record: SessionRecord,
        key: ShotKey,
        exposure_s: float,
        attempt: int,
        stop: StopToken,
        attempts_before: int = 0,
    ) -> Attempt:
        """Takes a frame, from the attempt of a number on. Lost frames are retaken as often as the recipe allows."""
        lit, lost = self.lit(record, key), 0
        while True:
            try:
                exposed = take.expose(self._rig, exposure_s, attempts_before + attempt, lit=lit, stop=stop)
                return Attempt(exposed, exposure_s, attempt)
            except RigError as error:
                if error.code is not ErrorCode.CAMERA_TIMEOUT or lost == record.recipe.retakes:
                    raise
                self._announce_retake(record, key, error.detail)
                attempt, lost = attempt + 1, lost + 1

    def _expose_until_good(
        self, record: SessionRecord, step: TakeShot | TakeFurther, exposure_s: float,
        judge: Callable[[np.ndarray, float], check.Verdict], stop: StopToken, attempts_before: int = 0,
    ) -> JudgedAttempt:  # fmt: skip
        """Takes a step's frame, and retakes it at the exposure time that the verdict proposes as often as the recipe
        allows. `judge` takes pixels (H, W) and exposure time, s. Lost frames are counted separately."""
        attempt = rejected = 0
        while True:
            taken = self._expose(record, step.key, exposure_s, attempt, stop, attempts_before)
            self._require_arm_at_light(taken.exposed, step)
            verdict = judge(taken.pixels, exposure_s)
            if verdict.retake_s is None or rejected == record.recipe.retakes:
                return JudgedAttempt(taken.exposed, exposure_s, taken.number, verdict)
            self._announce_retake(record, step.key, verdict.quality.reason)
            exposure_s, attempt, rejected = verdict.retake_s, taken.number + 1, rejected + 1

    def _pixels_of(self, record: SessionRecord, shot: Shot) -> np.ndarray:
        """Returns the pixels (H, W) of an image of the session."""
        return FolderFrames(self._store.folder(record.session_id)).rows(shot.frame, 0, shot.frame.height)

    def _compare_with_earlier(
        self, record: SessionRecord, step: TakeShot, pixels: np.ndarray, exposure_s: float, quality: FrameQuality
    ) -> check.Verdict:
        number, light = step.key.pass_number, step.key.number
        sharpnesses = [shot.quality.sharpness for work in record.passes for shot in work.shots.values()]
        plans = self._store.journal.plan_count(record.session_id, number)
        file = predicted_image_file(self._store.folder(record.session_id), number, plans, light)
        return check.compare_with_earlier(
            quality,
            pixels,
            self.region,
            self._calibration.sensor,
            exposure_s,
            [sharpness for sharpness in sharpnesses if sharpness is not None],
            expected.decode_image(file.read_bytes()) if file.exists() else None,
        )

    def _scene_moved(self, record: SessionRecord, step: RepeatReference, same: compare.Comparison) -> RigError:
        """Returns the error for a repeated image that differs; discards the pass's images when it closes the pass."""
        first, number = step.shot.key, step.key.pass_number
        detail = f"Image {first.number} of pass {first.pass_number}, taken again, {same.detail}"
        if step.closes_pass:
            detail += f"; all images of pass {number} will be taken again"
            self._store.journal.discard_shots(record.session_id, number, detail)
        return RigError(
            ErrorCode.SCENE_MOVED, detail, shift_px=same.shift_px, brightness=same.brightness, changed=same.changed
        )

    def _announce_retake(self, record: SessionRecord, key: ShotKey, reason: str) -> None:
        body = {"pass": key.pass_number, "number": key.number, "reason": reason}
        self._store.journal.announce(record.session_id, "shot.retaken", body)

    def _require_arm_at_light(self, exposed: Exposed, step: TakeShot | TakeFurther) -> None:
        """Raises RigError arm.move_failed if the arm was not at the waypoint, because somebody else has moved it."""
        if not session.same_joints(exposed.reading.joints, step.waypoint.joints):
            raise RigError(
                ErrorCode.ARM_MOVE_FAILED, f"The arm was not at light {step.light.number} while its frame was exposed"
            )

    def _first_exposure(self, record: SessionRecord, step: TakeShot) -> float:
        wanted, camera = record.recipe.exposure, self._rig.cell.camera
        work = record.passes[step.key.pass_number]
        if planned := _planned_times(record, step.key):
            return planned[0]
        if work.plan is not None and work.plan.levels_per_s is not None:
            return exposure.for_predicted_level(work.plan.levels_per_s[step.key.number], wanted, camera)
        seen = [shot.quality.bright_level / shot.exposure_s for shot in work.shots.values()]
        level = seen[-1] if seen else exposure.assumed_level(self._rig.cell, self._calibration)
        return exposure.for_level(level, wanted, camera)

    def _store_shot(
        self, record: SessionRecord, key: ShotKey, taken: Attempt, quality: FrameQuality, *,
        kind: Literal["light", "dark", "bracket"] = "light", repeats: ShotKey | None = None,
        further: Sequence[float] = (), of: ShotKey | None = None,
    ) -> None:  # fmt: skip
        """Writes the frame's file, then its row and event: the event announces only what is on the disk.

        `repeats` names the image that it repeats, `of` that of the same light whose bracket it belongs to; `further`
        are the exposure times, s, that follow for its light.
        """
        file, dark = f"shots/{key.number}.tiff", kind == "dark"
        light = key if of is None else of
        if dark:
            file = f"dark_{round(taken.exposure_s * 1e6)}.tiff"
        elif kind == "bracket":
            file = f"brackets/{key.number}.tiff"
        elif repeats is not None:
            file = f"references/{key.number}.tiff"
        exposed, reading = taken.exposed, taken.exposed.reading
        frame = write_frame(
            self._store.folder(record.session_id), f"passes/{key.pass_number}/{file}", exposed.frame.pixels
        )
        shot = Shot(
            key=key,
            kind=kind if repeats is None else "reference",
            repeats=repeats,
            frame=frame,
            exposure_s=taken.exposure_s,
            further_s=list(further),
            light_number=light.number if not dark and repeats is None else None,
            light=None
            if dark
            else measured_pose.light(
                reading.base_from_tool, np.array(reading.joints), self._rig.cell.arm, self._calibration
            ),
            joints=as_joints(reading.joints),
            base_from_tool=as_matrix4(reading.base_from_tool),
            lamp_on=not dark and self.lit(record, key),
            attempt=taken.number,
            arm_time_s=reading.timestamp,
            taken_at=exposed.frame.taken_at,
            quality=quality,
            camera=_camera_record(exposed.frame),
            motion=exposed.motion,
        )
        self._store.journal.add_shot(record.session_id, shot)


def _planned_times(record: SessionRecord, key: ShotKey) -> list[float]:
    """Returns the exposure times, s, that the pass's plan gives the frames of a light, in order; empty if none."""
    work = record.passes[key.pass_number]
    exposures = None if work.plan is None else work.plan.exposures
    return [] if exposures is None else exposures[key.number].times_s


def _camera_record(frame: Frame) -> CameraRecord | None:
    known = frame.settings
    if known is None:
        return None
    return CameraRecord(
        settings=known.fingerprint, exposure_s=known.exposure_s, number=frame.number, temperature_c=frame.temperature_c
    )


def predicted_image_file(folder: Path, pass_number: int, plan: int, light: int) -> Path:
    """Returns the file of the image predicted for a light; `plan` counts a pass's plans from 1. Pass 0 has none.

    The file name is part of the session folder's layout.
    """
    return folder / f"passes/{pass_number}/foretold_{plan}_{light}.png"
