"""Plans before the arm moves: a dry run of a recipe, and a person's own lights in the place of the planned ones.

Both ask the compute process the same questions that a session would, and neither moves anything. A dry run gives way to
a session, whose steps come first.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

from acquisition import session
from acquisition.devices import Rig
from acquisition.models.base import Vector3
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route
from acquisition.runner.compute import Compute, GaveWay
from acquisition.runner.step_executor import Steps
from acquisition.session import AwaitReview, State
from acquisition.store import Store
from acquisition.store.folder import write_value

EXPOSURE_S = 0.1
"""Of an image whose exposure time nobody knows yet, reading and checking included."""


@dataclass(frozen=True)
class DryRun:
    """What a recipe's first pass would do; `seconds` is the time from the first move to the arm's return, without the
    way back to the light of the first image, which is taken again.
    """

    plan: LightPlan
    route: Route
    seconds: float


class Proposals:
    """Plans that people ask for; any thread may call."""

    def __init__(
        self, store: Store, rig: Rig, calibration: Calibration, compute: Compute, steps: Steps, closing: threading.Event
    ) -> None:
        self._store, self._rig, self._calibration = store, rig, calibration
        self._compute, self._steps, self._closing = compute, steps, closing

    def dry_run(self, recipe: Recipe) -> DryRun:
        """The lights and the route of a recipe's first pass, from where the arm stands (or from home).

        Raises RigError rig.busy while a session works, plan.infeasible, waypoints.unreachable, waypoints.collision.
        """
        busy = RigError(ErrorCode.RIG_BUSY, "A dry run is made when no session works: ask again later")
        holder = self._store.journal.holder()
        if holder is not None and holder.state not in (State.PAUSED, State.INTERRUPTED):
            raise busy
        arm, cell = self._rig.arm.reading, self._rig.cell
        start = arm.joints if arm.connected else cell.arm.home
        known = (cell, self._calibration)
        try:
            plan: LightPlan = self._compute.run(
                self._closing, "first_lights", recipe, *known, self._steps.reach_cache, yields=True
            )
            route: Route = self._compute.run(self._closing, "plan_route", plan.lights, start, *known, yields=True)
        except (GaveWay, Halted) as error:
            raise busy from error
        stop_s = cell.arm.settle_s + cell.lamp.rise_s + (recipe.exposure.seconds or EXPOSURE_S)
        return DryRun(plan, route, route.seconds + stop_s * (len(plan.lights) + 1))

    def replace_plan(
        self, session_id: str, number: int, positions: Sequence[Vector3], actor: str
    ) -> tuple[LightPlan, Route]:
        """Puts a person's own lights (m, view frame) in the place of a plan that waits for review, and routes them.

        Raises RigError session.not_found, session.action_not_allowed, waypoints.unreachable, waypoints.collision.
        """
        row, folder = self._store.journal.session(session_id), self._store.folder(session_id)
        step = self._next_step(session_id)
        if row.state is not State.PAUSED or not isinstance(step, AwaitReview) or step.pass_number != number:
            raise RigError(
                ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                f"Session {session_id} is {row.state} and does not wait for a person to look at pass {number}",
                state=row.state,
                allowed=[str(action) for action in session.allowed(row.state)],
            )
        previous = folder / "results" / str(number - 1) if number > 0 else None
        try:
            plan, route = self._compute.run(
                self._closing, "own_lights", list(positions), self._rig.cell, self._calibration,
                self._steps.reach_cache, previous, self._rig.arm.reading.joints,
            )  # fmt: skip
            self._steps.foretell(session_id, number, plan, self._closing)
        except Halted as error:
            raise RigError(ErrorCode.RIG_NOT_READY, "The service is ending") from error
        made = self._store.journal.plans_made(session_id, number)
        files: dict[str, tuple[str, str]] = {}
        for kind, value in (("plan", plan), ("route", route)):
            name = f"passes/{number}/{kind}_{made + 1}.json"
            files[kind] = (name, write_value(folder / name, value))
        self._store.journal.replace_plan(session_id, number, files, self._steps.told(plan, []), actor)
        return plan, route

    def approve(self, session_id: str, actor: str) -> None:
        """Enters that `actor` lets the plan pass that the session waits for, if it waits for one."""
        step = self._next_step(session_id)
        if isinstance(step, AwaitReview):
            self._store.journal.approve(session_id, step.pass_number, actor)

    def _next_step(self, session_id: str) -> session.Step | None:
        home = self._rig.cell.arm.home
        return session.next_step(self._store.record(session_id), home, home)
