"""The runner against the simulated cell with planned exposures: several frames of each light, stopped and resumed."""

import time
from collections.abc import Generator

import pytest

from acquisition.formats.folders import session_folder
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.shot import Shot
from acquisition.session import ENDED, State, Trigger
from tests.acquisition.runner.simulated_rig import (
    Rig,
    acknowledge,
    end_what_is_left,
    new,
    rests,
    simulated_rig,
    wait_for,
)

PLANNED = Recipe(pilot_lights=3, planned_lights=2, exposure=Exposure(plan="planned"))
PILOT = Recipe(pilot_lights=6, planned_lights=0, exposure=Exposure(plan="planned"))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("brackets"), "127.0.6.21", profile="direct") as made:
        yield made


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    end_what_is_left(rig)


def in_mid_bracket(rig: Rig) -> str:
    """A session whose newest frame has a further one to follow."""
    session_id = new(rig, PILOT)
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 90
    while not any(shot.kind == "light" for shot in rig.store.journal.shots(session_id)):
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.01)
    return session_id


def assert_each_light_is_complete(shots: list[Shot]) -> None:
    """Each light has its frames once, in their order, taken where the arm stood for the first; and each exposure time
    its lamp-off frame."""
    keys = [shot.key for shot in shots]
    assert len(keys) == len(set(keys))
    lit = [shot for shot in shots if shot.kind == "light"]
    assert lit
    for light in lit:
        of = [
            one for one in shots if one.kind == "bracket" and one.key.pass_number == light.key.pass_number
            and one.light_number == light.light_number
        ]  # fmt: skip
        assert [one.exposure_s for one in of] == light.further_s
        assert all(one.joints == pytest.approx(light.joints, abs=1e-4) for one in of)
        for one in (light, *of):
            darks = [dark for dark in shots if dark.kind == "dark" and dark.key.pass_number == one.key.pass_number]
            assert one.exposure_s in [dark.exposure_s for dark in darks]


@pytest.mark.long
def test_planned_exposures_session_takes_all_frames_of_each_light(rig: Rig) -> None:
    session_id = new(rig, PLANNED)
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    shots = rig.store.journal.shots(session_id)
    assert_each_light_is_complete(shots)
    capture = session_folder.read(rig.store.folder(session_id))
    plan = capture.plans[1]
    assert plan.exposures is not None
    assert len(plan.exposures) == 2
    for number, exposures in enumerate(plan.exposures):
        (light,) = (one for one in capture.shots if one.kind == "light" and one.key.pass_number == 1
                    and one.light_number == number)  # fmt: skip
        assert [light.exposure_s, *light.further_s] == exposures.times_s
        assert exposures.seconds > sum(exposures.times_s)
    pilot = [shot for shot in shots if shot.kind == "light" and shot.key.pass_number == 0]
    assert all(len(shot.further_s) == 1 and shot.further_s[0] > 5 * shot.exposure_s for shot in pilot)
    assert rig.control.state()["digital_outputs"] == 0


def test_stop_in_mid_bracket_halts_at_once(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    begun = time.monotonic()
    rig.runner.act(session_id, Trigger.STOP, "b")
    assert wait_for(rig, session_id, *ENDED) is State.STOPPED
    assert time.monotonic() - begun < 5  # on a machine under load
    assert rests(rig)
    assert rig.control.state()["digital_outputs"] == 0
    lit = [shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]
    assert len(lit) < PILOT.pilot_lights


def test_pause_in_mid_bracket_resumes_without_double_or_lost_frames(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    wait_for(rig, session_id, State.PAUSED)
    before = [shot.frame.sha256 for shot in rig.store.journal.shots(session_id)]
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    shots = rig.store.journal.shots(session_id)
    assert_each_light_is_complete(shots)
    assert [shot.frame.sha256 for shot in shots][: len(before)] == before


def test_arm_moved_away_in_mid_bracket_returns_to_the_light(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    joints = list(rig.control.state()["joints"])
    rig.control.fault("hand_move", joints=[joints[0] + 0.3, *joints[1:]], seconds=0)
    deadline = time.monotonic() + 60
    while rig.runner.status().reading.joints[0] < joints[0] + 0.299:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    rig.runner.act(session_id, Trigger.RESUME, "a", from_here=True)
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    assert_each_light_is_complete(rig.store.journal.shots(session_id))


def test_protective_stop_in_mid_bracket_resumes_to_complete_lights(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    assert_each_light_is_complete(rig.store.journal.shots(session_id))


def test_lost_frame_in_bracket_is_retaken(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    rig.control.fault("dropped_frame")
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    assert_each_light_is_complete(rig.store.journal.shots(session_id))
    faults = [event.body for event in rig.store.journal.events(0, 500, session_id, ("camera.fault",))]
    assert [(fault["kind"], fault["retaken"]) for fault in faults] == [("lost", True)]


@pytest.mark.parametrize(
    ("exposure", "said"),
    [
        ({"seconds": 5.0}, "exposure.seconds is 5 s"),
        ({"plan": "planned", "seconds_per_light": 1e-5}, "exposure.seconds_per_light is 1e-05 s"),
    ],
)
def test_create_exposure_out_of_range_is_named_and_nothing_moves(
    rig: Rig, exposure: dict[str, object], said: str
) -> None:
    moves = rig.control.state()["moves_started"]
    recipe = Recipe(exposure=Exposure.model_validate(exposure))
    for ask in (lambda: rig.runner.create(recipe), lambda: rig.runner.planning.dry_run(recipe)):
        with pytest.raises(RigError) as refused:
            ask()
        assert refused.value.code is ErrorCode.REQUEST_INVALID
        assert said in refused.value.detail
    assert rig.control.state()["moves_started"] == moves


def test_recipe_fixed_time_and_planned_exposures_contradict() -> None:
    with pytest.raises(ValueError, match="nothing to be planned"):
        Exposure(plan="planned", seconds=0.1)
