"""`lightpose calibrate lamp | all --address …`: calibration sessions in turn, each used by the next.

The targets must be put into the cell between and within the sessions: the board on the flange, the mirror sphere and
the matt plane in the object's place. `Hands` does that: a person who is asked, or the stage of a simulated cell. A
person chooses whether a result is put into use, by `--activate` or at the terminal; without that no next session
begins, because it would compute with the values before. The calibration used before is named, so that a person can go
back to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import typer
from rich.console import Console

from acquisition.models.calibration_recipe import AnyRecipe, BoardRecipe, tool_of
from acquisition.models.calibration_result import USE_IT
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import State
from api import Client
from api.cli import session_calibrating
from api.rest.schemas import SessionResource
from hardware_sim import placing

Say = Callable[[str], None]
Choose = Callable[[str], bool]
"""Whether the calibration of a session's id is put into use."""

Target = Literal["board", "mirror-sphere", "matt-plane", "object"]
"""What is put into the cell."""


class Hands(Protocol):
    """Puts targets into the cell."""

    def put(self, target: Target, number: int, sentence: str) -> None:
        """Puts a target into the cell in its `number`-th placing, as `sentence` says. Raises RigError if refused."""
        ...


@dataclass(frozen=True)
class PersonsHands:
    """Asks a person at the terminal. With `yes` it only prints the sentences, as everything is in place."""

    say: Say
    yes: bool = False

    def put(self, target: Target, number: int, sentence: str) -> None:
        """Asks, and waits for an answer. Raises RigError request.invalid if the person says no."""
        self.say(sentence)
        if not self.yes and not typer.confirm("Is this done, and is nobody within the arm's reach?", err=True):
            raise RigError(ErrorCode.REQUEST_INVALID, f"The {target} is not in place: nothing was moved")


@dataclass(frozen=True)
class SimulatedHands:
    """Controls the stage of a simulated cell through the port of its camera."""

    say: Say
    address: str
    port: int = 30100

    def put(self, target: Target, number: int, sentence: str) -> None:
        """Places the target in the running cell. Raises RigError device.disconnected, request.invalid."""
        name = {"board": "charuco@flange", "object": "empty"}.get(target, target)
        self.say(
            f"{sentence} (simulated: {placing.place(self.address, self.port, name + f'#{number}' * (number > 0))})"
        )


def at_terminal(
    address: str, recipes: Sequence[AnyRecipe], *, yes: bool, simulated: str | None, activate: bool
) -> dict[str, Any]:
    """Runs calibration sessions at a service, with a person at the terminal or the stage of a `simulated` cell.

    With `activate` each result is put into use. Else that of a single session is not, and with several sessions a
    person is asked after each. Returns the figures of each. Raises RigError, ProblemError as `run`.
    """
    console = Console(stderr=True, markup=False)

    def say(sentence: str) -> None:
        console.print(sentence, highlight=False, soft_wrap=True)

    hands = PersonsHands(say, yes) if simulated is None else SimulatedHands(say, simulated)
    used: list[str] = []

    def choose(name: str) -> bool:
        wanted = activate or (len(recipes) > 1 and typer.confirm(f"Use calibration {name} from now on?", err=True))
        if wanted:
            used.append(name)
        return wanted

    with Client(address) as client:
        done = run(client, recipes, hands, say, choose)
    found: dict[str, Any] = {}
    for one in done:
        summary = session_calibrating.completed(one)
        shown = session_calibrating.used_from_now_on(summary) if one.id in used else summary
        found[one.recipe.kind] = shown.model_dump(mode="json")
    return {"calibration": done[-1].id, "active": done[-1].id in used, **found}


def run(client: Client, recipes: Sequence[AnyRecipe], hands: Hands, say: Say, choose: Choose) -> list[SessionResource]:
    """Runs calibration sessions in turn, and puts each result into use that is chosen. Returns the sessions.

    Raises RigError with a session's reason if one does not complete, request.invalid if a result is not chosen that the
    next session needs; ProblemError if the service refuses.
    """
    done: list[SessionResource] = []
    for number, recipe in enumerate(recipes, start=1):
        _prepare(client, recipe, hands)
        session = follow(client, recipe, hands, say)
        done.append(session)
        if choose(session.id):
            before = client.calibration()
            client.activate_calibration(session.id)
            say(f"calibration {session.id} is in use (before: {before.file})")
        elif number < len(recipes):
            further = " and ".join(one.kind for one in recipes[number:])
            raise RigError(
                ErrorCode.REQUEST_INVALID,
                f"Calibration {session.id} is kept but not in use, so {further}, which computes with it, was not "
                f"begun. Put it into use (PUT /v1/rig/calibrations/active), then run `lightpose calibrate {further}`",
            )
        elif USE_IT in session_calibrating.completed(session).advice:
            say(USE_IT)
    return done


def follow(client: Client, recipe: AnyRecipe, hands: Hands, say: Say) -> SessionResource:
    """Runs one calibration session to its end, and puts each target into place when the session waits for it.

    Says what was found, but not whether to use it.

    Raises RigError with the session's reason if it does not complete.
    """
    created = client.create(recipe)
    say(f"calibration of kind {recipe.kind}: session {created.id}; POST /v1/rig/stop stops it at any time")
    client.start(created.id)
    while True:
        done = client.wait(created.id)
        reason = done.reason
        if done.state is State.PAUSED and reason is not None and reason.code is ErrorCode.CALIBRATION_PLACE_TARGET:
            context: dict[str, Any] = reason.model_extra or {}
            hands.put(context["target"], context["placing"], reason.detail)
            client.resume(done.id)
            continue
        break
    found = session_calibrating.used_from_now_on(session_calibrating.completed(done))
    for sentence in session_calibrating.sentences(found):
        say(sentence)
    say(f"report with values, residuals and pictures: {session_calibrating.report_path(client, done.id)}")
    return done


def _prepare(client: Client, recipe: AnyRecipe, hands: Hands) -> None:
    """Has the tool and the first target put into place, and states the tool."""
    tool, stated = tool_of(recipe), client.rig().tool
    if isinstance(recipe, BoardRecipe):
        if stated != "board":
            hands.put("board", 0, "Mount the calibration board on the flange, as the cell file says")
    elif stated == "board":
        hands.put("mirror-sphere", 0, "Take the board off the flange, put the lamp back, and lay the mirror sphere in "
                  "the object's place")  # fmt: skip
    else:
        hands.put("mirror-sphere", 0, "Lay the mirror sphere in the object's place")
    if stated != tool:
        client.state_tool(tool)
