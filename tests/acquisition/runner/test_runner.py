"""The runner against the simulated cell: concurrent requests, pause and resume, refusals."""

import threading
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.runner.runner import Runner
from acquisition.session import ENDED, State, Trigger
from acquisition.store import Store
from acquisition.store.folder import sha256_of
from api.rest import settings, wiring
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient

CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"
SMALL = Recipe(pilot_lights=3, planned_lights=0)


@dataclass(frozen=True)
class Rig:
    runner: Runner
    store: Store
    control: ControlClient


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    folder = tmp_path_factory.mktemp("runner")
    with Cell(
        CellOptions("127.0.6.10", "sphere", 1, "ideal", 20.0, pixels=96, cell_file=CELL_FILE), folder / "cell"
    ) as cell:
        service = wiring.build(settings.read(cell=cell.cell_file, data=folder / "data"))
        service.open()
        with ControlClient(cell.address) as control:
            yield Rig(service.runner, service.store, control)
        service.close()


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    """Ends what the test before has left behind, and a fault that the machine's load has latched meanwhile."""
    holder = rig.store.journal.holder()
    if holder is not None:
        rig.runner.act(holder.id, Trigger.STOP, "a")
        wait_for(rig, holder.id, *ENDED, within_s=5.0)
    acknowledge(rig)


def new(rig: Rig, recipe: Recipe = SMALL) -> str:
    return rig.runner.create(recipe)[0].id


def wait_for(rig: Rig, session_id: str, *states: State, within_s: float = 40.0) -> State:
    deadline = time.monotonic() + within_s
    while (state := rig.store.journal.session(session_id).state) not in states:
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.01)
    return state


def reason_of(rig: Rig, session_id: str) -> dict[str, Any]:
    reason = rig.store.journal.session(session_id).reason
    assert reason is not None
    return reason


def rests(rig: Rig) -> bool:
    before = rig.control.state()["joints"]
    time.sleep(0.1)
    return rig.control.state()["joints"] == pytest.approx(before, abs=1e-5)


def test_stop_at_any_time_ends_with_the_arm_at_rest(rig: Rig) -> None:
    for number in range(8):
        session_id = new(rig)
        rig.runner.act(session_id, Trigger.START, "a")
        time.sleep(0.17 * number)
        if number % 2:
            rig.runner.halt("b")
        else:
            rig.runner.act(session_id, Trigger.STOP, "b")
        assert wait_for(rig, session_id, *ENDED, within_s=5.0) is State.STOPPED
        assert rests(rig)
        assert rig.control.state()["digital_outputs"] == 0


def test_start_twice_at_once_runs_once_and_can_be_stopped(rig: Rig) -> None:
    session_id = new(rig)
    starts = [threading.Thread(target=rig.runner.act, args=(session_id, Trigger.START, str(n))) for n in range(3)]
    for start in starts:
        start.start()
    for start in starts:
        start.join()
    time.sleep(0.3)
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=5.0) is State.STOPPED
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
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 30
    while not rig.store.journal.shots(session_id):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    wait_for(rig, session_id, State.PAUSED)
    captured = len(rig.store.journal.shots(session_id))
    assert rests(rig)
    time.sleep(0.5)
    assert len(rig.store.journal.shots(session_id)) == captured < 4
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    keys = [shot.key for shot in rig.store.journal.shots(session_id)]
    assert len(keys) == len(set(keys))
    assert len([shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]) == 3


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
    time.sleep(0.3)
    with pytest.raises(RigError) as refused:
        rig.runner.act(session_id, Trigger.RESUME, "a")
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
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


# ------------------------------------------------------------------------------------------------- what needs a person


def refusal(rig: Rig, session_id: str) -> RigError:
    with pytest.raises(RigError) as refused:
        rig.runner.act(session_id, Trigger.RESUME, "a")
    return refused.value


def after_first_image(rig: Rig, recipe: Recipe = SMALL) -> str:
    """A session that runs and has taken its first image."""
    session_id = new(rig, recipe)
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 30
    while not rig.store.journal.shots(session_id):
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return session_id


def interrupted(rig: Rig) -> str:
    """A session that a protective stop has interrupted after its first image; the stop is cleared and acknowledged."""
    session_id = after_first_image(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    return session_id


def acknowledge(rig: Rig) -> None:
    """Acknowledges a fault as a person does after correcting it."""
    rig.control.fault("clear")
    deadline = time.monotonic() + 5
    while True:
        try:
            rig.runner.acknowledge("a")
        except RigError:
            assert time.monotonic() < deadline
            time.sleep(0.05)
            continue
        return


def test_replace_plan_under_review_uses_reachable_user_lights(rig: Rig) -> None:
    recipe = Recipe(method="random", pilot_lights=3, planned_lights=0, review_plan=True)
    foreseen = rig.runner.planning.dry_run(recipe)
    moves = rig.control.state()["moves_started"]
    session_id = new(rig, recipe)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.PAUSED)
    assert reason_of(rig, session_id)["code"] == "plan.to_review"
    planned = rig.store.record(session_id).passes[0].plan
    assert planned == foreseen.plan
    assert foreseen.route.light_numbers
    assert foreseen.seconds > foreseen.route.seconds
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


def test_resume_displaced_arm_requires_from_here(rig: Rig) -> None:
    session_id = interrupted(rig)
    joints = list(rig.control.state()["joints"])
    rig.control.fault("hand_move", joints=[joints[0] + 0.3, *joints[1:]], seconds=0)
    time.sleep(0.2)
    error = refusal(rig, session_id)
    assert error.code is ErrorCode.ARM_ELSEWHERE
    assert 0.1 < error.context["distance_rad"] <= 0.3 + 1e-3
    assert rests(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a", from_here=True)
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    kinds = [shot.kind for shot in rig.store.journal.shots(session_id)]
    assert kinds.count("reference") == 2  # after the interruption, and at the end of the pass


def test_resume_moved_object_is_detected_by_repeated_image(rig: Rig) -> None:
    session_id = interrupted(rig)
    captured = len(rig.store.journal.shots(session_id))
    rig.control.fault("nudged_object", shift_m=[0.004, 0.0, 0.0])
    rig.runner.act(session_id, Trigger.RESUME, "a")
    wait_for(rig, session_id, State.PAUSED)
    reason = reason_of(rig, session_id)
    assert reason["code"] == "scene.moved"
    assert reason["shift_px"] > 1
    assert len(rig.store.journal.shots(session_id)) == captured
    rig.control.fault("nudged_object", shift_m=[-0.004, 0.0, 0.0])
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED


def test_object_moved_during_pilot_discards_all_its_images(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.control.fault("nudged_object", shift_m=[0.004, 0.0, 0.0])
    wait_for(rig, session_id, State.PAUSED)
    reason = reason_of(rig, session_id)
    assert reason["code"] == "scene.moved"
    assert "anew" in reason["detail"]
    assert rig.store.journal.shots(session_id) == []
    events = [event for event in rig.store.journal.events(0, 500, session_id) if event.type.startswith("shot")]
    assert [event.type for event in events].count("shot.captured") == 3
    assert events[-1].type == "shots.discarded"
    rig.runner.act(session_id, Trigger.RESUME, "a")  # the object stays where it is now
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    rig.control.fault("nudged_object", shift_m=[-0.004, 0.0, 0.0])
    shots = rig.store.journal.shots(session_id)
    assert [shot.kind for shot in shots] == ["light"] * 3 + ["reference"] + ["dark"] * (len(shots) - 4)
    assert shots[3].repeats == shots[0].key
    folder = rig.store.folder(session_id)
    assert all(sha256_of(folder / shot.frame.path) == shot.frame.sha256 for shot in shots)


def test_dark_frame_pauses_and_lost_frames_are_retaken(rig: Rig) -> None:
    rig.control.fault("lamp", fraction=0.0)
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.PAUSED)
    reason = reason_of(rig, session_id)
    assert reason["code"] == "capture.frame_rejected"
    assert "lamp" in reason["detail"]
    rig.control.fault("lamp", fraction=1.0)
    rig.control.fault("dropped_frame")
    rig.control.fault("saturated_frame")
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    reasons = [event.body["reason"] for event in rig.store.journal.events(0, 500, session_id, ("shot.retaken",))]
    assert any("no light" in reason for reason in reasons)
    assert any("lost on its way" in reason for reason in reasons)
    assert any("saturated" in reason for reason in reasons)


def test_fault_interrupts_a_paused_session(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    wait_for(rig, session_id, State.PAUSED)
    rig.control.fault("safeguard_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    assert reason_of(rig, session_id)["code"].startswith("arm.")
    acknowledge(rig)
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert rig.store.journal.session(session_id).state is State.STOPPED


def test_recover_unlock_requires_the_actors_acknowledgement(rig: Rig) -> None:
    with pytest.raises(RigError) as refused:
        rig.runner.recover("unlock", "nobody has looked")
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    rig.control.fault("protective_stop")
    stopped = time.monotonic()
    while rig.runner.status().latched is None:
        assert time.monotonic() < stopped + 5
        time.sleep(0.02)
    for step, when in (("unlock", 0.0), ("unlock", 5.1)):
        time.sleep(max(0.0, stopped + when - time.monotonic()))
        with pytest.raises(RigError) as refused:
            rig.runner.acknowledge("b")
        assert refused.value.code is ErrorCode.SAFETY_STILL_FAULTED
        if when == 0.0:
            with pytest.raises(RigError) as refused:
                rig.runner.recover(step, "b")
            assert refused.value.code is ErrorCode.SAFETY_RECOVERY_REFUSED
            assert "5s" in refused.value.detail
        else:
            rig.runner.recover(step, "b")
    assert rig.runner.status().latched is not None
    acknowledge(rig)
    assert rig.runner.status().may_start


def test_recover_power_and_brakes_in_two_steps(rig: Rig) -> None:
    rig.control.fault("power_off")
    rig.runner.acknowledge("c")
    for step, mode in (("power", 5), ("brakes", 7)):  # UR's robot modes: idle, running
        assert rig.control.state()["robot_mode"] != mode
        rig.runner.recover(step, "c")
        deadline = time.monotonic() + 20
        while rig.control.state()["robot_mode"] != mode:
            assert time.monotonic() < deadline
            time.sleep(0.05)
    acknowledge(rig)


def test_start_with_other_calibration_raises_rig_changed(rig: Rig) -> None:
    session_id = interrupted(rig)
    file = rig.store.folder(session_id) / "calibration.json"
    kept = file.read_text(encoding="utf-8")
    file.write_text(kept.replace('"lamp_intensity": 20.0', '"lamp_intensity": 21.0'), encoding="utf-8")
    assert refusal(rig, session_id).code is ErrorCode.RIG_CHANGED
    file.write_text(kept, encoding="utf-8")
    (file.parent / "arm.txt").write_text("another arm", encoding="utf-8")
    assert refusal(rig, session_id).code is ErrorCode.RIG_CHANGED
    rig.runner.act(session_id, Trigger.STOP, "a")


@pytest.mark.long
def test_object_moved_after_pilot_fails_first_planned_frame(rig: Rig) -> None:
    session_id = new(rig, Recipe(pilot_lights=3, planned_lights=1))
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 60
    while not any(work.solved for work in rig.store.record(session_id).passes):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    rig.control.fault("nudged_object", shift_m=[0.0, 0.005, 0.0])
    wait_for(rig, session_id, State.PAUSED)
    assert reason_of(rig, session_id)["code"] == "scene.moved"
    rig.control.fault("nudged_object", shift_m=[0.0, -0.005, 0.0])
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    quality = rig.store.record(session_id).passes[1].shots[0].quality
    assert quality.shift_px is not None
    assert quality.shift_px < 1
    assert quality.sharpness is not None
