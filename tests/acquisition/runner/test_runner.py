"""The runner against the simulated cell: concurrent requests, stop, pause and resume, refusals, review of the plan,
and parking."""

import threading
import time
from collections.abc import Generator
from contextlib import suppress

import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.session import same_joints
from acquisition.session_state import ENDED, State, Trigger
from tests.acquisition.runner.simulated_rig import (
    CELL_FILE,
    LONG,
    Rig,
    after_first_image,
    end_what_is_left,
    move_by_hand,
    new,
    reason_of,
    refusal,
    rests,
    simulated_rig,
    wait_for,
)

HOME = cell_config.load(CELL_FILE).arm.home


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("runner"), "127.0.6.10") as made:
        yield made


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    end_what_is_left(rig)


def test_stop_at_any_time_ends_with_the_arm_at_rest(rig: Rig) -> None:
    for number in range(4):
        session_id = new(rig, LONG)
        rig.runner.act(session_id, Trigger.START, "a")
        time.sleep(0.34 * number)
        if number % 2:
            rig.runner.halt("b")
        else:
            rig.runner.act(session_id, Trigger.STOP, "b")
        assert wait_for(rig, session_id, *ENDED) is State.STOPPED
        assert rests(rig)
        assert rig.control.state()["digital_outputs"] == 0
        if number % 2:
            with pytest.raises(RigError) as refused:
                rig.runner.act(new(rig), Trigger.START, "a")
            assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
            rig.runner.acknowledge("b")


def test_start_twice_at_once_runs_once_and_can_be_stopped(rig: Rig) -> None:
    session_id = new(rig, LONG)
    starts = [threading.Thread(target=rig.runner.act, args=(session_id, Trigger.START, str(n))) for n in range(3)]
    for start in starts:
        start.start()
    for start in starts:
        start.join()
    time.sleep(0.3)
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert wait_for(rig, session_id, *ENDED) is State.STOPPED
    assert rests(rig)


def test_start_of_two_sessions_one_is_refused_naming_the_holder(rig: Rig) -> None:
    sessions = [new(rig), new(rig)]
    refused: list[RigError] = []

    def start(session_id: str) -> None:
        try:
            rig.runner.act(session_id, Trigger.START, "a")
        except RigError as error:
            refused.append(error)

    threads = [threading.Thread(target=start, args=(session_id,)) for session_id in sessions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (error,) = refused
    assert error.code is ErrorCode.RIG_BUSY
    holder = error.context["holder"]
    assert holder in sessions
    assert wait_for(rig, holder, *ENDED) is State.COMPLETED
    (other,) = set(sessions) - {holder}
    assert rig.store.journal.session(other).state is State.CREATED


def test_pause_and_resume_capture_no_frame_twice(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    wait_for(rig, session_id, State.PAUSED)
    captured = len(rig.store.journal.shots(session_id))
    assert rests(rig)
    time.sleep(0.5)
    assert len(rig.store.journal.shots(session_id)) == captured < LONG.pilot_lights + 1
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    keys = [shot.key for shot in rig.store.journal.shots(session_id)]
    assert len(keys) == len(set(keys))
    assert len([shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]) == LONG.pilot_lights


def test_protective_stop_interrupts_until_acknowledged(rig: Rig) -> None:
    session_id = new(rig)
    rig.control.fault("protective_stop", at_move=2)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.INTERRUPTED)
    assert reason_of(rig, session_id)["code"] == "arm.protective_stop"
    with pytest.raises(RigError) as refused:
        rig.runner.act(session_id, Trigger.RESUME, "a")
    assert refused.value.code is ErrorCode.ARM_PROTECTIVE_STOP
    with pytest.raises(RigError) as refused:
        rig.runner.acknowledge("a")
    assert refused.value.code is ErrorCode.SAFETY_STILL_FAULTED
    rig.control.fault("clear")
    deadline = time.monotonic() + 60
    while (error := refusal(rig, session_id)).code is ErrorCode.ARM_PROTECTIVE_STOP:  # the arm has not yet reported it
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert error.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    assert rests(rig)
    rig.runner.acknowledge("a")
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED


def test_dead_lamp_interrupts_with_the_reason(rig: Rig) -> None:
    rig.control.fault("output_stuck", output=0, level=False)
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.INTERRUPTED)
    assert reason_of(rig, session_id)["code"] == "lamp.not_confirmed"
    rig.control.fault("clear")
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert rig.store.journal.session(session_id).state is State.STOPPED


def test_unreachable_lights_are_named_without_motion(rig: Rig) -> None:
    before = rig.control.state()["moves_started"]
    far = Recipe(method="user", user_lights=[(0.0, 0.1, -0.45), (0.1, 0.0, -0.45), (0.0, 3.0, -0.9)])
    session_id = new(rig, far)
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, *ENDED) is State.FAILED
    assert reason_of(rig, session_id)["code"] == "waypoints.unreachable"
    assert "2" in reason_of(rig, session_id)["detail"]
    assert rig.control.state()["moves_started"] == before


def test_replace_plan_under_review_uses_reachable_user_lights(rig: Rig) -> None:
    recipe = Recipe(method="random", pilot_lights=3, planned_lights=0, review_plan=True)
    foreseen = rig.runner.planning.dry_run(recipe)
    again = rig.runner.planning.dry_run(recipe.model_copy(update={"label": "the same under another title"}))
    assert (again.plan, again.route, again.forecast) == (foreseen.plan, foreseen.route, foreseen.forecast)
    assert again.route is foreseen.route  # kept, not computed anew
    moves = rig.control.state()["moves_started"]
    session_id = new(rig, recipe)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.PAUSED)
    assert reason_of(rig, session_id)["code"] == "plan.to_review"
    planned = rig.store.record(session_id).passes[0].plan
    assert planned == foreseen.plan
    assert foreseen.route.light_numbers
    assert foreseen.seconds > foreseen.route.seconds
    assert 3 in [point.lights for point in foreseen.forecast.points]
    assert rig.control.state()["moves_started"] == moves
    with pytest.raises(RigError) as refused:
        rig.runner.planning.replace_plan(session_id, 0, [(0.0, 0.0, 3.0)], "a")
    assert refused.value.code is ErrorCode.WAYPOINTS_UNREACHABLE
    assert [light["number"] for light in refused.value.context["lights"]] == [0]
    with pytest.raises(RigError) as refused:
        rig.runner.planning.replace_plan(session_id, 1, [planned.lights[0].position], "a")
    assert refused.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED
    own = [light.position for light in reversed(planned.lights)]
    rig.runner.planning.replace_plan(session_id, 0, own, "a")
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    work = rig.store.record(session_id).passes[0]
    assert work.plan is not None
    assert [light.position for light in work.plan.lights] == own
    for number, shot in work.shots.items():
        assert shot.light is not None
        assert shot.light.position == pytest.approx(own[number], abs=2e-3)
    with pytest.raises(RigError) as refused:
        rig.runner.planning.replace_plan(session_id, 0, own, "a")
    assert refused.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED


def park(rig: Rig) -> int:
    """Starts parking; a link that the busy machine has interrupted is acknowledged before, as an operator does.

    Returns the number of the newest event before it.
    """
    deadline = time.monotonic() + 60
    while True:
        before = rig.store.journal.last_event_id()
        try:
            rig.runner.moves.park("a")
        except RigError as error:
            lost = error.code in (ErrorCode.DEVICE_DISCONNECTED, ErrorCode.SAFETY_NOT_ACKNOWLEDGED)
            if not lost or time.monotonic() > deadline:
                raise
            time.sleep(0.05)
            with suppress(RigError):  # refused as long as the link is away
                rig.runner.acknowledge("a")
            continue
        return before


def outcome(rig: Rig, after: int) -> str:
    """Outcome of the parking that has begun after an event; waits for it."""
    deadline = time.monotonic() + 90
    while not (ended := list(rig.store.journal.events(after, types=("rig.parked",)))):
        assert time.monotonic() < deadline, "parking did not end"
        time.sleep(0.02)
    return str(ended[-1].body["outcome"])


def left_at(rig: Rig, joints: tuple[float, ...]) -> None:
    """Somebody stops the program at the pendant, moves the arm by hand, and says that all is clear."""
    rig.control.fault("program_stop")
    move_by_hand(rig, joints)
    rig.control.fault("clear")
    rig.runner.acknowledge("a")


def test_park_displaced_arm_returns_home(rig: Rig) -> None:
    assert outcome(rig, park(rig)) == "at home"
    left_at(rig, (HOME[0] + 1.2, HOME[1] - 0.3, *HOME[2:5], HOME[5] + 0.5))
    assert outcome(rig, park(rig)) == "at home"
    assert same_joints(tuple(rig.control.state()["joints"]), HOME)
    assert rig.control.state()["collisions"] == 0


def test_park_stop_halts_the_arm(rig: Rig) -> None:
    left_at(rig, (HOME[0] + 2.5, *HOME[1:]))
    rig.control.fault("speed_slider", fraction=0.04)  # several seconds away, however busy the machine is
    begun = park(rig)
    deadline = time.monotonic() + 60
    while max(map(abs, rig.control.state()["joint_speeds"])) < 0.02:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    rig.runner.halt("b")
    assert outcome(rig, begun).startswith("halted")
    before = rig.control.state()["joints"]
    time.sleep(0.3)
    assert rig.control.state()["joints"] == before
    rig.control.fault("speed_slider", fraction=1.0)
    assert not same_joints(tuple(before), HOME)
    with pytest.raises(RigError) as refused:
        rig.runner.moves.park("a")
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    assert outcome(rig, park(rig)) == "at home"


def test_park_without_free_path_raises_collision(rig: Rig) -> None:
    near_the_table = (HOME[0] + 1.5, -0.135, 0.3, 0.0, 0.0, 0.0)  # 9 mm above it
    left_at(rig, near_the_table)
    with pytest.raises(RigError) as refused:
        park(rig)
    assert refused.value.code is ErrorCode.WAYPOINTS_COLLISION
    assert "by hand" in refused.value.detail
    assert same_joints(tuple(rig.control.state()["joints"]), near_the_table)
