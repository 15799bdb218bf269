"""`lightpose calibrate lamp | all --address …`: calibration sessions in turn, each used by the next.

The targets must be put into the cell between and within the sessions: the board on the flange, the mirror sphere and
the matt plane in the object's place. `Hands` does that: a person who is asked, or the stage of a simulated cell. Each
session's result is put into use, because the next session computes with it. The calibration used before is named, so
that a person can go back to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import typer
from rich.console import Console

from acquisition.models.calibration_recipe import AnyRecipe, BoardRecipe, tool_of
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import State
from api import Client
from api.cli import session_calibrating
from api.rest.schemas import SessionResource
from hardware_sim import placing

Say = Callable[[str], None]

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


def at_terminal(address: str, recipes: Sequence[AnyRecipe], *, yes: bool, simulated: str | None) -> dict[str, Any]:
    """Runs calibration sessions at a service, with a person at the terminal or the stage of a `simulated` cell.

    Returns the figures of each. Raises RigError, ProblemError as `run`.
    """
    console = Console(stderr=True, markup=False)

    def say(sentence: str) -> None:
        console.print(sentence, highlight=False, soft_wrap=True)

    hands = PersonsHands(say, yes) if simulated is None else SimulatedHands(say, simulated)
    with Client(address) as client:
        done = run(client, recipes, hands, say)
    found = {
        one.recipe.kind: session_calibrating.used_from_now_on(one.estimate).model_dump(mode="json")
        for one in done
        if one.estimate is not None
    }
    return {"calibration": done[-1].id, "active": True, **found}


def run(client: Client, recipes: Sequence[AnyRecipe], hands: Hands, say: Say) -> list[SessionResource]:
    """Runs calibration sessions in turn, and puts each one's result into use. Returns the sessions.

    Raises RigError with a session's reason if one does not complete, ProblemError if the service refuses.
    """
    done: list[SessionResource] = []
    for recipe in recipes:
        _prepare(client, recipe, hands)
        session = follow(client, recipe, hands, say)
        before = client.calibration()
        client.activate_calibration(session.id)
        say(f"calibration {session.id} is in use (before: {before.file})")
        done.append(session)
    return done


def follow(client: Client, recipe: AnyRecipe, hands: Hands, say: Say) -> SessionResource:
    """Runs one calibration session to its end, and puts each target into place when the session waits for it.

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
