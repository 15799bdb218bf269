"""Doing one step of a session and entering what came of it.

Every step ends in the same order: files flushed and renamed, then row and event in one transaction. A step that is cut
off before the row leaves files that nobody was told of; doing it again replaces them.
"""

import shutil
import threading
import time
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, assert_never

import numpy as np

from acquisition import lamp_pose, region, results, session
from acquisition.capture import check, compare, expected, exposure, take
from acquisition.capture.take import Exposed
from acquisition.compute import Compute
from acquisition.devices import Rig, StopToken
from acquisition.errors import ErrorCode, RigError
from acquisition.frames import FolderFrames
from acquisition.measured import Calibration, FrameQuality, ResultSummary, Shot, ShotKey, SolveSettings
from acquisition.results import Wish
from acquisition.session import (
    AwaitReview,
    ChooseLights,
    GoHome,
    PlanRoute,
    Record,
    RepeatReference,
    SolveNormals,
    Step,
    TakeDark,
    TakeShot,
)
from acquisition.store import Store
from acquisition.store.folder import write_bytes, write_frame, write_manifest, write_value
from acquisition.types import BoolArray, JointPath, LightPlan, Recipe, Route, Waypoint, as_joints, as_matrix4


class Steps:
    """Does steps with the devices of one rig; the runner's thread only."""

    def __init__(self, store: Store, rig: Rig, calibration: Calibration, compute: Compute) -> None:
        self._store = store
        self._rig = rig
        self._calibration = calibration
        self._compute = compute

    def begin(self, session_id: str, recipe: Recipe) -> None:
        """Makes the session's folder, complete in itself: recipe, cell file and calibration."""
        folder = self._store.folder(session_id)
        write_value(folder / "recipe.json", recipe)
        write_value(folder / "cell.json", self._rig.cell)
        write_value(folder / "calibration.json", self._calibration)

    def end(self, session_id: str) -> None:
        """Writes the session's manifest: every file with its SHA-256, and the shots as they were measured."""
        folder = self._store.folder(session_id)
        shots = [shot.model_dump(mode="json") for shot in self._store.journal.shots(session_id)]
        write_manifest(
            folder, {"session_id": session_id, "software": {"lightpose": version("lightpose")}, "shots": shots}
        )

    def do(self, record: Record, step: Step, stop: StopToken) -> None:
        """Does one step. Raises Halted when the token is set meanwhile, RigError when the step fails."""
        match step:
            case ChooseLights():
                self._choose_lights(record, step, stop)
            case AwaitReview():
                raise RigError(ErrorCode.PLAN_TO_REVIEW, f"The lights of pass {step.pass_number} are planned")
            case RepeatReference():
                self._repeat_reference(record, step, stop)
            case PlanRoute():
                self._plan_route(record, step, stop)
            case TakeShot():
                self._take_shot(record, step, stop)
            case GoHome():
                self._go_home(record, step, stop)
            case TakeDark():
                self._take_dark(record, step, stop)
            case SolveNormals():
                self._solve_normals(record, step, stop)
            case _:
                assert_never(step)

    @property
    def reach_cache(self) -> Path:
        """Where the cell's reach is kept."""
        return self._store.cache(f"reach-{self._rig.cell.fingerprint[:16]}.json")

    @cached_property
    def _region(self) -> BoolArray:
        return region.keep_out(self._rig.cell, self._calibration)

    # ---------------------------------------------------------------------------------------------------- lights, route

    def _choose_lights(self, record: Record, step: ChooseLights, stop: StopToken) -> None:
        number, folder = step.pass_number, self._store.folder(record.session_id)
        known = (record.recipe, self._rig.cell, self._calibration, self.reach_cache)
        pictures: list[bytes] = []
        if number == 0:
            plan: LightPlan = self._compute.run(stop, "first_lights", *known)
        else:
            previous = folder / "results" / str(number - 1)
            taken, drawn = results.observations(record, folder), self._drawn(record.session_id)
            plan, pictures = self._compute.run(stop, "further_lights", *known, previous, taken, drawn)
        digests = [
            write_bytes(folder / f"passes/{number}/gain_{light}.png", picture) for light, picture in enumerate(pictures)
        ]
        self.foretell(record.session_id, number, plan, stop)
        name = f"passes/{number}/plan.json"
        digest = write_value(folder / name, plan)
        body = self.told(plan, digests)
        self._store.journal.add_artifact(record.session_id, "plan", number, name, digest, body, "plan.ready")

    @staticmethod
    def told(plan: LightPlan, pictures: list[str]) -> dict[str, Any]:
        """What the journal tells of a plan beside its file; `pictures` are the SHA-256 of what each light gains."""
        return {
            "lights": len(plan.lights),
            "method": plan.method,
            "predicted_sigma_deg": plan.predicted_sigma_deg,
            "predicted_median_deg": plan.predicted_median_deg,
            "notes": plan.notes,
            "conclusion": plan.conclusion,
            "pictures": pictures,
        }

    def _drawn(self, session_id: str) -> Path | None:
        """The mask of the region of interest, where one was drawn."""
        masks = self._store.journal.artifacts(session_id, "region")
        return self._store.folder(session_id) / masks[-1].path if masks else None

    def draw(self, session_id: str, content: bytes, actor: str) -> int:
        """Keeps a mask (PNG) as the session's region of interest and returns its number of pixels.

        Raises RigError request.invalid, session.action_not_allowed, session.not_found.
        """
        self._store.journal.may_draw(session_id)
        mask = region.decoded(content, self._calibration)
        if not np.any(mask & self._region):
            raise RigError(
                ErrorCode.REQUEST_INVALID, "the mask lies outside of where the object can be: draw it on the object"
            )
        made = len(self._store.journal.artifacts(session_id, "region"))
        name = "region.png" if made == 0 else f"region_{made + 1}.png"
        digest = write_bytes(self._store.folder(session_id) / name, region.encoded(mask))
        pixels = int(np.count_nonzero(mask))
        self._store.journal.add_region(session_id, name, digest, {"pixels": pixels}, actor)
        return pixels

    def _plan_route(self, record: Record, step: PlanRoute, stop: StopToken) -> None:
        number, folder = step.pass_number, self._store.folder(record.session_id)
        plan = record.passes[number].plan
        if plan is None:
            raise RigError(ErrorCode.SERVICE_FAULT, f"Pass {number} has no plan to route")
        start = self._rig.arm.reading.joints
        route = self._rejoined(record.passes[number].route, step, stop)
        if route is None:
            lights = [plan.lights[light] for light in step.light_numbers]
            try:
                route = self._compute.run(stop, "plan_route", lights, start, self._rig.cell, self._calibration)
            except RigError as error:
                raise _renumbered(error, step.light_numbers) from error
            order = [step.light_numbers[index] for index in route.light_numbers]
            route = route.model_copy(update={"light_numbers": order})
        made = [item for item in self._store.journal.artifacts(record.session_id, "route") if item.number == number]
        name = f"passes/{number}/route.json" if not made else f"passes/{number}/route_{len(made) + 1}.json"
        digest = write_value(folder / name, route)
        body = {"seconds": route.seconds, "lower_bound_s": route.lower_bound_s, "order": route.light_numbers}
        self._store.journal.add_artifact(record.session_id, "route", number, name, digest, body, "waypoints.ready")

    def _rejoined(self, route: Route | None, step: PlanRoute, stop: StopToken) -> Route | None:
        """The way back to the route that the arm has left; None when there is none, and a new route is needed."""
        if route is None or not set(step.light_numbers) <= set(route.light_numbers):
            return None
        start = self._rig.arm.reading.joints
        known = (self._rig.cell, self._calibration)
        try:
            return self._compute.run(stop, "rejoin_route", route, step.light_numbers, start, *known)
        except RigError as error:
            if error.code is not ErrorCode.WAYPOINTS_COLLISION:
                raise
            return None

    # ---------------------------------------------------------------------------------------------------------- capture

    def _take_shot(self, record: Record, step: TakeShot, stop: StopToken) -> None:
        if not session.same_place(self._rig.arm.reading.joints, step.waypoint.joints):
            self._go(record, step.waypoint, stop)
        exposure_s, attempt = self._first_exposure(record, step), 0
        while True:
            try:
                exposed = take.expose(self._rig, exposure_s, attempt, lit=True, stop=stop)
            except RigError as error:
                if error.code is not ErrorCode.CAMERA_TIMEOUT or attempt == record.recipe.retakes:
                    raise
                self._tell_retake(record, step.key, error.detail)
                attempt += 1
                continue
            self._require_place(exposed, step)
            verdict = check.lit_frame(
                exposed.frame.pixels,
                self._region,
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

    def _against_earlier(
        self, record: Record, step: TakeShot, exposed: Exposed, exposure_s: float, quality: FrameQuality
    ) -> check.Verdict:
        number, light = step.key.pass_number, step.key.number
        taken = [shot.quality.sharpness for work in record.passes for shot in work.shots.values()]
        file = self._foretold(record.session_id, number, light)
        return check.against_earlier(
            quality,
            exposed.frame.pixels,
            self._region,
            self._calibration.sensor,
            exposure_s,
            [sharpness for sharpness in taken if sharpness is not None],
            expected.decoded(file.read_bytes()) if file.exists() else None,
        )

    def _foretold(self, session_id: str, number: int, light: int) -> Path:
        """The picture that the present plan of a pass foretells for a light; the first pass has none."""
        plans = [item for item in self._store.journal.artifacts(session_id, "plan") if item.number == number]
        return self._store.folder(session_id) / f"passes/{number}/foretold_{len(plans)}_{light}.png"

    def foretell(self, session_id: str, number: int, plan: LightPlan, stop: threading.Event) -> None:
        """Keeps what the result before a pass foretells for each light of its plan, which is entered afterwards."""
        if plan.levels_per_s is None:
            return
        folder = self._store.folder(session_id)
        pictures = self._compute.run(
            stop, "foretell", plan.lights, self._calibration, folder / "results" / str(number - 1)
        )
        made = sum(item.number == number for item in self._store.journal.artifacts(session_id, "plan"))
        for light, picture in enumerate(pictures):
            write_bytes(folder / f"passes/{number}/foretold_{made + 1}_{light}.png", picture)

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
            return exposure.of_level(work.plan.levels_per_s[step.key.number], wanted, camera)
        seen = [shot.quality.bright_level / shot.exposure_s for shot in work.shots.values()]
        level = seen[-1] if seen else exposure.first_level(self._rig.cell, self._calibration)
        return exposure.of_level(level, wanted, camera)

    def _take_dark(self, record: Record, step: TakeDark, stop: StopToken) -> None:
        exposed = take.expose(self._rig, step.exposure_s, 0, lit=False, stop=stop)
        quality = check.dark_frame(exposed.frame.pixels, self._region, self._calibration.sensor)
        if not quality.accepted:
            raise RigError(ErrorCode.CAPTURE_FRAME_REJECTED, quality.reason)
        self._keep(record, step.key, exposed, step.exposure_s, 0, quality, kind="dark")

    def _keep(
        self, record: Record, key: ShotKey, exposed: Exposed, exposure_s: float, attempt: int, quality: FrameQuality,
        *, kind: Literal["light", "dark", "reference"] = "light",
    ) -> None:  # fmt: skip
        """Writes the frame, then enters it: the entry is the announcement."""
        names = {"dark": f"dark_{round(exposure_s * 1e6)}.tiff", "reference": f"references/{key.number}.tiff"}
        file, dark = names.get(kind, f"shots/{key.number}.tiff"), kind == "dark"
        folder, reading = self._store.folder(record.session_id), exposed.reading
        frame = write_frame(folder, f"passes/{key.pass_number}/{file}", exposed.frame.pixels)
        shot = Shot(
            key=key,
            kind=kind,
            frame=frame,
            exposure_s=exposure_s,
            light_number=key.number if kind == "light" else None,
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

    def _repeat_reference(self, record: Record, step: RepeatReference, stop: StopToken) -> None:
        """Sees that object, camera, lamp and arm are as they were; only then is the image entered."""
        first, here = step.shot, self._rig.arm.reading.joints
        if first.joints is None:
            raise RigError(ErrorCode.SERVICE_FAULT, f"The image {first.key} does not say where the arm was")
        if not session.same_place(here, first.joints):
            known = (self._rig.cell, self._calibration)
            self._go(record, self._compute.run(stop, "plan_return", here, first.joints, *known), stop)
        exposed = take.expose(self._rig, first.exposure_s, first.attempt, lit=True, stop=stop)
        frames = FolderFrames(self._store.folder(record.session_id))
        before = frames.rows(first.frame, 0, first.frame.height)
        same = compare.same_scene(before, exposed.frame.pixels, self._region, self._calibration.sensor)
        if not same.accepted:
            raise RigError(
                ErrorCode.SCENE_MOVED,
                f"Image {first.key.number} of pass {first.key.pass_number}, taken again, {same.detail}",
                shift_px=same.shift_px,
                brightness=same.brightness,
                changed=same.changed,
            )
        self._keep(record, step.key, exposed, first.exposure_s, first.attempt, first.quality, kind="reference")

    def _go(self, record: Record, way: JointPath | Waypoint, stop: StopToken) -> None:
        """Follows a certified way, once the journal knows where the arm is sent."""
        here = self._rig.arm.reading.joints
        self._store.journal.sent(record.session_id, [here, *way.path])
        take.arrive(self._rig, way.path, way.speeds, stop)

    def _go_home(self, record: Record, step: GoHome, stop: StopToken) -> None:
        here, route = self._rig.arm.reading.joints, step.route
        if route is not None and route.waypoints and session.same_place(here, route.waypoints[-1].joints):
            self._go(record, JointPath(path=route.home_path, speeds=route.home_speeds, seconds=0.0), stop)
            return
        way: JointPath = self._compute.run(stop, "plan_retreat", here, self._rig.cell, self._calibration)
        self._go(record, way, stop)

    # ---------------------------------------------------------------------------------------------------------- normals

    def _solve_normals(self, record: Record, step: SolveNormals, stop: StopToken) -> None:
        folder = self._store.folder(record.session_id)
        name = f"results/{step.number}"
        if (folder / name).exists():
            shutil.rmtree(folder / name)  # left by a crash before its entry: nobody was told of it
        observations = results.observations(record, folder)
        settings = SolveSettings()
        begun = time.monotonic()
        summary: ResultSummary = self._compute.run(
            stop,
            "solve_normals",
            observations,
            self._rig.cell,
            self._calibration,
            settings,
            record.passes[step.number].plan,
            self._drawn(record.session_id),
            folder / name,
        )
        seconds = time.monotonic() - begun
        wish = Wish(record.session_id, step.number, settings, step.number)
        results.enter(self._store, wish, "session", summary, seconds, self._rig.cell)


def _renumbered(error: RigError, light_numbers: tuple[int, ...]) -> RigError:
    """The route knew only the lights that were left; people know them by their numbers in the plan."""
    lights = [{**light, "number": light_numbers[light["number"]]} for light in error.context.get("lights", [])]
    if not lights:
        return error
    detail = "; ".join(f"light {light['number']}: {light['reason']}: {light['detail']}" for light in lights)
    return RigError(error.code, detail, **{**error.context, "lights": lights})
