"""Sessions on a UR20, and on a UR5e with PolyScope X, stopped in mid-move by each halt path alone."""

import functools
from collections.abc import Generator
from pathlib import Path
from typing import Literal
from unittest import mock

import pytest

from acquisition.devices.ur.arm import UrArm
from acquisition.models.recipe import Recipe
from acquisition.session_state import ENDED, State, Trigger
from api.rest import wiring
from hardware_sim.controller.modes import RuntimeState
from tests.acquisition.runner.simulated_rig import CELL_FILE, Rig, acknowledge, new, simulated_rig, wait_for
from tests.end_to_end.processes import rests_after, wait_until_moving
from tests.end_to_end.test_large_arm import large_cell_file

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

LIFE_SPEED = 1.0
"""As a real arm's, so that a halt has a move to end."""
RESTS_WITHIN_S = 2.0
PATHS = {
    "driver": {"halt_by_program_stop": False},
    "program stop": {"halt_by_driver": False},
}
ARMS: dict[str, tuple[str, Literal["5", "x"]]] = {"ur20": ("127.0.6.41", "5"), "ur5e x": ("127.0.6.42", "x")}


@pytest.fixture(params=[(arm, path) for arm in ARMS for path in PATHS], ids=" by ".join)
def one_path(request: pytest.FixtureRequest, tmp_path: Path) -> Generator[tuple[Rig, str], None, None]:
    """A rig whose arm has but one of its two halt paths, and which."""
    name, path = request.param
    address, polyscope = ARMS[name]
    cell_file = large_cell_file(tmp_path) if name == "ur20" else CELL_FILE
    with (
        mock.patch.object(wiring, "UrArm", functools.partial(UrArm, **PATHS[path])),
        simulated_rig(tmp_path / "rig", address, polyscope, cell_file, LIFE_SPEED) as rig,
    ):
        yield rig, path


def begins(rig: Rig) -> str:
    """A session whose arm moves."""
    session_id = new(rig, Recipe(pilot_lights=10, planned_lights=0))
    rig.runner.act(session_id, Trigger.START, "a")
    wait_until_moving(rig.control, within_s=300.0)
    return session_id


def stopped_by_that_path_alone(rig: Rig, path: str) -> bool:
    """Halts a session in mid-move; whether the controller's log shows that path and no other."""
    session_id = begins(rig)
    lines = len(rig.control.log())
    rig.runner.halt("a")
    assert rests_after(rig.control) < RESTS_WITHIN_S
    assert wait_for(rig, session_id, *ENDED) is State.STOPPED
    assert rig.control.state()["digital_outputs"] == 0
    state, said = (
        rig.control.state(),
        [line for line in rig.control.log()[lines:] if " stopped: " in line or "stop program" in line],
    )
    acknowledge(rig)
    if path == "driver":
        return state["runtime_state"] == RuntimeState.PLAYING and not said
    return any("by the dashboard" in line or "stop program: Stopped" in line for line in said)


def test_session_stopped_by_one_halt_path_alone(one_path: tuple[Rig, str]) -> None:
    rig, path = one_path
    # Where the machine keeps service or driver waiting, lease or watchdog may have stopped the arm just before.
    assert any(stopped_by_that_path_alone(rig, path) for _ in range(5))
    session_id = new(rig, Recipe(pilot_lights=3, planned_lights=0))
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=300.0) is State.COMPLETED
    assert rig.control.state()["collisions"] == 0
