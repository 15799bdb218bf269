"""Progress and remaining time of a session, estimated from its own events and those of earlier sessions.

Extrapolation of the elapsed time would count pauses as work and ignore what is left. Here the remaining work is counted
by kind, as `session.next_step` will derive it. Each kind takes as long as it took in this session, else in the last
completed ones of this cell, else as computed from the route or assumed; the answer states which.
"""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from acquisition import session, session_state
from acquisition.models.calibration_recipe import CalibrationRecipe, require_capture
from acquisition.models.cell_config import CellConfig
from acquisition.models.recipe import Recipe
from acquisition.models.time_left import Basis, TimeLeft, TimePart
from acquisition.session import PassRecord, SessionRecord, Stage
from acquisition.session_state import State
from acquisition.store import Event, SessionFilter, SessionRow, Store

EARLIER_SESSIONS = 5
"""Number of completed sessions of the cell whose times count."""

LOOKED_AT = 50
"""Number of completed sessions among which those of this cell are searched for."""

ASSUMED_S: dict[str, float] = {
    "pilot": 5.0,
    "plan": 4.0,
    "waypoints": 1.0,
    "images": 3.0,
    "normals": 5.0,
    "estimate": 5.0,
}
"""Assumed times, s, of one unit of each kind of work without a measurement: those of the demonstration on two cores,
whose first lights wait for the compute process."""

ASSUMED_STOP_S = 0.3
"""Assumed time, s, of an image beside its move, settling and lamp: exposure, readout, checks."""

_WORK_OF_STAGE = {
    stage: str(stage) for stage in (Stage.PILOT, Stage.PLAN, Stage.WAYPOINTS, Stage.NORMALS, Stage.ESTIMATE)
}
_EVENTS = ("session.stage", "session.state", "shot.captured")
_ANNOUNCED = ("session.stage", "session.progress")
_PASS_EXTRAS = 1
"""Units of capture work of a pass beside its lights: the path home with the lamp-off frames."""

Durations = dict[str, list[float]]
"""Measured times, s, of single units of work by kind."""


@dataclass(frozen=True)
class SessionProgress:
    """Stage, completed fraction (0–1) and remaining time (none: it does not hold the rig) of a session."""

    stage: Stage
    progress: float
    time_left: TimeLeft | None


@dataclass
class _Work:
    """Remaining units of work by kind; with `at_least` more may follow."""

    units: dict[str, int] = field(default_factory=dict[str, int])
    at_least: bool = False

    def add(self, work: str, count: int = 1) -> None:
        if count > 0:
            self.units[work] = self.units.get(work, 0) + count


class ProgressEstimator:
    """Estimates the progress of sessions of one store; any thread may call."""

    def __init__(self, store: Store, cell: CellConfig) -> None:
        self._store, self._cell = store, cell
        self._of_ended: dict[str, Durations] = {}  # only the newest sessions

    def estimate(self, record: SessionRecord, stage: Stage) -> SessionProgress:
        """Estimates the progress of a session from its record and the stage that it has reached."""
        holds = record.state in session_state.RIG_HOLDING
        return SessionProgress(stage, session.progress(record), self._time_left(record) if holds else None)

    def announced(self, row: SessionRow) -> SessionProgress:
        """Returns the progress of a session as last announced, without reading its files."""
        announced = {event.type: event.body for event in self._store.journal.events(0, 10_000, row.id, _ANNOUNCED)}
        if row.state is State.COMPLETED:
            return SessionProgress(Stage.FINISHED, 1.0, None)
        stage = Stage(announced.get("session.stage", {}).get("stage", Stage.PILOT))
        return SessionProgress(stage, announced.get("session.progress", {}).get("progress", 0.0), None)

    def _time_left(self, record: SessionRecord) -> TimeLeft:
        events = self._store.journal.events(0, 10_000, record.session_id, _EVENTS)
        own, left = measured(events), work_left(record)
        known = all(own.get(work) for work in left.units)
        earlier = {} if known else self._earlier(record.session_id)
        parts: list[TimePart] = []
        for work in ASSUMED_S:
            count = left.units.get(work, 0)
            if count:
                unit_s, rests_on = self._unit(work, own, earlier, record)
                part = TimePart(work=work, count=count, seconds=count * unit_s, rests_on=rests_on)  # pyright: ignore[reportArgumentType]
                parts.append(part)
        seconds = sum(part.seconds for part in parts)
        if parts and record.state is State.RUNNING and events:
            begun = parts[0].seconds / parts[0].count
            seconds -= min(max(time.time() - events[-1].at, 0.0), begun)
        return TimeLeft(seconds=max(seconds, 0.0), at_least=left.at_least, parts=parts)

    def _unit(self, work: str, own: Durations, earlier: Durations, record: SessionRecord) -> tuple[float, Basis]:
        if own.get(work):
            return statistics.median(own[work]), "this-session"
        if earlier.get(work):
            return statistics.median(earlier[work]), "earlier-sessions"
        routes = [passed.route for passed in record.passes if passed.route is not None and passed.route.waypoints]
        if work == "images" and routes:
            moving_s = routes[-1].seconds / (len(routes[-1].waypoints) + _PASS_EXTRAS)
            planned = [one.seconds for work in record.passes[-1:] if work.plan for one in work.plan.exposures or ()]
            stop_s = statistics.mean(planned) if planned else ASSUMED_STOP_S
            return moving_s + self._cell.arm.settle_s + self._cell.lamp.rise_s + stop_s, "route"
        return ASSUMED_S[work], "assumed"

    def _earlier(self, session_id: str) -> Durations:
        """Returns the times of work in the newest completed sessions of this cell."""
        rows = self._store.journal.sessions(LOOKED_AT, wanted=SessionFilter(states=(State.COMPLETED,)))
        ids = [row.id for row in rows if row.fingerprint == self._cell.fingerprint and row.id != session_id]
        kept = self._of_ended
        newest = {
            earlier: kept.get(earlier) or measured(self._store.journal.events(0, 10_000, earlier, _EVENTS))
            for earlier in ids[:EARLIER_SESSIONS]
        }
        self._of_ended = newest
        result: Durations = {}
        for durations in newest.values():
            for work, times in durations.items():
                result.setdefault(work, []).extend(times)
        return result


def work_left(record: SessionRecord) -> _Work:
    """Counts the remaining work by kind, as `session.next_step` will derive it."""
    work, recipe = _Work(), record.recipe
    if not isinstance(recipe, Recipe):
        return _calibration_left(record, recipe)
    ordered = recipe.target_sigma_deg is not None
    for number in range(session.max_passes(recipe)):
        current = record.passes[number] if number < len(record.passes) else PassRecord()
        if current.solved:
            continue
        if current.plan is not None and not current.plan.lights:
            break
        if ordered and current.plan is None and number > 0:
            work.add("plan")
            work.at_least = True
            break
        lights = _planned(record, number) if current.plan is None else len(current.plan.lights)
        left = lights - len(current.shots)
        work.add("plan" if number or recipe.method != "optimal" else "pilot", int(current.plan is None))
        work.add("waypoints", int(left > 0 and current.route is None))
        repeats = int(number == 0)  # the first image, at the end of the first pass
        done = left == 0 and bool(current.darks)
        work.add("images", left + (0 if done else _PASS_EXTRAS + repeats))
        work.add("normals")
    work.at_least = work.at_least or (ordered and not _concluded(record))
    return work


def measured(events: Sequence[Event]) -> Durations:
    """Measures times of work between a session's events (stage, state, image); a pause makes one of them unknown."""
    result: Durations = {}
    stage: str | None = None
    since: float | None = None
    for event in events:
        work = _WORK_OF_STAGE.get(Stage(stage)) if stage is not None else None
        match event.type:
            case "session.state":
                since = None
            case "shot.captured":
                if since is not None and event.body["kind"] == "light":
                    result.setdefault("images", []).append(event.at - since)
                elif since is not None and event.body["kind"] == "bracket" and result.get("images"):
                    result["images"][-1] += event.at - since
                since = event.at
            case _:
                if work is not None and since is not None:
                    result.setdefault(work, []).append(event.at - since)
                stage, since = event.body["stage"], event.at
    return result


def _calibration_left(record: SessionRecord, recipe: CalibrationRecipe) -> _Work:
    """Counts the remaining work of a calibration that takes all images; with an accuracy to reach it may be less."""
    work, taken = _Work(), sum(len(passed.shots) for passed in record.passes)
    if _concluded(record):
        return work
    open_pass = bool(record.passes) and not record.passes[-1].solved
    planned = len(record.passes[-1].plan.lights) if open_pass and record.passes[-1].plan is not None else 0
    left_here = planned - len(record.passes[-1].shots) if open_pass else 0
    seen, passes = taken + left_here, 0
    while seen < recipe.max_images and (batch := recipe.images_after(seen)) > 0:
        seen, passes = seen + batch, passes + 1
    unplanned = seen - taken - left_here
    work.add("plan", passes + 1)
    work.add("waypoints", passes + int(open_pass and left_here > 0 and record.passes[-1].route is None))
    work.add("images", left_here + unplanned + (_PASS_EXTRAS + 1) * (passes + int(open_pass)))
    work.add("estimate", passes + int(open_pass))
    return work


def _planned(record: SessionRecord, number: int) -> int:
    """Number of lights that the recipe gives a pass without a plan."""
    recipe = require_capture(record.recipe)
    if recipe.method != "optimal":
        return recipe.lights_total
    return recipe.pilot_lights if number == 0 else recipe.planned_lights


def _concluded(record: SessionRecord) -> bool:
    return bool(record.passes) and record.passes[-1].plan is not None and not record.passes[-1].plan.lights
