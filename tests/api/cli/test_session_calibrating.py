"""What a calibration session tells a person at its end, and the error of one that has not completed."""

import pytest

from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session import State
from api.cli.session_calibrating import completed, sentences
from api.rest.schemas import Problem, SessionResource

LAMP = CalibrationSummary(
    kind="lamp", images=72, used=72, estimated=True, position_sigma_mm=0.08, verified_deg=0.22, advice=["Use it."]
)


def test_sentences_name_what_is_known_of_lamp_and_camera() -> None:
    assert sentences(LAMP) == [
        "lamp known to 0.08 mm",
        "verified on the held-out placing: mean error of the normals 0.22°",
        "Use it.",
    ]
    camera = LAMP.model_copy(update={"rotation_sigma_deg": 0.03, "verified_deg": None})
    assert sentences(camera) == ["camera known to 0.08 mm and 0.030°", "Use it."]


def test_completed_session_gives_its_estimate() -> None:
    done = SessionResource.model_construct(id="a", state=State.COMPLETED, reason=None, estimate=LAMP)
    assert completed(done) is LAMP


@pytest.mark.parametrize(
    ("state", "estimate"),
    [
        (State.PAUSED, LAMP),
        (State.COMPLETED, None),
        (State.COMPLETED, LAMP.model_copy(update={"estimated": False})),
    ],
)
def test_session_without_result_is_refused_by_name(state: State, estimate: CalibrationSummary | None) -> None:
    ended = SessionResource.model_construct(id="a", state=state, reason=None, estimate=estimate)
    with pytest.raises(RigError, match=f"Session a is {state}") as refused:
        completed(ended)
    assert refused.value.code is ErrorCode.CALIBRATION_INFEASIBLE


def test_paused_session_states_its_reason_and_leaves_the_remedy_to_the_command() -> None:
    reason = Problem.model_construct(code=ErrorCode.SCENE_MOVED, detail="The board moved", remedy="Tighten it.")
    paused = SessionResource.model_construct(id="a", state=State.PAUSED, reason=reason, estimate=None)
    with pytest.raises(RigError, match=r"Session a is paused: The board moved$") as refused:
        completed(paused)
    assert refused.value.code is ErrorCode.SCENE_MOVED


def test_stopped_session_is_no_poor_calibration() -> None:
    stopped = SessionResource.model_construct(id="a", state=State.STOPPED, reason=None, estimate=LAMP)
    with pytest.raises(RigError, match=r"^session\.stopped: Session a is stopped$"):
        completed(stopped)
