"""Capture for a calibration of the camera's response: the arm rests at one light, exposure time and lamp change.

Exposure times follow from the first recorded image, so that they stay the same however often the session is
interrupted. Before that image, frames are taken that only measure the level and are not kept.
"""

from dataclasses import replace

from acquisition.capture import check, exposure
from acquisition.devices import StopToken
from acquisition.models.calibration_recipe import FrameSetting, ResponseRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.models.step import RepeatReference, TakeShot
from acquisition.runner.shots import ShotCapture
from acquisition.session import FIRST_REFERENCE_NUMBER, SessionRecord

METERING_FRAMES = 12
"""Largest number of frames that measure the level; each at least halves or doubles the exposure time."""


class ResponseShots(ShotCapture):
    """Captures images of one scene at many exposure times; used in the runner's thread only."""

    def take_shot(self, record: SessionRecord, step: TakeShot, stop: StopToken) -> None:
        """Captures one image, with the lamp or without.

        Raises Halted, RigError capture.frame_rejected for an image without light, arm.move_failed, and what devices
        report.
        """
        self._go_to(record, step.waypoint, stop)
        setting = _setting(record)
        exposure_s = self._exposure(record, step.key, setting, stop)
        # In a simulated cell, too, each frame of one exposure time has its own noise.
        taken = self._expose(record, step.key, exposure_s, 0, stop, 1 + step.key.number)
        self._require_arm_at_light(taken.exposed, step)
        verdict = check.lit_frame(
            taken.pixels, self.region, self._calibration.sensor, exposure_s, _recipe(record).exposure,
            self._rig.cell.camera,
        )  # fmt: skip
        if setting.lit and not verdict.usable and verdict.quality.saturated == 0:
            raise RigError(
                ErrorCode.CAPTURE_FRAME_REJECTED, f"Image {step.key.number}: {verdict.quality.reason}",
                light=step.key.number,
            )  # fmt: skip
        quality = FrameQuality(
            saturated=verdict.quality.saturated, bright_level=verdict.quality.bright_level, accepted=True
        )
        self._store_shot(record, step.key, taken, quality)

    def repeat_reference(self, record: SessionRecord, step: RepeatReference, stop: StopToken) -> None:
        """Captures the first image again, since others are without light or clipped; all were taken at one pose.

        Raises Halted, RigError scene.moved, and what devices report.
        """
        super().repeat_reference(record, replace(step, shot=_captured(record)[0]), stop)

    def lit(self, record: SessionRecord, key: ShotKey) -> bool:
        """Whether the lamp is on during an image."""
        return key.number >= FIRST_REFERENCE_NUMBER or _setting(record).lit

    def _exposure(self, record: SessionRecord, key: ShotKey, setting: FrameSetting, stop: StopToken) -> float:
        """Returns the exposure time, s, for the setting's share of full scale in the brightest parts, within limits."""
        captured = _captured(record)
        if captured:
            full_s = captured[0].exposure_s / _recipe(record).frames[0].share
        else:
            full_s = 1 / self._measured_level(record, key, stop)
        return exposure.in_range(round(full_s * setting.share, 6), self._rig.cell.camera)

    def _measured_level(self, record: SessionRecord, key: ShotKey, stop: StopToken) -> float:
        """Measures the level of the brightest parts, lamp on, full scales per second, by frames that are not kept."""
        recipe, camera = _recipe(record), self._rig.cell.camera
        wanted = recipe.exposure
        exposure_s = exposure.for_level(exposure.assumed_level(self._rig.cell, self._calibration), wanted, camera)
        metering = key.model_copy(update={"number": FIRST_REFERENCE_NUMBER})
        for attempt in range(METERING_FRAMES):
            pixels = self._expose(record, metering, exposure_s, attempt, stop).pixels
            verdict = check.lit_frame(pixels, self.region, self._calibration.sensor, exposure_s, wanted, camera)
            if verdict.retake_s is not None and attempt < METERING_FRAMES - 1:
                exposure_s = verdict.retake_s
            elif verdict.usable:
                return verdict.quality.bright_level / exposure_s
            else:
                raise RigError(
                    ErrorCode.CAPTURE_FRAME_REJECTED, f"Measuring the light: {verdict.quality.reason}", light=0
                )
        raise AssertionError("the last frame ends the loop")


def _captured(record: SessionRecord) -> list[Shot]:
    """Returns the images so far, in the order of capture."""
    return sorted((shot for work in record.passes for shot in work.shots.values()), key=lambda shot: shot.taken_at)


def _setting(record: SessionRecord) -> FrameSetting:
    """Returns the next image's setting by the order of capture, so that the first is well exposed on any route."""
    return _recipe(record).frames[len(_captured(record))]


def _recipe(record: SessionRecord) -> ResponseRecipe:
    if not isinstance(record.recipe, ResponseRecipe):
        raise RigError(
            ErrorCode.SERVICE_FAULT, f"A session of kind {record.recipe.kind} does not measure the sensor's response"
        )
    return record.recipe
