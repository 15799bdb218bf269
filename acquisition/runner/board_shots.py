"""Capture of views of the calibration board: as images of an object are captured, but judged by the board's corners.

A view in which the board is not seen is kept and named, because one pose may be unlucky (glare, a corner out of the
image); two in a row, or the first one, pause the session: then something is wrong that a person has to look at.
"""

import numpy as np

from acquisition import session
from acquisition.capture import check, exposure
from acquisition.devices import StopToken
from acquisition.formats.frames import FolderFrames
from acquisition.models.base import BoolArray
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import FrameQuality, ShotKey
from acquisition.models.step import RepeatReference, TakeShot
from acquisition.runner.shots import ShotCapture
from acquisition.session import SessionRecord

START_EXPOSURE_S = 0.01
"""Exposure time of the first view, s; levels are proportional to it, so that the second try has the right one."""


class BoardShots(ShotCapture):
    """Moves the arm and captures views of the board; used in the runner's thread only."""

    def take_shot(self, record: SessionRecord, step: TakeShot, stop: StopToken) -> None:
        """Moves to the step's pose and captures its view, with retakes at a better exposure time.

        Raises Halted, RigError capture.frame_rejected, calibration.target_not_seen, arm.move_failed, and what devices
        report.
        """
        recipe = _board_recipe(record)
        if not session.same_joints(self._rig.arm.reading.joints, step.waypoint.joints):
            self._follow(record, step.waypoint, stop)
        levels = [shot.quality.bright_level / shot.exposure_s for work in record.passes for shot in work.shots.values()]
        exposure_s, attempt = START_EXPOSURE_S, 0
        if levels or recipe.exposure.seconds is not None:
            exposure_s = exposure.for_level(levels[-1] if levels else 1.0, recipe.exposure, self._rig.cell.camera)
        while True:
            exposed, attempt = self._expose(record, step.key, exposure_s, attempt, stop)
            self._require_arm_at_light(exposed, step)
            verdict = check.lit_frame(
                exposed.frame.pixels, self._whole, self._calibration.sensor, exposure_s, recipe.exposure,
                self._rig.cell.camera,
            )  # fmt: skip
            if verdict.retake_s is None or attempt == recipe.retakes:
                break
            self._announce_retake(record, step.key, verdict.quality.reason)
            exposure_s, attempt = verdict.retake_s, attempt + 1
        name = f"View {step.key.number} of pass {step.key.pass_number}"
        if not verdict.usable:
            raise RigError(
                ErrorCode.CAPTURE_FRAME_REJECTED,
                f"{name}: {verdict.quality.reason} (the board is lit by the {recipe.lit_by})",
                light=step.key.number,
            )
        why = self._compute.run(stop, "look_at_board", exposed.frame.pixels, self.cell_of(record))
        if why and not _last_was_seen(record):
            raise RigError(ErrorCode.CALIBRATION_TARGET_NOT_SEEN, f"{name}: {why}", light=step.key.number)
        quality = FrameQuality(
            saturated=verdict.quality.saturated, bright_level=verdict.quality.bright_level, accepted=not why, reason=why
        )
        self._store_shot(record, step.key, exposed, exposure_s, attempt, quality)

    def repeat_reference(self, record: SessionRecord, step: RepeatReference, stop: StopToken) -> None:
        """Captures a view again and records it only if the board is where it was, to a fraction of a pixel.

        Raises Halted, RigError scene.moved, and what devices report.
        """
        first, here = step.shot, self._rig.arm.reading.joints
        self._return_to(record, first, here, stop)
        before = FolderFrames(self._store.folder(record.session_id)).rows(first.frame, 0, first.frame.height)
        exposed, attempt = self._expose(
            record, step.key, first.exposure_s, 0, stop, first.attempt + 1 + record.references
        )
        moved = self._compute.run(stop, "board_moved", before, exposed.frame.pixels, self.cell_of(record))
        if moved:
            detail = f"View {first.key.number} of pass {first.key.pass_number}, taken again: {moved}"
            if step.closes_pass:
                number = step.key.pass_number
                detail += f"; all views of pass {number} will be taken anew"
                self._store.journal.discard_shots(record.session_id, number, detail)
            raise RigError(ErrorCode.SCENE_MOVED, detail)
        self._store_shot(record, step.key, exposed, first.exposure_s, attempt, first.quality, repeats=first.key)

    def lit(self, record: SessionRecord, key: ShotKey) -> bool:
        """Whether the lamp is on during an image."""
        return _board_recipe(record).lit

    @property
    def _whole(self) -> BoolArray:
        return np.ones((self._calibration.height, self._calibration.width), dtype=bool)


def _board_recipe(record: SessionRecord) -> BoardRecipe:
    if not isinstance(record.recipe, BoardRecipe):
        raise RigError(ErrorCode.SERVICE_FAULT, f"A session of kind {record.recipe.kind} has no views of a board")
    return record.recipe


def _last_was_seen(record: SessionRecord) -> bool:
    """Whether the board was seen in the view that was captured last."""
    shots = [shot for work in record.passes for shot in work.shots.values()]
    return bool(shots) and max(shots, key=lambda shot: shot.taken_at).quality.accepted
