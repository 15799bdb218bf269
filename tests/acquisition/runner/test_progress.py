"""Time left: the work that is left, counted, and times measured in this session, in earlier ones, or assumed."""

import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from acquisition.models import cell_config
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import FrameQuality, FrameRef, Shot, ShotKey
from acquisition.runner.progress import ASSUMED_S, EARLIER_SESSIONS, ProgressEstimator, measured, work_left
from acquisition.session import PassRecord, SessionRecord, Stage
from acquisition.session_state import State, Trigger
from acquisition.store import Event, Store
from hardware_sim import nominal

CELL = cell_config.load(nominal.default_cell_file())
HOME = CELL.arm.home
LIGHT = Light(position=(0.1, 0.0, -0.5), axis=(0.0, 0.0, -1.0))


def plan(lights: int) -> LightPlan:
    return LightPlan(lights=[LIGHT] * lights, method="optimal", reasons=[""] * lights)


def route(lights: int) -> Route:
    leg = Waypoint(light=LIGHT, path=[HOME], speeds=[1.0], seconds=2.0)
    return Route(
        start=HOME, waypoints=[leg] * lights, light_numbers=list(range(lights)), home_path=[HOME], home_speeds=[1.0],
        seconds=2.0 * (lights + 1), lower_bound_s=0.0,
    )  # fmt: skip


def shot(number: int, pass_number: int = 0) -> Shot:
    return Shot(
        key=ShotKey(pass_number=pass_number, number=number), kind="light",
        frame=FrameRef(path="x", width=1, height=1, sha256=""), exposure_s=0.1, light_number=number, taken_at=1.0,
        quality=FrameQuality(saturated=0.0, bright_level=0.5, accepted=True),
    )  # fmt: skip


def record(*passes: PassRecord, state: State = State.RUNNING, session_id: str = "s", **recipe: Any) -> SessionRecord:
    return SessionRecord(session_id, Recipe(**recipe), state, passes)


@pytest.mark.parametrize(
    ("passes", "left"),
    [
        ((), {"pilot": 1, "plan": 1, "waypoints": 2, "images": 4 + 2 + 4 + 1, "normals": 2}),
        ((PassRecord(plan=plan(4)),), {"plan": 1, "waypoints": 2, "images": 11, "normals": 2}),
        ((PassRecord(plan=plan(4), route=route(4), shots={0: shot(0)}),),
         {"plan": 1, "waypoints": 1, "images": 10, "normals": 2}),
        ((PassRecord(plan=plan(4), solved=True), PassRecord(plan=plan(4), route=route(4), shots={0: shot(0, 1)})),
         {"images": 4, "normals": 1}),
        ((PassRecord(solved=True), PassRecord(solved=True)), {}),
    ],
)  # fmt: skip
def test_work_left_counts_each_kind(passes: tuple[PassRecord, ...], left: dict[str, int]) -> None:
    assert work_left(record(*passes)).units == left
    assert not work_left(record(*passes)).at_least


def test_work_left_of_ordered_accuracy_is_at_least() -> None:
    known = PassRecord(plan=plan(4), solved=True)
    running = work_left(record(known, target_sigma_deg=0.5))
    ended = work_left(record(known, PassRecord(plan=plan(0)), target_sigma_deg=0.5))

    assert running.at_least
    assert running.units == {"plan": 1}
    assert not ended.at_least
    assert ended.units == {}


def event(at: float, type_: str, **body: Any) -> Event:
    return Event(int(at), "s", type_, body, at)


def test_measured_leaves_out_what_a_pause_interrupted() -> None:
    image = {"kind": "light"}
    durations = measured([
        event(0, "session.state", state="running"),
        event(1, "session.stage", stage="pilot"), event(4, "session.stage", stage="waypoints"),
        event(6, "session.stage", stage="capture"),
        event(8, "shot.captured", **image), event(11, "shot.captured", **image),
        event(12, "session.state", state="pausing"), event(50, "session.state", state="running"),
        event(53, "shot.captured", **image), event(57, "shot.captured", **image),
        event(58, "shot.captured", kind="dark"),
        event(60, "session.stage", stage="normals"), event(67, "session.stage", stage="plan"),
        event(70, "session.state", state="paused"), event(90, "session.stage", stage="waypoints"),
    ])  # fmt: skip

    assert durations == {"pilot": [3], "waypoints": [2], "images": [2, 3, 4], "normals": [7]}


@pytest.fixture
def store(tmp_path: Path) -> Generator[Store]:
    opened = Store(tmp_path)
    yield opened
    opened.close()


def made(store: Store, stages: dict[str, float]) -> str:
    """A session that has begun, with stages of given lengths."""
    row, _ = store.journal.create_session(Recipe(), CELL.model_dump_json(), CELL.fingerprint)
    store.journal.trigger(row.id, Trigger.START, "test")
    at = time.time() - sum(stages.values())
    connection = store.journal._connection
    for stage, length in [*stages.items(), ("capture", 0.0)]:
        connection.execute(
            "INSERT INTO event (session_id, type, body, at) VALUES (?, 'session.stage', json_object('stage', ?), ?)",
            (row.id, stage, at),
        )
        at += length
    return row.id


def test_estimate_prefers_own_times_to_earlier_to_assumed(store: Store) -> None:
    estimator = ProgressEstimator(store, CELL)
    earlier = made(store, {"plan": 20.0, "normals": 40.0})
    store.journal.trigger(earlier, Trigger.FINISH, "runner")
    own = made(store, {"plan": 2.0})
    known = PassRecord(plan=plan(4), route=route(4))

    left = estimator.estimate(record(known, session_id=own), Stage.CAPTURE).time_left

    assert left is not None
    parts = {part.work: part for part in left.parts}
    assert (parts["plan"].rests_on, parts["normals"].rests_on) == ("this-session", "earlier-sessions")
    assert (parts["images"].rests_on, parts["waypoints"].rests_on) == ("route", "assumed")
    assert parts["plan"].seconds == pytest.approx(2.0)
    assert parts["normals"].seconds == pytest.approx(2 * 40.0)
    assert parts["waypoints"].seconds == ASSUMED_S["waypoints"]
    assert parts["images"].seconds > parts["images"].count * 2.0  # longer than the moves alone
    assert left.seconds <= sum(part.seconds for part in left.parts)


def test_estimate_keeps_times_of_the_newest_sessions_only(store: Store) -> None:
    estimator, left = ProgressEstimator(store, CELL), None
    for length in range(1, EARLIER_SESSIONS + 4):
        earlier = made(store, {"plan": 10.0 * length})
        store.journal.trigger(earlier, Trigger.FINISH, "runner")
        left = estimator.estimate(record(session_id="own"), Stage.PILOT).time_left
        assert len(estimator._of_ended) == min(length, EARLIER_SESSIONS)
    assert left is not None
    plan_s = {part.work: part.seconds / part.count for part in left.parts}["plan"]
    assert plan_s == pytest.approx(60.0)  # the median of 40, 50, 60, 70, 80


def test_estimate_without_rig_is_unknown(store: Store) -> None:
    estimator = ProgressEstimator(store, CELL)
    for state in (State.CREATED, State.COMPLETED, State.STOPPED, State.FAILED):
        assert estimator.estimate(record(state=state), Stage.PILOT).time_left is None
    paused = estimator.estimate(record(state=State.PAUSED), Stage.PILOT).time_left
    assert paused is not None
    assert paused.seconds == sum(part.seconds for part in paused.parts)
