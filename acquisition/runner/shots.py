"""Taking a session's images: go there, expose, judge by what was seen before, and only then enter.

All images of a session must show one scene. From the second pass on each frame is judged against the picture that the
result before foretells, but nothing foretells the first pass, and some frames tell no shift. So a pass with an image
that was not judged in this way ends with the session's first image taken again, under the same light: when it shows the
same, nothing has moved in between; when it does not, nobody knows since when, and all images of the pass are discarded
and taken anew once a person has looked.
"""

from functools import cached_property
from pathlib import Path
from typing import Literal

from acquisition import lamp_pose, session
from acquisition.capture import check, compare, expected, exposure, region, take
from acquisition.capture.take import Exposed
from acquisition.devices import Rig, StopToken
from acquisition.formats.frames import FolderFrames
from acquisition.models.base import BoolArray, as_joints, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import JointPath, Waypoint
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.runner.compute import Compute
from acquisition.session import GoHome, Record, RepeatReference, TakeDark, TakeShot
from acquisition.store import Store
from acquisition.store.folder import write_frame


class Shooting:
    """Moves the arm and takes images; the runner's thread only."""

    def __init__(self, store: Store, rig: Rig, calibration: Calibration, compute: Compute) -> None:
        self._store = store
        self._rig = rig
        self._calibration = calibration
        self._compute = compute

    @cached_property
    def region(self) -> BoolArray:
        """The pixels (H, W) where the object can be."""
        return region.keep_out(self._rig.cell, self._calibration)

    def take_shot(self, record: Record, step: TakeShot, stop: StopToken) -> None:
        """Moves along the step's waypoint and takes its image, again with another exposure time where that is better.

        Raises Halted, RigError capture.frame_rejected, scene.moved, arm.move_failed, and what devices report.
        """
        if not session.same_place(self._rig.arm.reading.joints, step.waypoint.joints):
            self._go(record, step.waypoint, stop)
        exposure_s, attempt = self._first_exposure(record, step), 0
        while True:
            exposed, attempt = self._expose(record, step.key, exposure_s, attempt, stop)
            self._require_place(exposed, step)
            verdict = check.lit_frame(
                exposed.frame.pixels,
                self.region,
                self._calibration.sensor,
                exposure_s,
                record.recipe.exposure,
                self._rig.cell.camera,
            )
            if verdict.retake_s is None and verdict.usable:
                verdict = self._against_earlier(record, step, exposed, exposure_s, verdict.quality)
            if verdict.retake_s is None or attempt == record.recipe.retakes:
                break
            self._tell_retake(record, step.key, verdict.quality.reason)
            exposure_s, attempt = verdict.retake_s, attempt + 1
        if not verdict.usable:
            raise RigError(
                ErrorCode.SCENE_MOVED if verdict.moved else ErrorCode.CAPTURE_FRAME_REJECTED,
                f"Light {step.key.number} of pass {step.key.pass_number}: {verdict.quality.reason}",
                light=step.key.number,
            )
        self._keep(record, step.key, exposed, exposure_s, attempt, verdict.quality)

    def take_dark(self, record: Record, step: TakeDark, stop: StopToken) -> None:
        """Takes a lamp-off frame. Raises Halted, RigError capture.frame_rejected, and what devices report."""
        # Each pass's has noise of its own in a simulated cell too.
        exposed = take.expose(self._rig, step.exposure_s, step.key.pass_number, lit=False, stop=stop)
        quality = check.dark_frame(exposed.frame.pixels, self.region, self._calibration.sensor)
        if not quality.accepted:
            raise RigError(ErrorCode.CAPTURE_FRAME_REJECTED, quality.reason)
        self._keep(record, step.key, exposed, step.exposure_s, 0, quality, kind="dark")

    def repeat_reference(self, record: Record, step: RepeatReference, stop: StopToken) -> None:
        """Sees that object, camera, lamp and arm are as they were; only then is the image entered.

        Raises Halted, RigError scene.moved, and what devices report.
        """
        first, here, retakes = step.shot, self._rig.arm.reading.joints, record.recipe.retakes
        if first.joints is None:
            raise RigError(ErrorCode.SERVICE_FAULT, f"The image {first.key} does not say where the arm was")
        if not session.same_place(here, first.joints):
            known = (self._rig.cell, self._calibration)
            self._go(record, self._compute.run(stop, "plan_return", here, first.joints, *known), stop)
        frames = FolderFrames(self._store.folder(record.session_id))
        before = frames.rows(first.frame, 0, first.frame.height)
        attempt = 0
        while True:
            # Noise differs from one attempt to the next in a simulated cell too, and no two images have the same.
            before_this = first.attempt + 1 + record.references
            exposed, attempt = self._expose(record, step.key, first.exposure_s, attempt, stop, before_this)
            same = compare.same_scene(before, exposed.frame.pixels, self.region, self._calibration.sensor)
            if same.accepted or attempt == retakes:
                break
            self._tell_retake(record, step.key, same.detail)
            attempt += 1
        if not same.accepted:
            raise self._moved(record, step, same)
        self._keep(record, step.key, exposed, first.exposure_s, attempt, first.quality, repeats=first.key)

    def go_home(self, record: Record, step: GoHome, stop: StopToken) -> None:
        """Follows the route's own way home from its end, a new one from elsewhere."""
        here, route = self._rig.arm.reading.joints, step.route
        if route is not None and route.waypoints and session.same_place(here, route.waypoints[-1].joints):
            self._go(record, JointPath(path=route.home_path, speeds=route.home_speeds, seconds=0.0), stop)
            return
        way: JointPath = self._compute.run(stop, "plan_retreat", here, self._rig.cell, self._calibration)
        self._go(record, way, stop)

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _go(self, record: Record, way: JointPath | Waypoint, stop: StopToken) -> None:
        """Follows a certified way, once the journal knows where the arm is sent."""
        here = self._rig.arm.reading.joints
        self._store.journal.sent(record.session_id, [here, *way.path])
        take.arrive(self._rig, way.path, way.speeds, stop)

    def _expose(
        self, record: Record, key: ShotKey, exposure_s: float, attempt: int, stop: StopToken, attempts_before: int = 0
    ) -> tuple[Exposed, int]:
        """A lit frame, taken again as often as the recipe allows when the camera loses it, and the attempt it took."""
        while True:
            try:
                return take.expose(self._rig, exposure_s, attempts_before + attempt, lit=True, stop=stop), attempt
            except RigError as error:
                if error.code is not ErrorCode.CAMERA_TIMEOUT or attempt == record.recipe.retakes:
                    raise
                self._tell_retake(record, key, error.detail)
                attempt += 1

    def _against_earlier(
        self, record: Record, step: TakeShot, exposed: Exposed, exposure_s: float, quality: FrameQuality
    ) -> check.Verdict:
        number, light = step.key.pass_number, step.key.number
        taken = [shot.quality.sharpness for work in record.passes for shot in work.shots.values()]
        plans = self._store.journal.plans_made(record.session_id, number)
        file = foretold_file(self._store.folder(record.session_id), number, plans, light)
        return check.against_earlier(
            quality,
            exposed.frame.pixels,
            self.region,
            self._calibration.sensor,
            exposure_s,
            [sharpness for sharpness in taken if sharpness is not None],
            expected.decoded(file.read_bytes()) if file.exists() else None,
        )

    def _moved(self, record: Record, step: RepeatReference, same: compare.Comparison) -> RigError:
        """What an image that does not show the same means; discards what was taken of a scene that is no more."""
        first, number = step.shot.key, step.key.pass_number
        detail = f"Image {first.number} of pass {first.pass_number}, taken again, {same.detail}"
        if step.closes_pass:
            detail += f"; all images of pass {number} will be taken anew"
            self._store.journal.discard_shots(record.session_id, number, detail)
        return RigError(
            ErrorCode.SCENE_MOVED, detail, shift_px=same.shift_px, brightness=same.brightness, changed=same.changed
        )

    def _tell_retake(self, record: Record, key: ShotKey, reason: str) -> None:
        body = {"pass": key.pass_number, "number": key.number, "reason": reason}
        self._store.journal.announce(record.session_id, "shot.retaken", body)

    def _require_place(self, exposed: Exposed, step: TakeShot) -> None:
        """An arm that stands elsewhere was moved by somebody: a person looks before it moves again."""
        if not session.same_place(exposed.reading.joints, step.waypoint.joints):
            raise RigError(
                ErrorCode.ARM_MOVE_FAILED, f"The arm was not at light {step.key.number} while its frame was exposed"
            )

    def _first_exposure(self, record: Record, step: TakeShot) -> float:
        wanted, camera = record.recipe.exposure, self._rig.cell.camera
        work = record.passes[step.key.pass_number]
        if work.plan is not None and work.plan.levels_per_s is not None:
            return exposure.of_foretold(work.plan.levels_per_s[step.key.number], wanted, camera)
        seen = [shot.quality.bright_level / shot.exposure_s for shot in work.shots.values()]
        level = seen[-1] if seen else exposure.first_level(self._rig.cell, self._calibration)
        return exposure.of_level(level, wanted, camera)

    def _keep(
        self, record: Record, key: ShotKey, exposed: Exposed, exposure_s: float, attempt: int, quality: FrameQuality,
        *, kind: Literal["light", "dark"] = "light", repeats: ShotKey | None = None,
    ) -> None:  # fmt: skip
        """Writes the frame, then enters it: the entry is the announcement."""
        file, dark = f"shots/{key.number}.tiff", kind == "dark"
        if dark:
            file = f"dark_{round(exposure_s * 1e6)}.tiff"
        elif repeats is not None:
            file = f"references/{key.number}.tiff"
        folder, reading = self._store.folder(record.session_id), exposed.reading
        frame = write_frame(folder, f"passes/{key.pass_number}/{file}", exposed.frame.pixels)
        shot = Shot(
            key=key,
            kind=kind if repeats is None else "reference",
            repeats=repeats,
            frame=frame,
            exposure_s=exposure_s,
            light_number=key.number if kind == "light" and repeats is None else None,
            light=None if dark else lamp_pose.light_from_tool(reading.base_from_tool, self._calibration),
            joints=as_joints(reading.joints),
            base_from_tool=as_matrix4(reading.base_from_tool),
            lamp_on=not dark,
            attempt=attempt,
            arm_time_s=reading.timestamp,
            taken_at=exposed.frame.taken_at,
            quality=quality,
        )
        self._store.journal.add_shot(record.session_id, shot)


def foretold_file(folder: Path, pass_number: int, plan: int, light: int) -> Path:
    """The picture that a pass's plan of this number (from 1) foretells for a light; the first pass has none."""
    return folder / f"passes/{pass_number}/foretold_{plan}_{light}.png"
