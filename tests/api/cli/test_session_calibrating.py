"""What a calibration session tells a person at its end, and the error of one that has not completed."""

import contextlib
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from acquisition.models.calibration_recipe import LampRecipe, ResponseRecipe
from acquisition.models.calibration_result import USE_IT, CalibrationSummary
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import State
from api.cli import calibrating_in_turn, session_calibrating
from api.cli.commands import app
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


class Service:
    """A service whose session completes at once with a result that only has to be put into use."""

    def __init__(self) -> None:
        found = LAMP.model_copy(update={"advice": [USE_IT, "Darken the room."]})
        self.done = SessionResource.model_construct(
            id="a", state=State.COMPLETED, reason=None, estimate=found, recipe=ResponseRecipe(kind="response")
        )
        self.in_use: list[str] = []

    def create(self, _recipe: object) -> SessionResource:
        return self.done

    def start(self, _id: str) -> None:
        pass

    def wait(self, _id: str) -> SessionResource:
        return self.done

    def estimates(self, _id: str) -> list[Any]:
        return [self.done.model_copy(update={"number": 1})]

    def activate_calibration(self, name: str) -> None:
        self.in_use.append(name)

    def state_tool(self, _tool: str) -> None:
        pass

    def rig(self) -> SimpleNamespace:
        return SimpleNamespace(tool="lamp")

    def calibration(self) -> SimpleNamespace:
        return SimpleNamespace(file="calibration.json")


@pytest.mark.parametrize("activate", [True, False])
def test_calibration_in_use_is_not_advised_to_be_put_into_use(
    activate: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = Service()

    @contextlib.contextmanager
    def client(_address: str) -> Iterator[Service]:
        yield service

    monkeypatch.setattr(session_calibrating, "Client", client)
    outcome = session_calibrating.calibrate(
        "http://cell", ResponseRecipe(kind="response"), mounted=False, activate=activate
    )
    said = capsys.readouterr().err
    assert ("calibration a is in use" in said, "PUT /v1/rig" in said) == (activate, not activate)
    assert "Darken the room." in said
    assert outcome["advice"] == [*([] if activate else [USE_IT]), "Darken the room."]
    assert service.in_use == ["a"] * activate


def test_calibration_in_turn_does_not_advise_what_it_does_itself() -> None:
    said: list[str] = []
    calibrating_in_turn.follow(
        Service(),
        ResponseRecipe(kind="response"),
        calibrating_in_turn.PersonsHands(said.append),
        said.append,  # type: ignore[arg-type]
    )
    assert "Darken the room." in said
    assert USE_IT not in said


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Service:
    """A service at which `lightpose calibrate lamp | all` runs; whoever is asked has put the target into place."""
    service = Service()
    service.done = service.done.model_copy(update={"recipe": LampRecipe(kind="lamp")})
    monkeypatch.setattr(calibrating_in_turn, "Client", lambda _address: contextlib.nullcontext(service))
    return service


def in_turn(*options: str, answers: str) -> Result:
    """What the command line says, with these answers at the terminal."""
    command = ["calibrate", *options, "--address", "http://cell", "--json"]
    return CliRunner().invoke(app, command, input=answers)


@pytest.mark.parametrize("activate", [True, False])
def test_lamp_is_put_into_use_only_where_a_person_says_so(activate: bool, terminal: Service) -> None:
    done = in_turn("lamp", *["--activate"] * activate, answers="y\n")
    assert done.exit_code == 0, done.output
    assert terminal.in_use == ["a"] * activate
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert (outcome["active"], USE_IT in outcome["lamp"]["advice"], USE_IT in done.stderr) == (
        activate, not activate, not activate,
    )  # fmt: skip


def test_calibrate_all_asks_before_a_result_is_used(terminal: Service) -> None:
    """The lamp's session computes with the result before, so that it does not begin where that is not used."""
    refused = in_turn("all", answers="y\nn\n")
    assert (refused.exit_code, terminal.in_use) == (2, [])
    assert "Calibration a is kept but not in use" in refused.stderr
    assert "lightpose calibrate lamp" in refused.stderr
    done = in_turn("all", answers="y\ny\ny\nn\n")
    assert (done.exit_code, terminal.in_use) == (0, ["a"]), done.output
    terminal.in_use.clear()
    assert in_turn("all", "--activate", answers="y\ny\n").exit_code == 0
    assert terminal.in_use == ["a", "a"]


@pytest.mark.parametrize("silent", [("--yes",), ("--simulated", "127.0.0.1")])
def test_calibrate_all_without_questions_needs_activate(silent: tuple[str, ...], terminal: Service) -> None:
    refused = in_turn("all", *silent, answers="")
    assert (refused.exit_code, terminal.in_use) == (2, [])
    assert "--activate" in refused.stderr
