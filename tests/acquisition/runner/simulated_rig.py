"""A runner on a simulated cell, and what its tests do with sessions: start, wait, look for the reason, acknowledge."""

import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.runner.runner import Runner
from acquisition.session import same_joints
from acquisition.session_state import ENDED, State, Trigger
from acquisition.store import Store
from api.rest import settings, wiring
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient

CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"
SMALL = Recipe(pilot_lights=3, planned_lights=0)
LONG = Recipe(pilot_lights=10, planned_lights=0)
"""Still runs when the test that acts on it has been kept waiting for a second."""


@dataclass(frozen=True)
class Rig:
    runner: Runner
    store: Store
    control: ControlClient


@contextmanager
def simulated_rig(
    folder: Path, address: str, polyscope: Literal["5", "x"] = "5", cell_file: Path = CELL_FILE, speed: float = 20.0,
    profile: str = "ideal", shown: str = "sphere", pixels: int = 96,
) -> Generator[Rig, None, None]:  # fmt: skip
    """The runner of a service on a cell at `address`, whose controller has this software; `shown` stands in it."""
    options = CellOptions(address, shown, 1, profile, speed, pixels=pixels, cell_file=cell_file, polyscope=polyscope)
    with Cell(options, folder / "cell") as cell:
        service = wiring.build(settings.read(cell=cell.cell_file, data=folder / "data"))
        service.open()
        with ControlClient(cell.address) as control:
            yield Rig(service.runner, service.store, control)
        service.close()


def end_what_is_left(rig: Rig) -> None:
    """Ends what the test before has left behind, and a fault that the machine's load has latched meanwhile."""
    holder = rig.store.journal.holder()
    if holder is not None:
        rig.runner.act(holder.id, Trigger.STOP, "a")
        wait_for(rig, holder.id, *ENDED)
    acknowledge(rig)


def new(rig: Rig, recipe: AnyRecipe = SMALL) -> str:
    return rig.runner.create(recipe)[0].id


def start(rig: Rig, session_id: str, within_s: float = 300.0) -> None:
    """Starts a session; again, as a person does, while a machine that is too busy has not connected everything."""
    deadline = time.monotonic() + within_s
    while True:
        try:
            rig.runner.act(session_id, Trigger.START, "a")
        except RigError as error:
            if error.code is not ErrorCode.RIG_NOT_READY or time.monotonic() > deadline:
                raise
            time.sleep(0.5)
        else:
            return


def wait_for(rig: Rig, session_id: str, *states: State, within_s: float = 240.0) -> State:
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


def move_by_hand(rig: Rig, joints: Sequence[float]) -> None:
    """Moves the arm to `joints` (rad) by hand; the runner reads them then."""
    rig.control.fault("hand_move", joints=list(joints), seconds=0)
    deadline = time.monotonic() + 60
    while not same_joints(rig.runner.status().reading.joints, tuple(joints)):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def refusal(rig: Rig, session_id: str) -> RigError:
    with pytest.raises(RigError) as refused:
        rig.runner.act(session_id, Trigger.RESUME, "a")
    return refused.value


def after_first_image(rig: Rig, recipe: AnyRecipe = LONG, within_s: float = 90.0) -> str:
    """A session that runs and has taken its first image."""
    session_id = new(rig, recipe)
    start(rig, session_id)
    deadline = time.monotonic() + within_s
    while not rig.store.journal.shots(session_id):
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
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
    deadline = time.monotonic() + 60
    while True:
        try:
            rig.runner.acknowledge("a")
        except RigError:
            assert time.monotonic() < deadline
            time.sleep(0.05)
            continue
        return
