"""Capture of images for the lamp's calibration: the highlight on the mirror sphere, the matt plane.

The exposure follows the part of the image that counts: the sphere's highlight covers some pixels of a dark image and
must not clip. As with the board, an image in which the target is not seen is kept and named, because a single pose may
be unlucky. Two in a row, or the first image of a pass, pause the session.
"""

import numpy as np

from acquisition.calibrate import lamp_targets
from acquisition.capture import check, exposure
from acquisition.devices import StopToken
from acquisition.models.calibration_recipe import CheckRecipe, LampRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure
from acquisition.models.rounding import percent
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.models.step import AwaitTarget, TakeShot
from acquisition.runner.board_shots import BoardShots, last_was_seen
from acquisition.session import SessionRecord

SPHERE_START_S = 1e-4
"""Exposure time, s, of the sphere's first image; a lamp's mirror image is hundreds of times as bright as paper."""

SPHERE_TARGET, SPHERE_LEAST, SPHERE_MOST = 0.6, 0.15, 0.95
"""Level of a highlight's brightest pixel, fraction of full scale: the target, and the range of accepted images."""


class LampShots(BoardShots):
    """Moves the arm and captures images of sphere and plane; used in the runner's thread only."""

    def await_target(self, record: SessionRecord, step: AwaitTarget) -> None:
        """Raises RigError calibration.place_target, which makes the session wait for a person."""
        number = step.pass_number - 1
        board = lamp_targets.plane_board(self._rig.cell)
        width, height = board.size_m
        raise RigError(
            ErrorCode.CALIBRATION_PLACE_TARGET,
            f"Clear the object's place and lay the matt plane there, face up (its frame of "
            f"{board.columns} × {board.rows} squares covers {1e3 * width:.0f} × {1e3 * height:.0f} mm)"
            + (", tilted by 10–20° on a wedge, differently from before" if number else ""),
            target="matt-plane",
            placing=number,
        )

    def take_shot(self, record: SessionRecord, step: TakeShot, stop: StopToken) -> None:
        """Moves to the step's pose and captures its image, with retakes at a better exposure time.

        Raises Halted, RigError capture.frame_rejected, calibration.target_not_seen, arm.move_failed, and what devices
        report.
        """
        recipe, sphere = _lamp_recipe(record), _shows_sphere(record, step.key.pass_number)
        self._go_to(record, step.waypoint, stop)

        def judge(pixels: np.ndarray, exposure_s: float) -> check.Verdict:
            if sphere:
                return self._judge_highlight(pixels, exposure_s)
            return self._judge_whole(pixels, exposure_s, recipe.exposure)

        taken = self._expose_until_good(record, step, self._start_s(record, step, sphere), judge, stop)
        known = (sphere, self.cell_of(record), self._calibration, self._placed_before(record, step))
        why = self._compute.run(stop, "look_at_target", taken.exposed, taken.exposure_s, *known)
        if why != lamp_targets.CLIPPED_HIGHLIGHT:
            # Checked first: without lamp or target no exposure time helps, and a person has to know that.
            self._require_seen(step.key, why, last_was_seen([record.passes[step.key.pass_number]]))
        if why == lamp_targets.CLIPPED_HIGHLIGHT or not taken.verdict.usable:
            detail = why or taken.verdict.quality.reason
            raise RigError(
                ErrorCode.CAPTURE_FRAME_REJECTED,
                f"Image {step.key.number} of pass {step.key.pass_number}, {1e3 * taken.exposure_s:.3g} ms: {detail}",
                light=step.key.number,
            )
        self._store_looked_at(record, step.key, taken, why)

    def lit(self, record: SessionRecord, key: ShotKey) -> bool:
        """Returns True: the lamp is what is calibrated, so it is on."""
        return True

    def _target_moved(
        self, record: SessionRecord, first: Shot, before: np.ndarray, after: np.ndarray, stop: StopToken
    ) -> str:
        """Returns for people how the target has moved between two frames (H, W) of one pose; empty if it has not."""
        sphere = _shows_sphere(record, first.key.pass_number)
        known = (sphere, self.cell_of(record), self._calibration.sensor)
        return self._compute.run(stop, "target_moved", before, after, *known)

    def _start_s(self, record: SessionRecord, step: TakeShot, sphere: bool) -> float:
        """Returns the exposure time, s, of a pose's first attempt."""
        work, camera = record.passes[step.key.pass_number], self._rig.cell.camera
        if not sphere:
            levels = work.plan.levels_per_s if work.plan is not None else None
            if levels is None:
                raise RigError(ErrorCode.SERVICE_FAULT, "The plan for the matt plane states no levels")
            return exposure.for_predicted_level(levels[step.key.number], _lamp_recipe(record).exposure, camera)
        seen = [shot.quality.bright_level / shot.exposure_s for shot in work.shots.values() if shot.quality.accepted]
        wanted = Exposure(target=SPHERE_TARGET)
        return exposure.in_range(SPHERE_START_S, camera) if not seen else exposure.for_level(seen[-1], wanted, camera)

    def _judge_highlight(self, pixels: np.ndarray, exposure_s: float) -> check.Verdict:
        """Judges the sphere's image by its brightest pixel. Hot pixels count as well; the next image shows this."""
        sensor, camera = self._calibration.sensor, self._rig.cell.camera
        level = (float(pixels.max()) - sensor.black_level_dn) / sensor.full_scale_dn
        clipped = float(np.mean(pixels >= 2**sensor.bits - 1))
        quality = FrameQuality(saturated=clipped, bright_level=level, accepted=True)
        if SPHERE_LEAST <= level <= SPHERE_MOST:
            return check.Verdict(quality, None)
        # A clipped highlight may be far brighter than its level.
        better = exposure.for_level(
            level / exposure_s, Exposure(target=SPHERE_TARGET / (3 if level > 1 else 1)), camera
        )
        side = "clipped" if level > SPHERE_MOST else "too dark"
        quality = quality.model_copy(
            update={"reason": f"the brightest pixel is at {percent(level, 0)} of full scale: {side}"}
        )
        too_long = level > SPHERE_MOST and better >= exposure_s
        too_short = level < SPHERE_LEAST and better <= exposure_s
        return check.Verdict(quality, None if too_long or too_short else better)

    def _placed_before(self, record: SessionRecord, step: TakeShot) -> np.ndarray | None:
        """Returns a frame (H, W) of the plane's previous placing at the first image of a further one; else None."""
        number = step.key.pass_number
        if number <= lamp_targets.SPHERE_PASS + 1 or record.passes[number].shots:
            return None
        earlier = next(iter(record.passes[number - 1].shots.values()), None)
        return None if earlier is None else self._pixels_of(record, earlier)


def _shows_sphere(record: SessionRecord, pass_number: int) -> bool:
    return isinstance(record.recipe, LampRecipe) and pass_number == lamp_targets.SPHERE_PASS


def _lamp_recipe(record: SessionRecord) -> LampRecipe | CheckRecipe:
    if not isinstance(record.recipe, LampRecipe | CheckRecipe):
        raise RigError(ErrorCode.SERVICE_FAULT, f"A session of kind {record.recipe.kind} does not calibrate a lamp")
    return record.recipe
