"""Execution of one step of a session, and the record of its outcome.

Every step commits in the same order: files are flushed and renamed, then row and event are written in one transaction.
A step that ends before the transaction leaves files without an entry; repeating the step replaces them, so steps are
idempotent.
"""

import threading
from importlib.metadata import version
from pathlib import Path
from typing import Any, assert_never

import numpy as np

from acquisition import session
from acquisition.capture import region
from acquisition.devices import Rig, StopToken
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import CheckRecipe, LampRecipe, ResponseRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.listing import refused_lights
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.models.route import Route
from acquisition.models.step import (
    AwaitReview,
    AwaitTarget,
    ChooseLights,
    GoHome,
    PlanRoute,
    RepeatReference,
    SolveNormals,
    Step,
    TakeDark,
    TakeFurther,
    TakeScan,
    TakeShot,
)
from acquisition.runner import calibration_checks, estimates, results
from acquisition.runner.board_shots import BoardShots
from acquisition.runner.compute import Compute
from acquisition.runner.lamp_shots import LampShots
from acquisition.runner.moving_shots import MovingShotCapture
from acquisition.runner.response_shots import ResponseShots
from acquisition.runner.rig_choices import RigChoices
from acquisition.runner.shots import ShotCapture, predicted_image_file
from acquisition.runner.solve_requests import SolveRequest
from acquisition.session import SessionRecord
from acquisition.store import Store
from acquisition.store.folder import refusals, write_bytes, write_manifest, write_value


class StepExecutor:
    """Executes steps with the devices of one rig; used in the runner's thread only, except `set_region`."""

    def __init__(self, store: Store, rig: Rig, choices: RigChoices, compute: Compute) -> None:
        self._store = store
        self._rig = rig
        self._choices = choices
        self._compute = compute
        self._shots = MovingShotCapture(store, rig, choices, compute)
        self._board_shots = BoardShots(store, rig, choices, compute)
        self._lamp_shots = LampShots(store, rig, choices, compute)
        self._response_shots = ResponseShots(store, rig, choices, compute)
        self._drawing = threading.Lock()

    @property
    def _calibration(self) -> Calibration:
        return self._choices.calibration

    def write_session_manifest(self, session_id: str) -> None:
        """Writes the session's manifest: every file with its SHA-256, the shots with their measurements, and the
        checks of the calibration."""
        folder = self._store.folder(session_id)
        shots = [shot.model_dump(mode="json") for shot in self._store.journal.shots(session_id)]
        facts: dict[str, object] = {
            "session_id": session_id,
            "software": {"lightpose": version("lightpose")},
            "calibration_check": calibration_checks.state(self._store, self._calibration.fingerprint).model_dump(
                mode="json"
            ),
            "shots": shots,
        }
        write_manifest(folder, facts)

    def keep_calibration(self, record: SessionRecord) -> None:
        """Keeps the estimate of a calibration session; does nothing for a session of kind capture."""
        if not isinstance(record.recipe, Recipe):
            estimates.keep(self._store, record, self._rig.cell, self._choices.calibration_folder)

    def execute(self, record: SessionRecord, step: Step, stop: StopToken) -> None:
        """Executes one step. Raises Halted when the token is set meanwhile, RigError when the step fails."""
        shots = self._shots_of(record)
        match step:
            case ChooseLights():
                self._choose_lights(record, step, stop)
            case AwaitReview():
                raise RigError(ErrorCode.PLAN_TO_REVIEW, f"The lights of pass {step.pass_number} are planned")
            case AwaitTarget():
                self._lamp_shots.await_target(record, step)
            case RepeatReference():
                shots.repeat_reference(record, step, stop)
            case PlanRoute():
                self._plan_route(record, step, stop)
            case TakeShot():
                shots.take_shot(record, step, stop)
            case TakeScan():
                self._shots.take_scan(record, step, stop)
            case TakeFurther():
                shots.take_further(record, step, stop)
            case GoHome():
                shots.go_home(record, step, stop)
            case TakeDark():
                shots.take_dark(record, step, stop)
            case SolveNormals():
                self._solve_normals(record, step, stop)
            case _:
                assert_never(step)

    def _shots_of(self, record: SessionRecord) -> ShotCapture:
        """Returns the object that captures and judges a session's images."""
        if isinstance(record.recipe, Recipe):
            return self._shots
        if isinstance(record.recipe, ResponseRecipe):
            return self._response_shots
        if isinstance(record.recipe, CheckRecipe):
            return self._lamp_shots if record.recipe.target == "plane" else self._board_shots
        return self._lamp_shots if isinstance(record.recipe, LampRecipe) else self._board_shots

    @property
    def reach_cache(self) -> Path:
        """Cache file of the cell's reach with the calibration in use."""
        return self.reach_cache_of(self._calibration)

    def reach_cache_of(self, calibration: Calibration) -> Path:
        """Returns the cache file of the cell's reach with a calibration, by which the object's place is known."""
        return self._store.cache(f"reach-{self._rig.cell.fingerprint[:16]}-{calibration.fingerprint[:16]}.json")

    # ---------------------------------------------------------------------------------------------------- lights, route

    def _choose_lights(self, record: SessionRecord, step: ChooseLights, stop: StopToken) -> None:
        if not isinstance(record.recipe, Recipe):
            self._choose_views(record, step, stop)
            return
        number, folder = step.pass_number, self._store.folder(record.session_id)
        known = (record.recipe, self._choices.lamp_cell, self._calibration, self.reach_cache)
        pictures: list[bytes] = []
        if number == 0:
            plan: LightPlan = self._compute.run(stop, "first_lights", *known)
        else:
            previous = folder / "results" / str(number - 1)
            images = results.observations(record, folder)
            region_file = results.region_file(self._store, record.session_id)
            plan, pictures = self._compute.run(stop, "further_lights", *known, previous, images, region_file)
        digests = [
            write_bytes(folder / f"passes/{number}/gain_{light}.png", picture) for light, picture in enumerate(pictures)
        ]
        self.predict_images(record.session_id, number, plan, stop)
        name = f"passes/{number}/plan.json"
        digest = write_value(folder / name, plan)
        body = self.plan_summary(plan, digests)
        self._store.journal.add_artifact(record.session_id, "plan", number, name, digest, body, "plan.ready")

    def _choose_views(self, record: SessionRecord, step: ChooseLights, stop: StopToken) -> None:
        number, folder = step.pass_number, self._store.folder(record.session_id)
        known, in_use = (record.recipe, self._rig.cell, self._calibration), self._choices.calibration_folder
        if isinstance(record.recipe, LampRecipe):
            plan: LightPlan = self._compute.run(stop, "lamp_poses", *known, number, in_use)
        elif isinstance(record.recipe, ResponseRecipe):
            plan = self._compute.run(stop, "response_light", *known)
        elif isinstance(record.recipe, CheckRecipe):
            plan = self._compute.run(stop, "check_poses", *known, results.observations(record, folder), in_use)
        else:
            previous = folder / "estimates" / str(number - 1) if number else None
            images = results.observations(record, folder)
            plan = self._compute.run(stop, "board_poses", *known, images, previous)
        name = f"passes/{number}/plan.json"
        digest = write_value(folder / name, plan)
        body = self.plan_summary(plan, [])
        self._store.journal.add_artifact(record.session_id, "plan", number, name, digest, body, "plan.ready")

    def predict_images(self, session_id: str, number: int, plan: LightPlan, stop: threading.Event) -> None:
        """Stores the image that the previous result predicts for each light, before the plan is entered."""
        if plan.levels_per_s is None:
            return
        folder = self._store.folder(session_id)
        pictures = self._compute.run(
            stop, "predict_images", plan.lights, self._calibration, folder / "results" / str(number - 1)
        )
        plans = self._store.journal.plan_count(session_id, number) + 1
        for light, picture in enumerate(pictures):
            write_bytes(predicted_image_file(folder, number, plans, light), picture)

    @staticmethod
    def plan_summary(plan: LightPlan, pictures: list[str]) -> dict[str, Any]:
        """Returns the journal's summary of a plan; `pictures` are the SHA-256 of the pictures of the lights' gains."""
        return {
            "lights": len(plan.lights),
            "method": plan.method,
            "predicted_sigma_deg": plan.predicted_sigma_deg,
            "predicted_median_deg": plan.predicted_median_deg,
            "notes": plan.notes,
            "conclusion": plan.conclusion,
            "pictures": pictures,
        }

    def set_region(self, session_id: str, content: bytes, actor: str) -> int:
        """Stores a mask (PNG) as the session's region of interest and returns its number of pixels.

        Raises RigError request.invalid, session.action_not_allowed, session.not_found.
        """
        self._store.journal.require_region_allowed(session_id)
        mask = region.decode_mask(content, self._calibration)
        if not np.any(mask & self._shots.region):
            raise RigError(
                ErrorCode.REQUEST_INVALID,
                "the mask lies outside the area where the object can be: draw it on the object",
            )
        pixels = int(np.count_nonzero(mask))
        with self._drawing, refusals(self._store.data):  # two masks at once must not have one file
            region_count = len(self._store.journal.artifacts(session_id, "region"))
            name = "region.png" if region_count == 0 else f"region_{region_count + 1}.png"
            digest = write_bytes(self._store.folder(session_id) / name, region.encode_mask(mask))
            self._store.journal.add_region(session_id, name, digest, {"pixels": pixels}, actor)
        return pixels

    def _plan_route(self, record: SessionRecord, step: PlanRoute, stop: StopToken) -> None:
        number, folder = step.pass_number, self._store.folder(record.session_id)
        plan = record.passes[number].plan
        if plan is None:
            raise RigError(ErrorCode.SERVICE_FAULT, f"Pass {number} has no plan to route")
        start = self._rig.arm.reading.joints
        route = self._rejoining_route(record, step, stop)
        if route is None:
            lights = [plan.lights[light] for light in step.light_numbers]
            known = (start, self._shots.cell_of(record), self._calibration)
            try:
                if plan.joints is None:
                    job = "plan_route_on_the_way" if session.while_moving(record.recipe) else "plan_route"
                    route = self._compute.run(stop, job, lights, *known)
                else:
                    joints = [plan.joints[light] for light in step.light_numbers]
                    route = self._compute.run(stop, "plan_route_of_views", lights, joints, *known)
            except RigError as error:
                raise _with_plan_numbers(error, step.light_numbers) from error
            order = [step.light_numbers[index] for index in route.light_numbers]
            route = route.model_copy(update={"light_numbers": order})
        earlier = [item for item in self._store.journal.artifacts(record.session_id, "route") if item.number == number]
        name = f"passes/{number}/route.json" if not earlier else f"passes/{number}/route_{len(earlier) + 1}.json"
        digest = write_value(folder / name, route)
        body = {"seconds": route.seconds, "lower_bound_s": route.lower_bound_s, "order": route.light_numbers}
        self._store.journal.add_artifact(record.session_id, "route", number, name, digest, body, "waypoints.ready")

    def _rejoining_route(self, record: SessionRecord, step: PlanRoute, stop: StopToken) -> Route | None:
        """Returns the rest of a route with a path to it from the measured joints; None when a new route is needed."""
        route = record.passes[step.pass_number].route
        if route is None or not set(step.light_numbers) <= set(route.light_numbers):
            return None
        start = self._rig.arm.reading.joints
        known = (self._shots.cell_of(record), self._calibration)
        try:
            return self._compute.run(stop, "rejoin_route", route, step.light_numbers, start, *known)
        except RigError as error:
            if error.code is not ErrorCode.WAYPOINTS_COLLISION:
                raise
            return None

    # ---------------------------------------------------------------------------------------------------------- normals

    def _solve_normals(self, record: SessionRecord, step: SolveNormals, stop: StopToken) -> None:
        if not isinstance(record.recipe, Recipe):
            estimates.estimate_and_record(
                self._store, self._compute, record, step.number, self._shots.cell_of(record), self._calibration,
                self._choices.calibration_folder, stop,
            )  # fmt: skip
            return
        request = SolveRequest(record.session_id, step.number, SolveSettings(), step.number)
        results.solve_and_record(
            self._store, self._compute, record, request, self._rig.cell, self._calibration, stop, origin="session"
        )


def _with_plan_numbers(error: RigError, light_numbers: tuple[int, ...]) -> RigError:
    """Returns the error with the lights numbered as in the plan; the route planner numbers only the given ones."""
    lights = [{**light, "number": light_numbers[light["number"]]} for light in error.context.get("lights", [])]
    if not lights:
        return error
    detail = refused_lights([f"light {light['number']}: {light['reason']}: {light['detail']}" for light in lights])
    return RigError(error.code, detail, **{**error.context, "lights": lights})
