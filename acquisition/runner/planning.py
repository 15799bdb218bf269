"""Planning service: dry runs of recipes, forecasts for a person's own lights, and their acceptance as a plan.

Nothing moves. Plans are made by the same jobs in the compute process as those of a session. Dry runs and forecasts have
lower priority: the jobs of a session preempt them. They are pure functions that take seconds, so the newest answers are
kept: a repeated request, or one with another title only, is answered at once.
"""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquisition import session, session_state
from acquisition.capture import exposure
from acquisition.devices import Rig
from acquisition.formats.frames import FolderFrames
from acquisition.models.base import Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import BoardRecipe, require_capture
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_forecast import ForecastInput, LightForecast
from acquisition.models.light_plan import LightPlan, PriorForecast
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route
from acquisition.models.shot import Observations
from acquisition.models.step import AwaitReview, AwaitTarget, Step
from acquisition.runner import results
from acquisition.runner.compute import Compute, Preempted
from acquisition.runner.memo import Memo
from acquisition.runner.rig_choices import RigChoices
from acquisition.runner.step_executor import StepExecutor
from acquisition.session_state import State
from acquisition.store import Store
from acquisition.store.folder import write_value
from acquisition.waypoints import mounted_tool

ASSUMED_EXPOSURE_S = 0.1
"""Assumed time, s, of an image whose exposure time is automatic, with readout and checks."""

KEPT_FORECASTS = 8
"""Number of forecasts kept, so that figures and picture of the same lights are computed once."""

KEPT_DRY_RUNS = 32
"""Numbers of plans with prior forecast, and of routes, that are kept; an answer takes up to 10 kB."""

SAME_START_RAD = 1e-3
"""Grid of the start's joints, rad, within which a dry run's route is reused; readings of a resting arm vary by less."""

UNPLANNED: Mapping[str, Any] = {"label": "", "notes": "", "retakes": 0, "review_plan": False}
"""Fields of a recipe that neither its first lights nor their forecast depend on."""


@dataclass(frozen=True)
class DryRun:
    """What a recipe's first pass would do, and what its session may reach. `seconds` is the time from the first move to
    the arm's return, without the path back to the light of the first image, which is repeated."""

    plan: LightPlan
    route: Route
    seconds: float
    forecast: PriorForecast


class PlanningService:
    """Makes plans on request; any thread may call."""

    def __init__(
        self,
        store: Store,
        rig: Rig,
        choices: RigChoices,
        compute: Compute,
        executor: StepExecutor,
        closing: threading.Event,
    ) -> None:
        self._store, self._rig, self._choices = store, rig, choices
        self._compute, self._executor, self._closing = compute, executor, closing
        self._forecasts = Memo[tuple[LightForecast, bytes | None]](KEPT_FORECASTS)
        self._designs = Memo[tuple[LightPlan, PriorForecast]](KEPT_DRY_RUNS)
        self._routes = Memo[Route](KEPT_DRY_RUNS)

    @property
    def _calibration(self) -> Calibration:
        return self._choices.calibration

    @property
    def reach_file(self) -> Path:
        """File in which the cell's reach is kept."""
        return self._executor.reach_cache

    def reach(self) -> str:
        """Returns the cell's reach as JSON. Raises RigError rig.busy if it is not made and a session holds the rig."""
        calibration = self._calibration
        cache = self._executor.reach_cache_of(calibration)
        holder = self._store.journal.holder()
        if holder is not None and not cache.exists():
            raise RigError(
                ErrorCode.RIG_BUSY,
                "The reach is not computed yet, and cannot be while a session holds the rig: ask again later",
                holder=holder.id,
            )
        if not cache.exists():
            self._compute.run(self._closing, "make_reach", self._choices.lamp_cell, calibration, cache)
        return cache.read_text(encoding="utf-8")

    def dry_run(self, recipe: Recipe) -> DryRun:
        """Plans lights and route of a recipe's first pass, from where the arm stands (from home if not connected).

        Raises RigError rig.busy while a session works, request.invalid for exposures that the camera cannot make,
        plan.infeasible, waypoints.unreachable, waypoints.collision.
        """
        self._require_idle()
        arm, cell = self._rig.arm.reading, self._choices.lamp_cell
        exposure.require_in_range(recipe.exposure, cell.camera)
        start = arm.joints if arm.connected else cell.arm.home
        try:
            plan, forecast = self._design(recipe)
            route = self._route(plan, start)
        except Preempted as error:
            raise self._busy() from error
        frame_s = recipe.exposure.seconds or ASSUMED_EXPOSURE_S
        stop_s = cell.arm.settle_s + cell.lamp.rise_s + frame_s
        further = exposure.further_times(frame_s, recipe.exposure, cell.camera)
        further_s = sum(ASSUMED_EXPOSURE_S + one for one in further)
        seconds = route.seconds + stop_s * (len(plan.lights) + 1) + further_s * len(plan.lights)
        return DryRun(plan, route, seconds, forecast)

    def first_views(self, recipe: BoardRecipe) -> tuple[LightPlan, Calibration]:
        """Returns the poses of a calibration's first pass, and the calibration in use, with which they are planned.

        The board need not be on the flange yet. Raises RigError rig.busy while a session works, config.invalid without
        a board, waypoints.unreachable, calibration.infeasible.
        """
        self._require_idle()
        mounted_tool.require_board(self._rig.cell)
        known, none_yet = self._calibration, Observations.of((), FolderFrames(Path()))
        try:
            plan: LightPlan = self._compute.run(
                self._closing, "board_poses", recipe, self._rig.cell, known, none_yet, None, preemptible=True
            )
        except Preempted as error:
            raise self._busy() from error
        return plan, known

    def _design(self, recipe: Recipe) -> tuple[LightPlan, PriorForecast]:
        """Returns the lights of a recipe's first pass, and the prior forecast. Raises Preempted."""
        known = (recipe, self._choices.lamp_cell, self._calibration, self._executor.reach_cache)

        def compute() -> tuple[LightPlan, PriorForecast]:
            plan: LightPlan = self._compute.run(self._closing, "first_lights", *known, preemptible=True)
            return plan, self._compute.run(self._closing, "prior_forecast", *known, plan.lights, preemptible=True)

        key = (recipe.model_copy(update=UNPLANNED).model_dump_json(), self._calibration.fingerprint)
        return self._designs.of(key, compute)

    def _route(self, plan: LightPlan, start: tuple[float, ...]) -> Route:
        """Returns the route through a plan's lights from `start` (rad). Raises Preempted."""
        lights = tuple(light.model_dump_json() for light in plan.lights)
        grid = tuple(round(angle / SAME_START_RAD) for angle in start)
        return self._routes.of(
            (lights, grid, self._calibration.fingerprint),
            lambda: self._compute.run(
                self._closing,
                "plan_route",
                plan.lights,
                start,
                self._choices.lamp_cell,
                self._calibration,
                preemptible=True,
            ),
        )

    def replace_plan(
        self, session_id: str, number: int, positions: Sequence[Vector3], actor: str
    ) -> tuple[LightPlan, Route]:
        """Replaces a plan under review by a person's own lights (m, view frame), and plans their route.

        Raises RigError session.not_found, session.action_not_allowed, waypoints.unreachable, waypoints.collision; and
        Halted, as every job, when the service ends.
        """
        self._require_review(session_id, number)
        folder = self._store.folder(session_id)
        previous = folder / "results" / str(number - 1) if number > 0 else None
        plan, route = self._compute.run(
            self._closing, "own_lights", list(positions), self._choices.lamp_cell, self._calibration,
            self._executor.reach_cache, previous, self._rig.arm.reading.joints,
        )  # fmt: skip
        self._executor.predict_images(session_id, number, plan, self._closing)
        plan_count = self._store.journal.plan_count(session_id, number)
        files: dict[str, tuple[str, str]] = {}
        for kind, value in (("plan", plan), ("route", route)):
            name = f"passes/{number}/{kind}_{plan_count + 1}.json"
            files[kind] = (name, write_value(folder / name, value))
        self._store.journal.replace_plan(session_id, number, files, self._executor.plan_summary(plan, []), actor)
        return plan, route

    def forecast(
        self, session_id: str, number: int, positions: Sequence[Vector3]
    ) -> tuple[LightForecast, bytes | None]:
        """Forecasts σ with lights at `positions` (m, view frame) for a plan under review, with a picture (PNG).

        Only the answers to the last few requests are kept. The picture is None if there is no result before this pass.
        Raises RigError session.not_found, session.action_not_allowed, plan.infeasible, rig.busy.
        """
        self._require_review(session_id, number)
        record, folder = self._store.record(session_id), self._store.folder(session_id)
        region_file = results.region_file(self._store, session_id)
        key = f"{session_id}/{number}/{region_file}"

        def compute() -> tuple[LightForecast, bytes | None]:
            given = ForecastInput(
                recipe=require_capture(record.recipe),
                cell=self._choices.lamp_cell,
                calibration=self._calibration,
                result=folder / "results" / str(number - 1) if number > 0 else None,
                observations=results.observations(record, folder),
                region_file=region_file,
            )
            return self._compute.run(
                self._closing, "forecast_lights", key, given, self._executor.reach_cache, list(positions),
                preemptible=True,
            )  # fmt: skip

        try:
            return self._forecasts.of((key, tuple(positions)), compute)
        except Preempted as error:
            raise RigError(ErrorCode.RIG_BUSY, "A session is using the compute process: ask again later") from error

    def approve(self, session_id: str, actor: str) -> None:
        """Records that `actor` approves the plan, or has placed the target, if the session waits for one of these."""
        step = self._next_step(session_id)
        if isinstance(step, AwaitReview | AwaitTarget):
            self._store.journal.approve(session_id, step.pass_number, actor)

    def _require_idle(self) -> None:
        """Raises RigError rig.busy while a session works."""
        holder = self._store.journal.holder()
        if holder is not None and holder.state not in (State.PAUSED, State.INTERRUPTED):
            raise self._busy()

    def _busy(self) -> RigError:
        holder = self._store.journal.holder()
        context = {} if holder is None else {"holder": holder.id}
        return RigError(ErrorCode.RIG_BUSY, "A session is working: request the dry run again later", **context)

    def _require_review(self, session_id: str, number: int) -> None:
        """Raises RigError session.action_not_allowed unless the session waits for the review of this pass's plan."""
        row, step = self._store.journal.session(session_id), self._next_step(session_id)
        if row.state is not State.PAUSED or not isinstance(step, AwaitReview) or step.pass_number != number:
            raise RigError(
                ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                f"Session {session_id} is {row.state} and is not waiting for the review of pass {number}",
                state=row.state,
                allowed=[str(action) for action in session_state.allowed_actions(row.state)],
            )

    def _next_step(self, session_id: str) -> Step | None:
        home = self._rig.cell.arm.home
        return session.next_step(self._store.record(session_id), home, home)
