"""The runner against the simulated cell: requests that race with its turns, pause and resume, what it refuses."""

import threading
import time
from collections.abc import Generator
from dataclasses import dataclass

import pytest

from acquisition.errors import ErrorCode, RigError
from acquisition.runner import Runner
from acquisition.session import ENDED, State, Trigger
from acquisition.store import Store
from acquisition.types import Recipe
from api import settings, wiring
from hardware_sim.cell import Cell
from hardware_sim.controller.control import ControlClient

SMALL = Recipe(pilot_lights=3, planned_lights=0)


@dataclass(frozen=True)
class Rig:
    runner: Runner
    store: Store
    control: ControlClient


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    folder = tmp_path_factory.mktemp("runner")
    with Cell("127.0.6.10", "sphere", 1, "ideal", 10.0, folder=folder / "cell", pixels=96) as cell:
        service = wiring.build(settings.read(cell=cell.cell_file, data=folder / "data"))
        service.open()
        with ControlClient(cell.address) as control:
            yield Rig(service.runner, service.store, control)
        service.close()


def new(rig: Rig, recipe: Recipe = SMALL) -> str:
    return rig.runner.create(recipe)[0].id


def wait_for(rig: Rig, session_id: str, *states: State, within_s: float = 40.0) -> State:
    deadline = time.monotonic() + within_s
    while (state := rig.store.journal.session(session_id).state) not in states:
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.01)
    return state


def rests(rig: Rig) -> bool:
    before = rig.control.state()["joints"]
    time.sleep(0.1)
    return rig.control.state()["joints"] == pytest.approx(before, abs=1e-5)


def test_a_stop_at_any_time_ends_stopped_with_the_arm_at_rest(rig: Rig) -> None:
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


def test_the_same_start_twice_at_once_is_one_run_that_can_be_stopped(rig: Rig) -> None:
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


def test_of_two_sessions_started_at_once_one_runs_and_one_is_told_who_holds_the_rig(rig: Rig) -> None:
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


def test_a_pause_settles_between_steps_and_a_resume_takes_no_frame_twice(rig: Rig) -> None:
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 30
    while not rig.store.journal.shots(session_id):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    wait_for(rig, session_id, State.PAUSED)
    taken = len(rig.store.journal.shots(session_id))
    assert rests(rig)
    time.sleep(0.5)
    assert len(rig.store.journal.shots(session_id)) == taken < 4
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    keys = [shot.key for shot in rig.store.journal.shots(session_id)]
    assert len(keys) == len(set(keys))
    assert len([shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]) == 3


def test_a_protective_stop_interrupts_and_nothing_goes_on_before_a_person_has_looked(rig: Rig) -> None:
    session_id = new(rig)
    rig.control.fault("protective_stop", at_move=2)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.INTERRUPTED)
    reason = rig.store.journal.session(session_id).reason
    assert reason is not None
    assert reason["code"] == "arm.protective_stop"
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


def test_a_dead_lamp_is_found_and_told(rig: Rig) -> None:
    rig.control.fault("output_stuck", output=0, level=False)
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    wait_for(rig, session_id, State.INTERRUPTED)
    reason = rig.store.journal.session(session_id).reason
    assert reason is not None
    assert reason["code"] == "lamp.not_confirmed"
    rig.control.fault("clear")
    rig.runner.act(session_id, Trigger.STOP, "a")
    assert rig.store.journal.session(session_id).state is State.STOPPED


def test_lights_that_cannot_be_reached_are_named_before_anything_moves(rig: Rig) -> None:
    before = rig.control.state()["moves_started"]
    far = Recipe(method="user", user_lights=[(0.0, 0.1, -0.45), (0.1, 0.0, -0.45), (0.0, 3.0, -0.9)])
    session_id = new(rig, far)
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, *ENDED) is State.FAILED
    reason = rig.store.journal.session(session_id).reason
    assert reason is not None
    assert reason["code"] == "waypoints.unreachable"
    assert "2" in reason["detail"]
    assert rig.control.state()["moves_started"] == before
