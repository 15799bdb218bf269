"""The runner against the simulated cell: moved arm or object, rejected frames, faults, and recovery from them, also
between the frames of a bracket (planned exposures: several of each light)."""

import os
import signal
import time
from collections.abc import Generator
from contextlib import suppress

import pytest

from acquisition.formats.folders import session_folder
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.shot import Shot
from acquisition.session_state import ENDED, State, Trigger
from acquisition.store.folder import sha256_of
from tests.acquisition.runner.simulated_rig import (
    LONG,
    Rig,
    acknowledge,
    after_first_image,
    end_what_is_left,
    interrupted,
    move_by_hand,
    new,
    reason_of,
    refusal,
    rests,
    simulated_rig,
    wait_for,
)

PLANNED = Recipe(pilot_lights=3, planned_lights=2, exposure=Exposure(plan="planned"))
PILOT = Recipe(pilot_lights=6, planned_lights=0, exposure=Exposure(plan="planned"))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("runner"), "127.0.6.11") as made:
        yield made


@pytest.fixture(autouse=True)
def _at_ease(rig: Rig) -> None:
    end_what_is_left(rig)


@pytest.mark.long
def test_resume_displaced_arm_requires_from_here(rig: Rig) -> None:
    session_id = interrupted(rig)
    joints = list(rig.control.state()["joints"])
    move_by_hand(rig, [joints[0] + 0.3, *joints[1:]])
    error = refusal(rig, session_id)
    assert error.code is ErrorCode.ARM_ELSEWHERE
    assert 0.1 < error.context["distance_rad"] <= 0.3 + 1e-3
    assert rests(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a", from_here=True)
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    kinds = [shot.kind for shot in rig.store.journal.shots(session_id)]
    assert kinds.count("reference") == 2  # after the interruption, and at the end of the pass


@pytest.mark.long
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


@pytest.mark.long
def test_object_moved_during_pilot_discards_all_its_images(rig: Rig) -> None:
    session_id = after_first_image(rig)
    rig.control.fault("nudged_object", shift_m=[0.004, 0.0, 0.0])
    wait_for(rig, session_id, State.PAUSED)
    reason = reason_of(rig, session_id)
    assert reason["code"] == "scene.moved"
    assert "all images of pass 0 will be taken again" in reason["detail"]
    assert rig.store.journal.shots(session_id) == []
    events = [event for event in rig.store.journal.events(0, 500, session_id) if event.type.startswith("shot")]
    assert [event.type for event in events].count("shot.captured") == LONG.pilot_lights
    assert events[-1].type == "shots.discarded"
    rig.runner.act(session_id, Trigger.RESUME, "a")  # the object stays where it is now
    assert wait_for(rig, session_id, *ENDED) is State.COMPLETED
    rig.control.fault("nudged_object", shift_m=[-0.004, 0.0, 0.0])
    shots = rig.store.journal.shots(session_id)
    lights = LONG.pilot_lights
    assert [shot.kind for shot in shots] == ["light"] * lights + ["reference"] + ["dark"] * (len(shots) - lights - 1)
    assert shots[lights].repeats == shots[0].key
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
    assert any("saturated" in reason for reason in reasons)
    faults = [event.body for event in rig.store.journal.events(0, 500, session_id, ("camera.fault",))]
    assert [(fault["kind"], fault["retaken"]) for fault in faults] == [("lost", True)]
    assert all(shot.camera is not None for shot in rig.store.journal.shots(session_id))


def test_compute_killed_again_and_again_pauses_until_resumed(rig: Rig) -> None:
    session_id = new(rig)
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 90
    while rig.store.journal.session(session_id).state is not State.PAUSED:
        assert time.monotonic() < deadline
        process = rig.runner._compute._process
        if process is not None and process.pid is not None:
            with suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)
        time.sleep(0.005)
    reason = reason_of(rig, session_id)
    assert reason["code"] == "compute.lost"
    assert "memory runs out" in reason["detail"]
    assert "resume" in reason["remedy"]
    rig.runner.act(session_id, Trigger.RESUME, "a")
    deadline = time.monotonic() + 240  # starting the process takes long on a busy machine, for it is of low priority
    while not rig.store.journal.artifacts(session_id, "plan"):
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.01)


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
        assert time.monotonic() < stopped + 60
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
    wait_for_reasons(rig, [ErrorCode.ARM_NOT_READY])
    for step, mode in (("power", 5), ("brakes", 7)):  # UR's robot modes: idle, running
        assert rig.control.state()["robot_mode"] != mode
        rig.runner.recover(step, "c")
        deadline = time.monotonic() + 60
        while rig.control.state()["robot_mode"] != mode:
            assert time.monotonic() < deadline
            time.sleep(0.05)
    wait_for_reasons(rig, [])
    acknowledge(rig)


def wait_for_reasons(rig: Rig, codes: list[ErrorCode]) -> None:
    """Waits until exactly these keep a session from starting."""
    deadline = time.monotonic() + 60
    while [reason["code"] for reason in rig.runner.status().reasons] != codes:
        assert time.monotonic() < deadline, rig.runner.status().reasons
        time.sleep(0.05)


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


@pytest.mark.long
def test_arm_moved_away_in_mid_bracket_returns_to_the_light(rig: Rig) -> None:
    session_id = in_mid_bracket(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    joints = list(rig.control.state()["joints"])
    move_by_hand(rig, [joints[0] + 0.3, *joints[1:]])
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


@pytest.mark.long
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
