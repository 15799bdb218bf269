"""Capture of views of the calibration board, like images of an object but judged by the board's corners.

A view in which the board is not seen is kept and named, because a single pose may be unlucky (glare, a corner outside
the image). Two in a row, or the first view, pause the session: then something is wrong that a person has to look at.
"""

from collections.abc import Sequence

import numpy as np

from acquisition.capture import check, exposure
from acquisition.devices import StopToken
from acquisition.models.calibration_recipe import BoardRecipe, CheckRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.models.step import RepeatReference, TakeShot
from acquisition.runner.shots import JudgedAttempt, ShotCapture
from acquisition.session import PassRecord, SessionRecord

START_EXPOSURE_S = 0.01
"""Exposure time, s, of the first view. Levels are proportional to it, so the second try has the right one."""


class BoardShots(ShotCapture):
    """Moves the arm and captures views of the board; used in the runner's thread only."""

    def take_shot(self, record: SessionRecord, step: TakeShot, stop: StopToken) -> None:
        """Moves to the step's pose and captures its view, with retakes at a better exposure time.

        Raises Halted, RigError capture.frame_rejected, calibration.target_not_seen, arm.move_failed, and what devices
        report.
        """
        recipe = _board_recipe(record)
        self._go_to(record, step.waypoint, stop)
        levels = [shot.quality.bright_level / shot.exposure_s for work in record.passes for shot in work.shots.values()]
        exposure_s = exposure.in_range(START_EXPOSURE_S, self._rig.cell.camera)
        if levels or recipe.exposure.seconds is not None:
            exposure_s = exposure.for_level(levels[-1] if levels else 1.0, recipe.exposure, self._rig.cell.camera)

        def judge(pixels: np.ndarray, exposure_s: float) -> check.Verdict:
            return self._judge_whole(pixels, exposure_s, recipe.exposure)

        taken = self._expose_until_good(record, step, exposure_s, judge, stop)
        if not taken.verdict.usable:
            raise RigError(
                ErrorCode.CAPTURE_FRAME_REJECTED,
                f"{_name(step.key)}: {taken.verdict.quality.reason} (the board is lit by the {recipe.lit_by})",
                light=step.key.number,
            )
        why = self._compute.run(stop, "look_at_board", taken.exposed.frame.pixels, self.cell_of(record))
        self._require_seen(step.key, why, last_was_seen(record.passes))
        self._store_looked_at(record, step.key, taken, why)

    def repeat_reference(self, record: SessionRecord, step: RepeatReference, stop: StopToken) -> None:
        """Captures an image again and records it only if the target has not moved, to a fraction of a pixel.

        Raises Halted, RigError scene.moved, and what devices report.
        """
        first = step.shot
        self._return_to(record, first, self._rig.arm.reading.joints, stop)
        before = self._pixels_of(record, first)
        taken = self._expose(record, step.key, first.exposure_s, 0, stop, first.attempt + 1 + record.references)
        moved = self._target_moved(record, first, before, taken.pixels, stop)
        if moved:
            detail = f"{_name(first.key)}, taken again: {moved}"
            if step.closes_pass:
                number = step.key.pass_number
                detail += f"; all images of pass {number} will be taken again"
                self._store.journal.discard_shots(record.session_id, number, detail)
            raise RigError(ErrorCode.SCENE_MOVED, detail)
        self._store_shot(record, step.key, taken, first.quality, repeats=first.key)

    def lit(self, record: SessionRecord, key: ShotKey) -> bool:
        """Whether the lamp is on during an image."""
        return _board_recipe(record).lit

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _target_moved(
        self, record: SessionRecord, first: Shot, before: np.ndarray, after: np.ndarray, stop: StopToken
    ) -> str:
        """Returns for people how the target has moved between two frames (H, W) of one pose; empty if it has not."""
        return self._compute.run(stop, "board_moved", before, after, self.cell_of(record))

    def _judge_whole(self, pixels: np.ndarray, exposure_s: float, wanted: Exposure) -> check.Verdict:
        """Judges the exposure over the whole image, because the target may be anywhere in it."""
        whole = np.ones((self._calibration.height, self._calibration.width), dtype=bool)
        return check.lit_frame(pixels, whole, self._calibration.sensor, exposure_s, wanted, self._rig.cell.camera)

    @staticmethod
    def _require_seen(key: ShotKey, why: str, last_was_seen: bool) -> None:
        """Raises RigError calibration.target_not_seen unless the target is seen, or was seen in the image before."""
        if why and not last_was_seen:
            raise RigError(ErrorCode.CALIBRATION_TARGET_NOT_SEEN, f"{_name(key)}: {why}", light=key.number)

    def _store_looked_at(self, record: SessionRecord, key: ShotKey, taken: JudgedAttempt, why: str) -> None:
        """Stores an image; it is accepted unless `why` gives a reason why the target is not seen in it."""
        judged = taken.verdict.quality
        quality = FrameQuality(
            saturated=judged.saturated, bright_level=judged.bright_level, accepted=not why, reason=why
        )
        self._store_shot(record, key, taken, quality)


def last_was_seen(passes: Sequence[PassRecord]) -> bool:
    """Whether the target was seen in the newest image of these passes."""
    shots = [shot for work in passes for shot in work.shots.values()]
    return bool(shots) and max(shots, key=lambda shot: shot.taken_at).quality.accepted


def _name(key: ShotKey) -> str:
    return f"Image {key.number} of pass {key.pass_number}"


def _board_recipe(record: SessionRecord) -> BoardRecipe | CheckRecipe:
    if not isinstance(record.recipe, BoardRecipe | CheckRecipe):
        raise RigError(ErrorCode.SERVICE_FAULT, f"A session of kind {record.recipe.kind} takes no views of a board")
    return record.recipe
